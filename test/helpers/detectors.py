# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The bits of the detectors."""

from lidar_outlier_filter.core.detectors.registry import DETECTORS

BITS = {name: one.bit for name, one in DETECTORS.items()}
