# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Archives: many recordings or files, by many processes, with a manifest and a page."""
