# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The smallest of some distances are found as by sorting them all."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.neighbours import smallest


def some(kind: str, count: int, rng: np.random.Generator) -> Floats:
    """Make distances, padded with inf."""
    values: Floats = {
        'different': rng.uniform(size=count),
        'wide': 10.0 ** rng.uniform(-300, 300, count),
        'tied': rng.integers(0, 9, count).astype(np.float64),
        'equal': np.full(count, 4.0),
        'zero': np.zeros(count),
    }[kind]
    return np.append(values, np.full(smallest.padded(count) - count, np.inf))


@pytest.mark.parametrize('kind', ['different', 'wide', 'tied', 'equal', 'zero'])
@pytest.mark.parametrize('count', [2, 17, 64, 300])
@pytest.mark.parametrize('k', [1, 16, 63, 200])
@pytest.mark.parametrize('guess', [0.0, 0.3, 1e9])
def test_few_hold_the_smallest(kind: str, count: int, k: int, guess: float) -> None:
    """At least k, none missing that is as small as another; without ties not many more."""
    k = min(k, count - 1)
    rng = np.random.default_rng(count + k)
    distance = some(kind, count, rng)
    index, order = rng.permutation(count), rng.permutation(count)
    few, few_index = np.empty(len(distance) + 4), np.empty(len(distance) + 4, np.int64)
    best, best_index = np.empty_like(few), np.empty_like(few_index)
    upper = distance[:count].max()
    limit = smallest.tighten(distance, len(distance), k, guess, upper, count)
    assert smallest.count_up_to(distance, len(distance), limit) == np.count_nonzero(
        distance <= limit
    )
    chosen = smallest.choose(distance, index, count, limit, few, few_index)
    assert chosen == np.count_nonzero(distance <= limit)
    assert chosen >= k
    if kind == 'different':
        assert chosen <= k + smallest.SURPLUS
    smallest.sort(order, few, few_index, chosen, best, best_index)
    expected = np.lexsort((order[index], distance[:count]))
    assert_array_equal(best[:k], distance[expected[:k]])
    assert_array_equal(best_index[:chosen], index[expected[:chosen]])


def test_padding_makes_whole_strokes() -> None:
    """Nothing needs none."""
    assert [smallest.padded(count) for count in (0, 1, 16, 17)] == [0, 16, 16, 32]


@pytest.mark.parametrize('limit', [0.0, 0.2, 0.5])
def test_enough_is_further_but_not_much(limit: float) -> None:
    """Of distances 0.6 to 0.99 twenty at least are up to it, and those at inf do not count."""
    distance = np.random.default_rng(3).permutation(np.linspace(0.6, 0.99, 40))
    distance[:5] = np.inf
    found = smallest.enough(distance, len(distance), 20, limit)
    assert found > limit
    assert 20 <= np.count_nonzero(distance <= found) <= 20 + smallest.SURPLUS
