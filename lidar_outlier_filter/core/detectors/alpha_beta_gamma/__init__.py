# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The moving fixed-interval smoother derived from the α-β-γ filter (Leslar, Wang and Hu 2010)."""
