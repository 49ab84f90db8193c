# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels refuse arrays and numbers that do not fit, whatever Python gives them."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.detectors.alpha_beta_gamma.normal_equations import (
    WEIGHT,
    empty_series,
)
from lidar_outlier_filter.core.detectors.builtin import Quadric
from lidar_outlier_filter.core.detectors.quadric import detector as quadric
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.core.scan_pattern.placed_pattern import OrderedLines

Arguments = tuple[Any, ...]

N, LINES, PAD, WINDOWS = 12, 2, 3, (3, 2, 3, 2, True)
XYZ, NUMBERS, SINGLES = np.ones((N, 3)), np.arange(float(N)), np.ones(N, np.float32)
PLACES, YES, NO = np.arange(N), np.ones(N, np.bool_), np.zeros(N, np.bool_)
COUNTS, BITS, FIRST = np.zeros(N, np.int64), np.zeros(N, np.uint16), np.array([0, 6, N])
BEFORE, AFTER = PLACES - 1, np.append(PLACES[1:], -1)
SERIES = empty_series(PAD, BEFORE, AFTER)
SERIES.row(WEIGHT)[:] = 1.0
EACH, THREE = np.zeros((3, N)), np.zeros((3, 3, N))
POSES, MASK = np.tile([0.0, 0, 0, 0, 0, 0, 1], (2, 1)), np.ones((N, 720))
LINE = OrderedLines(XYZ, np.ones(N), PLACES, FIRST)
CELLS = (FIRST[:-1].copy(), FIRST[1:].copy(), PLACES, *np.ones((4, N), np.float32), NUMBERS)
RETURNS, ANGLES, WHERE = np.ones((LINES, 6, 3)), np.ones((LINES, 6)), np.ones((LINES, 3))
EVEN, STEADY, RANK = np.ones(LINES), np.zeros(LINES, np.int64), np.arange(LINES)
BRIGHT, USUAL, LIMITS = np.ones((2, N), np.float32), np.ones(19, np.float32), np.ones(63)
HOOD = Neighbourhood(np.random.default_rng(0).normal(size=(300, 3)), 5)
INDEX, LEAVES = HOOD.nearest(5).index, _kernels.subtrees(HOOD.tree, 0)
ALL, FOUND, ROWS = np.arange(300), np.zeros(300), np.arange(300, dtype=np.int32)
RULES = quadric._rules(Quadric())

