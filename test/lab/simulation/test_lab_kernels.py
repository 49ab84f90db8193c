# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels of the laboratory refuse arrays that they cannot read, and read nothing beyond them."""

from typing import Any

import numpy as np
import pytest

from lidar_outlier_lab import _kernels

GRID, OWNER = np.ones((3, 4)), np.zeros((3, 4), np.int64)
RAYS, DOWN = np.zeros((3, 5)), np.tile([[0.0], [0.0], [-1.0]], (1, 5))
FOUND, FIELDS = np.zeros(5, np.int64), (GRID, GRID, OWNER, GRID[:1])
CALLS: dict[str, tuple[Any, ...]] = {
    'cast_rays': (np.zeros((2, 24)), *np.ones((2, 3, 5, 2)), np.zeros(5), 0.1),
    'view_top': (GRID, OWNER, 1.0, *np.ones((2, 5)), FOUND),
    'descend': (FIELDS, 1.0, 16.0, RAYS, DOWN, np.zeros(5), 0.0, FOUND),
    'strongest': (np.ones((4, 3)), 0.8),
}


@pytest.mark.parametrize('name', CALLS)
def test_arrays_of_another_kind(name: str) -> None:
    """Each array is of one type, of so many dimensions, and without gaps; and fits the others."""
    call, arguments = getattr(_kernels, name), CALLS[name]
    call(*arguments)
    for i, array in enumerate(arguments):
        if not isinstance(array, np.ndarray):
            continue
        for wrong in (array.astype(np.int8), array[None], array.repeat(2, -1)[..., ::2]):
            with pytest.raises(TypeError):
                call(*arguments[:i], wrong, *arguments[i + 1 :])
        if name != 'strongest' and array.size != 2 * 24:
            short = array[:-1].copy()
            with pytest.raises(ValueError, match='must'):
                call(*arguments[:i], short, *arguments[i + 1 :])


def test_landscapes_without_squares() -> None:
    """Two corners each way are the least; positions beyond them, and none, are at the border."""
    nothing, one = np.array([np.nan, np.inf, -np.inf, -9.0, 1e300]), np.zeros(5)
    assert (_kernels.view_top(GRID, OWNER, 1.0, nothing, one, FOUND) == 1.0).all()
    row, owner = GRID[:1].copy(), OWNER[:1].copy()
    with pytest.raises(ValueError, match='two each way'):
        _kernels.view_top(row, owner, 1.0, one, one, FOUND)
    with pytest.raises(ValueError, match='two each way'):
        _kernels.descend((row, row, owner, GRID), *CALLS['descend'][1:])
    with pytest.raises(ValueError, match='a square'):
        _kernels.descend((GRID, GRID, OWNER, np.empty((0, 1))), *CALLS['descend'][1:])
