# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Gross errors of the elevation (Kang, Huang and Yang 2018)."""