GOOD: dict[str, Arguments] = {
    # The smoother
    'predict_in_tiles': (SERIES.columns, PAD, WINDOWS, THREE),
    'predict_one_by_one': (SERIES.columns, PAD, BEFORE, AFTER, PLACES, PLACES, WINDOWS, THREE),
    'estimate_precision': (EACH, FIRST, 0.1, EACH),
    'score_windows': (THREE, EACH, PLACES, 2.0, True, NUMBERS, NUMBERS),
    'find_worst': (PLACES, np.ones(N), BEFORE, AFTER, 5, NO),
    'unlink_points': (PLACES[:2], BEFORE, AFTER, 5, NO),
    # Points
    'mark_returns': (XYZ, 1e9, YES),
    'sort_by_line': (PLACES, PLACES, 0, PLACES, np.zeros(N + 1, np.int64)),
    'link_lines': (PLACES, FIRST, 1.5, np.zeros(LINES), COUNTS, COUNTS),
    'count_turns': (np.zeros(N), YES, 0.5, 0, (0.0, 0.0, 0.0), COUNTS),
    'find_masked': (XYZ, PLACES, YES, MASK, MASK, 0.1, YES),
    'find_columns': (XYZ, 720, COUNTS, NUMBERS),
    'move_points': (XYZ, PLACES, YES, np.array([0, 99]), POSES, np.zeros(3), np.eye(3), XYZ),
    'add_scores': (1, PLACES, NUMBERS, SINGLES, BITS, BITS),
    # Scan patterns
    'sort_nearly': (LINE, 0, LINES, NUMBERS, NUMBERS),
    'join_shots': (LINE, 0, LINES, NUMBERS, NUMBERS),
    'find_line_copies': (LINE, NUMBERS, SINGLES, PLACES),
    'place_lines': (LINE, NUMBERS, RANK, 0, LINES, CELLS),
    'write_ranges': (XYZ, PLACES, FIRST, WHERE, XYZ, NUMBERS),
    'usual_brightness': (PLACES, SINGLES, SINGLES, 1),
    'compare_brightness': (PLACES, SINGLES, SINGLES, USUAL, LIMITS, 0, N, BRIGHT),
    'write_directions': (LINE, 0, N, NUMBERS, NUMBERS),
    'turning_rate': (NUMBERS, PLACES, FIRST),
    'unwrap_turns': (NUMBERS, PLACES, FIRST, 1.0, 0, LINES, NUMBERS, STEADY),
    'typical_of_lines': (NUMBERS, NUMBERS, FIRST, EVEN, EVEN),
    'spread': (NUMBERS, NUMBERS, 0.0, 0.0),
    'elevations': (NUMBERS, NUMBERS, 0.0, 0.0),
    'times_of_turn': (XYZ,),
    'find_peaks': (PLACES, 1),
    'fit_lines': (RETURNS, ANGLES),
    'off_plane': (RETURNS, ANGLES),
    # Neighbours and surfaces
    'search_nearest': (
        *(HOOD.xyz, HOOD.tree, LEAVES, HOOD.order),
        *(ROWS, np.empty((300, 5), np.int32), np.empty(300, np.bool_)),
    ),
    'sort_leaves': (HOOD.xyz, HOOD.tree, LEAVES, ALL),
    'judge_sections': (HOOD.xyz, np.ones(300), HOOD.tree, np.array([1, 2]), 16, RULES, FOUND),
    'judge_patches': (HOOD.xyz, np.ones(300), INDEX, ALL, ALL, 0, 300, RULES, FOUND),
}
# Arguments, and members of them, of which less may be given: so much less is read.
LISTS = {
    *(('estimate_precision', 1, 0), ('unlink_points', 0, 0), ('find_line_copies', 0, 3)),
    *(('write_directions', 0, 3), ('turning_rate', 2, 0), ('find_peaks', 0, 0)),
    *(('search_nearest', 2, 0), ('sort_leaves', 2, 0), ('judge_sections', 3, 0)),
    *(('judge_sections', 5, 0), ('judge_sections', 5, 1)),
    *(('judge_patches', 7, 0), ('judge_patches', 7, 1)),
}
ROWS_OF = {('write_ranges', 3, 0), ('times_of_turn', 0, 0)}
COLUMNS_OF = {
    *(('predict_in_tiles', 3, 0), ('predict_one_by_one', 0, 0)),
    *(('search_nearest', 5, 0), ('judge_patches', 2, 0)),
}
KINDS: tuple[Callable[[Any], Any], ...] = (
    lambda array: array.astype(np.complex64),
    lambda array: array[np.newaxis],
    lambda array: array.repeat(2, 0)[::2],
    lambda array: array.tolist(),
)
SHORTER: tuple[tuple[Callable[[Any], Any], set[tuple[str, int, int]]], ...] = (
    (lambda array: array[:-1].copy(), LISTS | ROWS_OF),
    (lambda array: array[..., :-1].copy(), LISTS | COLUMNS_OF),
)


def copied(argument: Any) -> Any:
    """Copy arrays, so that nothing is written into what is given."""
    if isinstance(argument, tuple):
        return tuple(map(copied, argument))
    return argument.copy() if isinstance(argument, np.ndarray) else argument


def call(name: str, arguments: Arguments) -> object:
    """Call a kernel on copies."""
    return getattr(_kernels, name)(*copied(arguments))


