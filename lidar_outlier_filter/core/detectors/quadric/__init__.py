# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Quadric surfaces through the neighbourhood (Leslar, Wang and Hu 2010, section 2.2)."""
