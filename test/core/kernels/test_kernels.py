# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Medians are those of numpy."""

from time import process_time

import numpy as np
import pytest

from lidar_outlier_filter.core._kernels import median


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
    """Values that rise and fall take about the time of random ones, however many there are."""
    values = WAVES[name]
    mixed = np.random.default_rng(1).permutation(values)
    counts = np.linspace(1, len(values), 9).astype(int).tolist()
    for count in counts:
        assert median(values.copy(), count) == np.median(values[:count])

    def seconds(given: np.ndarray) -> float:
        begin = process_time()
        for count in counts:
            median(given.copy(), count)
        return process_time() - begin

    assert min(seconds(values) for _ in range(3)) < 10 * min(seconds(mixed) for _ in range(3))
