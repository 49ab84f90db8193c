# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What a parameter is, the parameters of filter and node, and YAML; detectors declare their own."""
