# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The pages of ``doc/papers``: each paper's tables and figures, and ours beside them."""
