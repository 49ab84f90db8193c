# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The filter itself: points, neighbours, kernels, detectors, and the chain that judges blocks.

It needs numpy, scipy and its compiled module. Importing ROS here is a lint error.
"""