def variants(name: str, change: Callable[[Any], Any]) -> Iterator[tuple[int, int, Arguments]]:
    """Change one array after the other, members of arguments too; say which it is."""
    good = GOOD[name]
    for i, argument in enumerate(good):
        members = argument if isinstance(argument, tuple) else (argument,)
        for at, array in enumerate(members):
            if isinstance(array, np.ndarray):
                new = change(array)
                if isinstance(argument, tuple):
                    new = (*members[:at], new, *members[at + 1 :])
                yield i, at, (*good[:i], new, *good[i + 1 :])


@pytest.mark.parametrize('name', GOOD)
def test_arrays_of_another_kind_are_refused(name: str) -> None:
    """Nothing is converted: types, dimensions, rows apart, lists, tuples with a member less."""
    call(name, GOOD[name])
    for change in KINDS:
        for *_, arguments in variants(name, change):
            with pytest.raises(TypeError):
                getattr(_kernels, name)(*arguments)
    for i, argument in enumerate(GOOD[name]):
        if isinstance(argument, tuple):
            with pytest.raises(TypeError):
                call(name, (*GOOD[name][:i], tuple(argument)[:-1], *GOOD[name][i + 1 :]))


@pytest.mark.parametrize('name', GOOD)
def test_arrays_that_do_not_fit_together_are_refused(name: str) -> None:
    """An array without its last row, or its last column, does not fit the others."""
    for change, may_be_less in SHORTER:
        for i, at, arguments in variants(name, change):
            if (name, i, at) not in may_be_less:
                with pytest.raises(ValueError, match='must'):
                    call(name, arguments)


@pytest.mark.parametrize(
    ('name', 'argument', 'wrong'),
    [
        ('predict_in_tiles', 1, PAD - 1),
        ('predict_in_tiles', 1, -1),
        ('predict_in_tiles', 1, 2**62),
        ('predict_in_tiles', 2, (PAD + 1, 2, 3, 2, True)),
        ('predict_in_tiles', 2, (3, -1, 3, 2, True)),
        ('predict_in_tiles', 2, (3, 2, 3, 3, True)),
        ('predict_in_tiles', 3, np.zeros((3, 3, 200))),
        ('predict_one_by_one', 1, SERIES.columns.shape[1] - N + 1),
        ('predict_one_by_one', 4, PLACES + 1),
        ('predict_one_by_one', 5, PLACES - 1),
        ('predict_one_by_one', 6, (3, 2, 3, 0, True)),
        ('estimate_precision', 1, np.array([0, 2, N + 1])),
        ('estimate_precision', 1, np.array([-1, 2, N])),
        ('estimate_precision', 1, np.array([0, 2, 1])),
        ('score_windows', 2, PLACES - 1),
        ('find_worst', 0, PLACES + 1),
        ('unlink_points', 0, PLACES[:2] - 1),
        ('sort_by_line', 0, PLACES - 1),
        ('sort_by_line', 0, PLACES + 1),
        ('sort_by_line', 2, 2**62),
        ('sort_by_line', 2, -(2**63)),
        ('link_lines', 1, np.array([0, N + 1, N])),
        ('link_lines', 1, np.array([-1, 3, N])),
        ('link_lines', 1, np.array([0, 3, N + 1])),
        ('move_points', 1, PLACES - 1),
        ('add_scores', 1, PLACES - 1),
        ('add_scores', 1, PLACES + 1),
        ('find_columns', 1, 0),
        ('sort_leaves', 2, np.array([-1])),
        ('sort_leaves', 2, np.array([len(HOOD.tree.child)])),
        ('judge_sections', 2, HOOD.tree._replace(last=HOOD.tree.last + 1)),
        ('judge_sections', 3, np.array([-1])),
        ('judge_sections', 3, np.array([len(HOOD.tree.child)])),
        ('judge_sections', 4, 0),
        ('judge_sections', 5, RULES._replace(critical=np.empty(0))),
        *(('judge_patches', i, ALL + by) for i in (3, 4) for by in (-300, 300)),
        *(('judge_patches', 2, INDEX + np.int32(by)) for by in (-300, 300)),
    ],
)
def test_numbers_that_do_not_fit_are_refused(name: str, argument: int, wrong: object) -> None:
    """What is used as an index lies within its array, and windows stay within the padding."""
    good = GOOD[name]
    with pytest.raises(ValueError, match=r'must|quantiles for any'):
        call(name, (*good[:argument], wrong, *good[argument + 1 :]))


