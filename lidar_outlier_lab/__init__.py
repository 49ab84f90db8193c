# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What makes the default of lidar_outlier_filter, and proves it: simulation, training, results."""
