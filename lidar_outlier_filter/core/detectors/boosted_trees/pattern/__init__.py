# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Trees on the scan pattern: spinning sensors, and profile scanners whose mirror turns evenly."""
