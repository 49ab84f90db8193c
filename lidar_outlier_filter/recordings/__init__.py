# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings: bags of ROS 1 and ROS 2, and their replay through the filter."""
