# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The detectors. Each is a module or a folder, and gives every point of a block a score."""
