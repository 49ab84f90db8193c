# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A few layouts of a simulated street: found as in the sensor's own layout, or a sentence."""

from typing import Any

import pytest
from helpers import benchmark

layouts = benchmark('layouts')
LAYOUTS = (
    'rows are columns, x y z i',
    'x y z i in ring order',
    'utm float64',
    'no ring',
    'intensity 0',
    'stamps +- 30 ms',
    'KITTI rows, x y z i',
)
MAX_LESS_FOUND, MAX_MORE_LOST = 3.0, 0.1  # percent


@pytest.fixture(scope='module')
def sweeps() -> Any:
    """Return two sweeps of 16 rings."""
    return layouts.simulated(16, sweeps=2)


@pytest.fixture(scope='module')
def reference(sweeps: Any) -> Any:
    """Judge the sensor's own layout."""
    return layouts.judge(sweeps)


@pytest.mark.parametrize('name', LAYOUTS)
def test_layout(sweeps: Any, reference: Any, name: str) -> None:
    """What is found and lost depends little on the layout."""
    cell = layouts.judge(list(layouts.LAYOUTS[name](sweeps)))
    for found, lost, own_found, own_lost in (
        (cell.found, cell.lost, reference.found, reference.lost),
        (cell.array_found, cell.array_lost, reference.array_found, reference.array_lost),
    ):
        assert found > own_found - MAX_LESS_FOUND
        assert lost < own_lost + MAX_MORE_LOST
    assert 'refused' not in cell.method


def test_two_sensors_are_named(sweeps: Any, reference: Any) -> None:
    """Where sensors share ring numbers, the method says why less is found; it is the first row."""
    cell = layouts.judge(layouts.two(sweeps))
    assert ', because sensors share ring numbers' in cell.method
    cells = {(layouts.REFERENCE, 'a'): reference, ('two', 'a'): cell}
    assert layouts.worst_first(cells).splitlines()[2].startswith('| two | a |')
