# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Why the default rejects a point: what each feature adds, and the strongest as a number."""
