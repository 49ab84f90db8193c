# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels of scan patterns refuse what is no scan pattern, and read nothing beyond their arrays."""

from typing import Any

import numpy as np
import pytest

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.scan_pattern.placed_pattern import OrderedLines

COUNT, LINES = 12, 2
FIRST = np.array([0, 6, COUNT])
PHASE, SINGLES, T = np.arange(12.0), np.ones(COUNT, np.float32), np.arange(COUNT)
LINE = OrderedLines(np.ones((COUNT, 3)), np.ones(COUNT), np.arange(COUNT), FIRST)
CELLS = (FIRST[:-1].copy(), FIRST[1:].copy(), T.copy(), *np.ones((4, COUNT), np.float32), PHASE)
RETURNS, ANGLES, WHERE = np.ones((LINES, 6, 3)), np.ones((LINES, 6)), np.ones((LINES, 3))
RANK, STEADY = np.arange(LINES), np.zeros(LINES, np.int64)
BRIGHT, USUAL, LIMITS = np.ones((2, COUNT), np.float32), np.ones(19, np.float32), np.ones(63)
CALLS: dict[str, tuple[Any, ...]] = {
    'sort_nearly': (LINE, 0, LINES, PHASE, PHASE),
    'join_shots': (LINE, 0, LINES, PHASE, PHASE),
    'find_line_copies': (LINE, PHASE, SINGLES, T.copy()),
    'place_lines': (LINE, PHASE, RANK, 0, LINES, CELLS),
    'write_ranges': (LINE.xyz, T, FIRST, WHERE, np.zeros((COUNT, 3)), PHASE.copy()),
    'usual_brightness': (T, SINGLES, SINGLES, 1),
    'compare_brightness': (T, SINGLES, SINGLES, USUAL, LIMITS, 0, COUNT, BRIGHT),
    'write_directions': (LINE, 0, COUNT, PHASE.copy(), PHASE.copy()),
    'turning_rate': (PHASE, T, FIRST),
    'unwrap_turns': (PHASE, T, FIRST, 1.0, 0, LINES, PHASE.copy(), STEADY),
    'typical_of_lines': (PHASE, PHASE, FIRST, np.ones(LINES), np.ones(LINES)),
    'spread': (PHASE, PHASE, 0.0, 0.0),
    'elevations': (PHASE, PHASE, 0.0, 0.0),
    'times_of_turn': (LINE.xyz,),
    'find_peaks': (T, 1),
    'fit_lines': (RETURNS, ANGLES),
    'off_plane': (RETURNS, ANGLES),
}
ALONE = {'times_of_turn', 'find_peaks'}  # what takes one array only


def changed(argument: Any, at: int, change: Any) -> Any:
    """Change one array, be it one of a tuple."""
    if not isinstance(argument, tuple):
        return change(argument)
    return (*argument[:at], change(argument[at]), *argument[at + 1 :])


def variants(name: str, change: Any) -> list[tuple[Any, ...]]:
    """Return the arguments of a call with a change of one array each."""
    found = []
    for i, argument in enumerate(CALLS[name]):
        for at, array in enumerate(argument if isinstance(argument, tuple) else (argument,)):
            if isinstance(array, np.ndarray):
                mine = changed(argument, at, change)
                found.append((*CALLS[name][:i], mine, *CALLS[name][i + 1 :]))
    return found


@pytest.mark.parametrize('name', CALLS)
def test_arrays_of_another_kind(name: str) -> None:
    """Each array is of one type, of so many dimensions, and without gaps."""
    call = getattr(_kernels, name)
    call(*CALLS[name])
    for change in (lambda a: a.astype(np.int8), lambda a: a[None], lambda a: a.repeat(2, 0)[::2]):
        for arguments in variants(name, change):
            with pytest.raises(TypeError):
                call(*arguments)


@pytest.mark.parametrize('name', sorted(CALLS.keys() - ALONE))
def test_arrays_that_do_not_fit(name: str) -> None:
    """Without its last row, an array does not fit the others; or it is read no further."""
    refused = 0
    for arguments in variants(name, lambda a: a[:-1].copy()):
        try:
            getattr(_kernels, name)(*arguments)
        except ValueError:
            refused += 1
    assert refused


@pytest.mark.parametrize(('begin', 'end'), [(-1, 1), (0, 13), (2, 1)])
@pytest.mark.parametrize(
    ('name', 'at'),
    [
        *(('sort_nearly', 1), ('join_shots', 1), ('place_lines', 3)),
        *(('compare_brightness', 5), ('write_directions', 1), ('unwrap_turns', 4)),
    ],
)
def test_ranges(name: str, at: int, begin: int, end: int) -> None:
    """A range beyond the lines, or the points, is refused."""
    arguments = *CALLS[name][:at], begin, end, *CALLS[name][at + 2 :]
    with pytest.raises(ValueError, match='begin and end must'):
        getattr(_kernels, name)(*arguments)


@pytest.mark.parametrize('bad', [-1, COUNT, 2**62])
def test_indices(bad: int) -> None:
    """Numbers of points and lines that there are not are refused."""
    order, first = T.copy(), FIRST.copy()
    order[3] = first[1] = bad
    for lines in (LINE._replace(order=order), LINE._replace(first=first)):
        for name in (
            'sort_nearly',
            'join_shots',
            'find_line_copies',
            'place_lines',
            'write_directions',
        ):
            if name == 'write_directions' and lines.first is first:
                continue  # it does without
            if first is lines.first and bad == COUNT and name != 'place_lines':
                continue  # a line without points
            with pytest.raises(ValueError, match='must'):
                getattr(_kernels, name)(lines, *CALLS[name][1:])
    if bad >= COUNT:
        with pytest.raises(ValueError, match='cells must be of points'):
            _kernels.usual_brightness(order, SINGLES, SINGLES, 1)
        with pytest.raises(ValueError, match='cells must be of points'):
            _kernels.compare_brightness(order, *CALLS['compare_brightness'][1:])
    with pytest.raises(ValueError, match='indices must'):
        _kernels.place_lines(LINE, PHASE, np.array([0, bad]), 0, LINES, CELLS)
    for name in ('turning_rate', 'unwrap_turns', 'typical_of_lines'):
        mine = [first + 0 if one is FIRST else one for one in CALLS[name]]
        if bad != COUNT:
            with pytest.raises(ValueError, match='lines must follow'):
                getattr(_kernels, name)(*mine)
