# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Hierarchical outlier detection by clusters of graphs (Sotoodeh 2007)."""
