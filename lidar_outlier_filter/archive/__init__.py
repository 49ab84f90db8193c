# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Archives: many recordings or files, by several processes, with a sidecar each and a page."""
