# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The node: subscriptions, worker, publishers, live parameters, clocks, health, diagnostics."""
