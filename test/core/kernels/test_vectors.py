# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Vectors in registers have the bits that loops over single numbers have."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Ints, Singles
from lidar_outlier_filter.core.kernels.kernels import kernel
from lidar_outlier_filter.core.kernels.vectors import (
    WIDTH,
    count,
    follow,
    least,
    load,
    most,
    no_counts,
    repeat,
    select,
    single,
    store,
    take,
)

TWO = np.float32(2.0)
SPECIAL = [np.nan, np.inf, -np.inf, 0.0, -0.0, 1e-45, 3.4e38, 1.0, -1.0]


@kernel
def _calculate(a: Singles, b: Singles, wide: NDArray[np.float64], out: Singles) -> None:
    x, y = load(a, 0), load(b, 0)
    counts = count(count(no_counts(), x < y), (x <= TWO) & (y > x))
    rows = (
        *(x + y, x - TWO, TWO * x * y, x / y, abs(x), least(x, y), most(x, y)),
        *(select(x < y, x, TWO), single(load(wide, 0) - load(wide, WIDTH)), single(counts)),
        repeat(TWO),
    )
    for row in range(len(rows)):
        store(out, row * WIDTH, rows[row])


@kernel
def _take(values: Singles, places: Ints, off: int, out: Singles) -> bool:
    in_step = follow(load(places, 0))
    store(out, 0, take(values, places, 0, off, in_step))
    return in_step


@pytest.mark.parametrize('seed', range(20))
def test_each_element_has_the_bits_of_a_loop(seed: int) -> None:
    """Of numbers that are none, have no sign, are subnormal or the same, too."""
    rng = np.random.default_rng(seed)
    some = np.array([*SPECIAL, *rng.normal(size=5)], np.float32)
    a, b = rng.choice(some, (2, WIDTH))
    wide = rng.normal(size=2 * WIDTH) * 1e3
    out = np.empty((11, WIDTH), np.float32)
    _calculate(a, b, wide, out)
    for lane, (x, y) in enumerate(zip(a, b, strict=True)):
        with np.errstate(all='ignore'):
            expected = [
                *(x + y, x - TWO, TWO * x * y, x / y, np.abs(x)),
                *(min(x, y), max(x, y), x if x < y else TWO),
                np.float32(wide[lane] - wide[lane + WIDTH]),
                np.float32(int(x < y) + int(x <= TWO and y > x)),
                TWO,
            ]
        for got, number in zip(out[:, lane], expected, strict=True):
            # A number that is none has any sign.
            same = np.isnan(got) and np.isnan(number)
            assert same or np.float32(got).tobytes() == np.float32(number).tobytes()


@pytest.mark.parametrize('kind', [np.int32, np.int64])
def test_values_are_taken_wherever_they_are(kind: type) -> None:
    """Together where places follow each other, else one by one; as numpy does."""
    values, out = np.arange(100, dtype=np.float32), np.empty(WIDTH, np.float32)
    for places in (np.arange(30, 30 + WIDTH), np.arange(60, 60 - WIDTH, -1), np.full(WIDTH, 50)):
        in_step = _take(values, places.astype(kind), -5, out)
        assert in_step == (places[1] == places[0] + 1)
        assert_array_equal(out, values[places - 5])
    almost = np.arange(30, 30 + WIDTH)
    almost[-1] += 1
    assert not _take(values, almost.astype(kind), 3, out)
    assert_array_equal(out, values[almost + 3])
