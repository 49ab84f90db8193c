# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Messages in, answers out, without ROS: sessions, motion, poses that are waited for, counts."""
