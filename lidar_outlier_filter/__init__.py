# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Clean lidar clouds from a moving vehicle, live and offline, with the same answer in both."""

__version__ = '0.1.0'
