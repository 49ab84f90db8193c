# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""One exact search for neighbours: a kd-tree, and what is asked of it."""
