# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Medians are numpy's, vectors have the bits of loops, and Python calls only what it can call."""

from time import process_time

import numpy as np
import pytest
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Singles
from lidar_outlier_filter.core.kernels.kernels import (
    device_function,
    kernel,
    median,
    noalias_kernel,
    select,
)
from lidar_outlier_filter.core.kernels.vectors import (
    WIDTH,
    count,
    least,
    load,
    most,
    no_counts,
    repeat,
    root,
    single,
    store,
)
from lidar_outlier_filter.core.kernels.vectors import select as choose

TWO = np.float32(2.0)
SPECIAL = [np.nan, np.inf, -np.inf, 0.0, -0.0, 1e-45, 3.4e38, 1.0, -1.0]


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


@noalias_kernel
def _fill(values: NDArray[np.float32]) -> None:
    values[:] = 1.0


@kernel
def _quadruple(value: float) -> float:
    return _double(_double(value))


def test_python_cannot_call_a_device_function() -> None:
    """It has no entry that could be called, and says so, compiled or not."""
    for _ in range(2):
        with pytest.raises(TypeError, match=r'^_double is a device function: only kernels can'):
            _double(1.0)
        with pytest.raises(TypeError, match='_fill is a device function'):
            _fill(np.zeros(3, np.float32))
        assert _quadruple(3.0) == 12.0


@kernel
def _calculate(a: Singles, b: Singles, wide: NDArray[np.float64], out: Singles) -> None:
    x, y = load(a, 0), load(b, 0)
    counts = count(count(no_counts(), x < y), (x <= TWO) & (y > x))
    rows = (
        *(x + y, x - TWO, TWO * x * y, x / y, abs(x), least(x, y), most(x, y)),
        *(choose(x < y, x, TWO), single(load(wide, 0) - load(wide, WIDTH)), single(counts)),
        *(repeat(TWO), root(abs(x))),
    )
    for row in range(len(rows)):
        store(out, row * WIDTH, rows[row])


@pytest.mark.parametrize('seed', range(20))
def test_each_element_has_the_bits_of_a_loop(seed: int) -> None:
    """Also of NaN, zeros, subnormal and equal numbers."""
    rng = np.random.default_rng(seed)
    some = np.array([*SPECIAL, *rng.normal(size=5)], np.float32)
    a, b = rng.choice(some, (2, WIDTH))
    wide = rng.normal(size=2 * WIDTH) * 1e3
    out = np.empty((12, WIDTH), np.float32)
    _calculate(a, b, wide, out)
    for lane, (x, y) in enumerate(zip(a, b, strict=True)):
        with np.errstate(all='ignore'):
            expected = [
                *(x + y, x - TWO, TWO * x * y, x / y, np.abs(x)),
                *(min(x, y), max(x, y), x if x < y else TWO),
                np.float32(wide[lane] - wide[lane + WIDTH]),
                np.float32(int(x < y) + int(x <= TWO and y > x)),
                *(TWO, np.sqrt(np.abs(x))),
            ]
        for got, number in zip(out[:, lane], expected, strict=True):
            # The sign of NaN is arbitrary.
            same = np.isnan(got) and np.isnan(number)
            assert same or np.float32(got).tobytes() == np.float32(number).tobytes()
