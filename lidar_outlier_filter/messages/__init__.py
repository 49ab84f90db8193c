# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""PointCloud2: its bytes as a structured array, and what its fields mean, labels too."""
