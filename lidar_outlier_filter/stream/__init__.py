# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The way of a cloud without ROS: cloud filter, waiting for poses, motion."""
