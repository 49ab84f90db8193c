# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Verdicts compared with the truth: labels, counts, intervals, curves and pictures."""
