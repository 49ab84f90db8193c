# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Each lane of points is sorted by itself."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from lidar_outlier_filter.core import _kernels


@pytest.mark.parametrize('count', [0, 1, 8, 20, 60, 64])
def test_sorts_values_of_any_sign(count: int) -> None:
    """Numbers below 0, 0, ties and infinite ones."""
    rng = np.random.default_rng(count)
    values = rng.choice([-np.inf, -2.5, -0.0, 0.0, 1.5, 1e300, np.inf], (count, _kernels.LANES))
    expected = np.sort(values, axis=0)
    _kernels.sort_lanes(values, 0, count)
    assert_array_equal(values, expected)


@pytest.mark.parametrize('count', [2, 5, 12])
def test_networks_sort_all_zeros_and_ones(count: int) -> None:
    """What sorts these sorts everything (Knuth 5.3.4, theorem Z)."""
    for begin in range(0, 2**count, _kernels.LANES):
        lane = np.arange(begin, begin + _kernels.LANES)
        values = (lane >> np.arange(count)[:, None] & 1).astype(np.float64)
        expected = np.sort(values, axis=0)
        for first, last in ((0, count), (1, 2), (count // 2 - 1, count // 2 + 1)):
            result = values.copy()
            _kernels.sort_lanes(result, first, last)
            assert_array_equal(result[first:last], expected[first:last])


def test_refuses_what_does_not_fit() -> None:
    """Nothing is sorted or read beyond an array."""
    values = np.zeros((4, _kernels.LANES))
    others: list[Any] = [values.astype(np.float32), values[:, ::2], values[0]]
    for wrong in others:
        with pytest.raises(TypeError, match='array of float64'):
            _kernels.sort_lanes(wrong, 0, 1)
    for rows, first, last in ((values, 0, 5), (values, -1, 2), (np.zeros((4, 8)), 0, 4)):
        with pytest.raises(ValueError, match=r'array|LANES'):
            _kernels.sort_lanes(rows, first, last)
    with pytest.raises(ValueError, match='LANES'):
        _kernels.sort_lanes(np.zeros((65, _kernels.LANES)), 0, 65)
