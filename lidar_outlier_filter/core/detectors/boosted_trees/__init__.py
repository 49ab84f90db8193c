# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The default detector: gradient-boosted trees on the scan pattern or on the neighbours."""
