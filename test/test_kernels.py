# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Medians in kernels are numpy's."""

import numpy as np
import pytest

from lidar_outlier_filter.core.kernels import median


@pytest.mark.parametrize('count', [*range(1, 34), 100, 101])
def test_medians(count: int) -> None:
    """Of odd and even numbers of values, with and without ties, whatever stands behind them."""
    rng = np.random.default_rng(count)
    for values in (rng.normal(size=count), rng.integers(0, 4, count) / 3, np.full(count, -2.5)):
        assert median(values.copy(), count) == np.median(values)
