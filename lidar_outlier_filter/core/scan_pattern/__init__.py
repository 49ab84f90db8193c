# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Neighbours that the scanner gives: rings, recovered rings, bands of elevation, profiles."""
