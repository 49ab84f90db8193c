# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""PointCloud2 and 2-D scans: their bytes as structured arrays, and what their fields mean."""
