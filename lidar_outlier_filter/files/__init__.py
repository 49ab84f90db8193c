# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds that are files: one module for each format, all of one shape, :class:`CloudFile`."""
