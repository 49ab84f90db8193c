# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The filter itself: numpy, scipy and numba; importing ROS here is a lint error."""
