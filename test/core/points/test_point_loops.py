# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The compiled loops over points refuse what does not fit, whatever Python gives them."""

from typing import Any

import numpy as np
import pytest

from lidar_outlier_filter.core import _kernels

N = 5
XYZ, LINE, TIME = np.ones((N, 3)), np.arange(N), np.arange(N)
YES, PLACES = np.ones(N, np.bool_), np.arange(N)
POSES = np.tile([0.0, 0, 0, 0, 0, 0, 1], (2, 1))
MASK = np.ones((2, 720))


def whole(*shape: int) -> Any:
    """Return zeros to write or count in."""
    return np.zeros(shape, np.int64)


GOOD: dict[str, tuple[Any, ...]] = {
    'mark_returns': (XYZ, 1e9, YES),
    'sort_by_line': (LINE, TIME, 0, PLACES, whole(N + 1)),
    'link_lines': (TIME, np.array([0, 3, N]), 1.5, np.zeros(2), whole(N), whole(N)),
    'count_turns': (np.zeros(N), YES, 0.5, 0, (0.0, 0.0, 0.0), whole(N)),
    'find_masked': (XYZ, LINE, YES, MASK, MASK, 0.1, YES),
    'find_columns': (XYZ, 720, whole(N), np.zeros(N)),
    'move_points': (XYZ, TIME, YES, np.array([0, 9]), POSES, np.zeros(3), np.eye(3), XYZ),
    'add_scores': (
        *(1, PLACES, np.zeros(N), np.zeros(N, np.float32)),
        *(np.zeros(N, np.uint16), np.zeros(N, np.uint16)),
    ),
}


def call(name: str, arguments: tuple[Any, ...]) -> object:
    """Call a loop on copies, so that nothing is written into what is given."""
    copies = [a.copy(order='K') if isinstance(a, np.ndarray) else a for a in arguments]
    return getattr(_kernels, name)(*copies)


def arrays_of(name: str) -> list[int]:
    """Return which arguments are arrays."""
    return [i for i, a in enumerate(GOOD[name]) if isinstance(a, np.ndarray)]


@pytest.mark.parametrize('name', GOOD)
def test_arrays_of_another_kind_are_refused(name: str) -> None:
    """Neither another type, nor other dimensions, nor rows apart are converted."""
    call(name, GOOD[name])
    for i in arrays_of(name):
        array = GOOD[name][i]
        apart = np.repeat(array, 2, axis=0)[::2]
        for other in (array.astype(np.float16), array[np.newaxis], apart, array.tolist()):
            with pytest.raises(TypeError):
                getattr(_kernels, name)(*GOOD[name][:i], other, *GOOD[name][i + 1 :])


@pytest.mark.parametrize('name', GOOD)
def test_arrays_that_do_not_fit_together_are_refused(name: str) -> None:
    """An array that is shorter than the others say, or has other columns."""
    for i in arrays_of(name):
        array = GOOD[name][i]
        for other in (array[:-1], array[:, :-1].copy() if array.ndim > 1 else array[:-2]):
            with pytest.raises(ValueError, match='must'):
                call(name, (*GOOD[name][:i], other, *GOOD[name][i + 1 :]))


@pytest.mark.parametrize(
    ('name', 'argument', 'wrong'),
    [
        ('sort_by_line', 0, LINE - 1),
        ('sort_by_line', 0, LINE + 1),
        ('sort_by_line', 2, 2**62),
        ('sort_by_line', 2, -(2**63)),
        ('link_lines', 1, np.array([0, N + 1, N])),
        ('link_lines', 1, np.array([-1, 3, N])),
        ('link_lines', 1, np.array([0, 3, N + 1])),
        ('move_points', 1, TIME - 1),
        ('add_scores', 1, PLACES - 1),
        ('add_scores', 1, PLACES + 1),
        ('find_columns', 1, 0),
    ],
)
def test_numbers_that_are_no_places_are_refused(name: str, argument: int, wrong: object) -> None:
    """What is used as an index lies within its array."""
    good = GOOD[name]
    with pytest.raises(ValueError, match='must'):
        call(name, (*good[:argument], wrong, *good[argument + 1 :]))


def test_points_without_a_number_are_counted_somewhere() -> None:
    """NaN, infinite coordinates and lines without a ring lead nowhere outside of the tables."""
    odd = np.array([[np.nan] * 3, [np.inf] * 3, [-np.inf, np.nan, 0], [1e308] * 3, [0.0] * 3])
    line = np.array([-1, 2**62, -(2**62), 1, 0])
    call('find_columns', (odd, *GOOD['find_columns'][1:]))
    call('find_masked', (odd, line, *GOOD['find_masked'][2:]))
