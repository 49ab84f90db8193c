# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Every parameter, declared once: name, type, default, unit, range and one sentence."""
