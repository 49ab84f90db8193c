# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The search for parameters, by a truth that is known or by outliers that it injects."""
