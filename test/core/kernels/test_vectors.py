# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Vectors in registers have the bits that loops over single numbers have."""

import numpy as np
import pytest
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Singles
from lidar_outlier_filter.core.kernels.kernels import kernel
from lidar_outlier_filter.core.kernels.vectors import (
    WIDTH,
    count,
    least,
    load,
    most,
    no_counts,
    repeat,
    root,
    select,
    single,
    store,
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
