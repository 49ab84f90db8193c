# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The methods as textbook loops, one file for each: they import nothing of the package."""
