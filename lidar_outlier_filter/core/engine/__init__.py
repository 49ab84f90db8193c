# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Points to verdicts: blocks of a stream, tiles of a cloud, and the chain of detectors."""
