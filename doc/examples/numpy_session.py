# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0

import numpy as np

from lidar_outlier_filter import detect_outliers

xyz = np.random.default_rng(1).uniform((-20, -20, 0), (20, 20, 0.02), (5000, 3))  # a floor, m
xyz[77] = 1, 2, 3  # a lone point above it
verdict = detect_outliers(xyz, chain=['lof'], parameters={'lof.threshold': 2})  # rejects it
cleaned, outliers = xyz[~verdict.outlier], xyz[verdict.outlier]
