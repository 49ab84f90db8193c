# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The local outlier factor (Breunig, Kriegel, Ng and Sander 2000; Sotoodeh 2006)."""
