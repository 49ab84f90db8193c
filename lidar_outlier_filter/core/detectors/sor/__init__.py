# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Outliers by the distance to their neighbours: SOR, SOR2, DSOR, ROR and DROR."""
