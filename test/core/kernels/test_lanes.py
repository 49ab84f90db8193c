# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Points in lanes: each lane is sorted by itself, and each requested point has its turn."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from lidar_outlier_filter.core.kernels import lanes


@pytest.mark.parametrize('count', [1, 8, 20, 60])
def test_sorts_values_of_any_sign(count: int) -> None:
    """Numbers below 0, 0, ties and infinite ones."""
    rng = np.random.default_rng(count)
    values = rng.choice([-np.inf, -2.5, -0.0, 0.0, 1.5, 1e300, np.inf], (count, lanes.LANES))
    expected = np.sort(values, axis=0)
    lanes.sort_signed(values, lanes.network(count, range(count)))
    np.testing.assert_array_equal(values, expected)


@pytest.mark.parametrize('count', [2, 5, 12])
def test_networks_sort_all_zeros_and_ones(count: int) -> None:
    """What sorts these sorts everything (Knuth 5.3.4, theorem Z)."""
    lane = np.arange(2**count)
    values = (lane >> np.arange(count)[:, None] & 1).astype(np.float64)
    expected = np.sort(values, axis=0)
    for selected in (range(count), range(1, 2), range(count // 2 - 1, count // 2 + 1)):
        result = values.copy()
        lanes.sort(result, lanes.network(count, selected))
        assert_array_equal(result[selected], expected[selected])


@pytest.mark.parametrize('share', [0.0, 0.1, 1.0])
@pytest.mark.parametrize('size', [1, 4, 32])
def test_fills_lanes_with_requested_points(share: float, size: int) -> None:
    """Each requested point once, in order; lanes that are left over repeat the last."""
    selected = np.random.default_rng(7).random(150) < share
    begin, end, seen = 3, 141, []
    points = np.empty(size, np.int64)
    while begin < end:
        count, begin = lanes.next_batch(points, selected, begin, end)
        seen += points[:count].tolist()
        assert_array_equal(points[count:], seen[-1:] * (size - count) if count else points)
    assert seen == [i for i in range(3, 141) if selected[i]]
