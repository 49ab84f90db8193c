# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Medians in kernels are numpy's, and Python calls only kernels that it can call."""

from time import process_time

import numpy as np
import pytest
from numpy.typing import NDArray

from lidar_outlier_filter.core.kernels.kernels import (
    device_function,
    kernel,
    median,
    noalias_kernel,
    select,
)


@pytest.mark.parametrize('count', [*range(1, 34), 100, 101])
def test_medians(count: int) -> None:
    """Of odd and even numbers of values, with and without ties, whatever stands behind them."""
    rng = np.random.default_rng(count)
    for values in (rng.normal(size=count), rng.integers(0, 4, count) / 3, np.full(count, -2.5)):
        assert median(values.copy(), count) == np.median(values)


WAVES = {
    'circle': np.abs(np.cos(np.arange(60_000) * (2 * np.pi / 60_000))),
    'up and down': np.minimum(np.arange(60_000), np.arange(60_000)[::-1]).astype(np.float64),
    'teeth': np.arange(60_000) % 300.0,
    'fewer and fewer': 1.0 / np.arange(1, 60_001),
}


@pytest.mark.parametrize('name', WAVES)
def test_waves(name: str) -> None:
    """Any rank of values that rise and fall is found, in about the time of random ones."""
    values = WAVES[name]
    mixed, ordered = np.random.default_rng(1).permutation(values), np.sort(values)
    ranks = np.linspace(0, len(values) - 1, 9).astype(int).tolist()
    for rank in ranks:
        assert select(values.copy(), len(values), rank) == ordered[rank]

    def seconds(given: np.ndarray) -> float:
        begin = process_time()
        for rank in ranks:
            select(given.copy(), len(given), rank)
        return process_time() - begin

    assert min(seconds(values) for _ in range(3)) < 10 * min(seconds(mixed) for _ in range(3))


@device_function
def _double(value: float) -> float:
    return 2.0 * value


@kernel
def _quadruple(value: float) -> float:
    return _double(_double(value))


def test_python_cannot_call_a_device_function() -> None:
    """It has no entry that could be called, and says so, compiled or not."""
    sentence = r'^_double is a device function: only kernels can call it$'
    with pytest.raises(TypeError, match=sentence):
        _double(1.0)
    assert _quadruple(3.0) == 12.0
    with pytest.raises(TypeError, match='_double is a device function'):
        _double(1.0)


@noalias_kernel
def _add_rows(rows: NDArray[np.float32], total: NDArray[np.float32]) -> None:
    for lane in range(len(total)):
        for row in range(len(rows)):
            total[lane] += rows[row, lane]


@kernel
def _sums(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    total = np.zeros(rows.shape[1], np.float32)
    _add_rows(rows[1:], total)
    return total


def test_a_noalias_kernel() -> None:
    """It writes what any other would; Python cannot call it."""
    rows = np.random.default_rng(1).normal(size=(5, 32)).astype(np.float32)
    expected = np.zeros(32, np.float32)
    for row in rows[1:]:
        expected += row
    np.testing.assert_array_equal(_sums(rows), expected)
    with pytest.raises(TypeError, match='_add_rows is a device function'):
        _add_rows(rows, expected)
