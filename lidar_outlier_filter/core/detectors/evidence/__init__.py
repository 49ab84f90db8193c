# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The default detector: a weighted sum of features of the scan line and the neighbourhood."""