@pytest.mark.parametrize(('begin', 'end'), [(-1, 1), (0, 301), (2, 1)])
@pytest.mark.parametrize(
    ('name', 'at'),
    [
        *(('sort_nearly', 1), ('join_shots', 1), ('place_lines', 3), ('judge_patches', 5)),
        *(('compare_brightness', 5), ('write_directions', 1), ('unwrap_turns', 4)),
    ],
)
def test_ranges(name: str, at: int, begin: int, end: int) -> None:
    """A range beyond the lines, or the points, is refused."""
    with pytest.raises(ValueError, match='begin and end must'):
        call(name, (*GOOD[name][:at], begin, end, *GOOD[name][at + 2 :]))


@pytest.mark.parametrize('bad', [-1, N, 2**62])
def test_indices(bad: int) -> None:
    """Numbers of points and lines that there are not are refused."""
    order, first = PLACES.copy(), FIRST.copy()
    order[3] = first[1] = bad
    named = ('sort_nearly', 'join_shots', 'find_line_copies', 'place_lines', 'write_directions')
    for name in named:
        if name != 'write_directions' and (bad != N or name == 'place_lines'):
            # Else it does without, or the line is one without points.
            with pytest.raises(ValueError, match='must'):
                call(name, (LINE._replace(first=first), *GOOD[name][1:]))
        with pytest.raises(ValueError, match='must'):
            call(name, (LINE._replace(order=order), *GOOD[name][1:]))
    for name in ('usual_brightness', 'compare_brightness') if bad >= N else ():
        with pytest.raises(ValueError, match='cells must be of points'):
            call(name, (order, *GOOD[name][1:]))
    with pytest.raises(ValueError, match='indices must'):
        _kernels.place_lines(LINE, NUMBERS, np.array([0, bad]), 0, LINES, CELLS)
    for name in ('turning_rate', 'unwrap_turns', 'typical_of_lines') if bad != N else ():
        with pytest.raises(ValueError, match='lines must follow'):
            call(name, tuple(first if one is FIRST else one for one in GOOD[name]))


def test_links_in_a_circle_end() -> None:
    """However links are made, a walk takes no more steps than its reach."""
    circle = np.roll(PLACES, 1)
    columns, pad, _, _, *others = GOOD['predict_one_by_one']
    call('predict_one_by_one', (columns, pad, circle, circle, *others))
    call('find_worst', (PLACES, np.ones(N), circle, circle, 10**6, NO))


@pytest.mark.parametrize('name', ['predict_one_by_one', 'find_worst', 'unlink_points'])
def test_links_to_no_point_end_a_segment(name: str) -> None:
    """Whatever number a link has, nothing beyond the points is read or written."""
    nowhere = np.resize([2**62, N, -(2**63), N + 9, -1], N)
    call(name, tuple(nowhere if a is BEFORE or a is AFTER else a for a in GOOD[name]))


def test_points_without_a_number_are_counted_somewhere() -> None:
    """NaN, infinite coordinates and lines without a ring lead nowhere outside of the tables."""
    odd = np.array([[np.nan] * 3, [np.inf] * 3, [-np.inf, np.nan, 0], [1e308] * 3, [0.0] * 3])
    line = np.array([-1, 2**62, -(2**62), 1, 0])
    call('find_columns', (odd, 720, np.zeros(5, np.int64), np.zeros(5)))
    call('find_masked', (odd, line, YES[:5], *GOOD['find_masked'][3:6], YES[:5]))
