# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Messages in, split clouds out, without ROS: the pipeline, motion, pending poses, counts."""
