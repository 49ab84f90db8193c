# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the C++ of all rooms shares: the door for arrays, levels, vectors; and threads for it."""
