# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The compiled loops of the α-β-γ smoother refuse what does not fit."""

from typing import Any

import numpy as np
import pytest

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.detectors.alpha_beta_gamma.normal_equations import (
    WEIGHT,
    empty_series,
)

N, PAD, WINDOWS = 5, 3, (3, 2, 3, 2, True)
BEFORE = np.arange(N) - 1
AFTER = np.array([1, 2, 3, 4, -1])
SERIES = empty_series(PAD, BEFORE, AFTER)
SERIES.row(WEIGHT)[:] = 1.0
PLACES, FLAGS, EACH = np.arange(N), np.zeros(N, np.bool_), np.zeros((3, N))
THREE = np.zeros((3, 3, N))

GOOD: dict[str, tuple[Any, ...]] = {
    'predict_in_tiles': (SERIES.columns, PAD, WINDOWS, THREE),
    'predict_one_by_one': (SERIES.columns, PAD, BEFORE, AFTER, PLACES, PLACES, WINDOWS, THREE),
    'find_near_ends': (BEFORE, AFTER, 3, 2),
    'estimate_precision': (EACH, np.array([0, 2, N]), 0.1, EACH),
    'score_windows': (THREE, EACH, PLACES, 2.0, True, np.zeros(N), np.zeros(N)),
    'find_worst': (PLACES, np.ones(N), BEFORE, AFTER, 5, FLAGS),
    'unlink_points': (PLACES[:2], BEFORE, AFTER, 5, FLAGS),
}


def call(name: str, arguments: tuple[Any, ...]) -> object:
    """Call a loop on copies, so that nothing is written into what is given."""
    return getattr(_kernels, name)(
        *(a.copy() if isinstance(a, np.ndarray) else a for a in arguments)
    )


@pytest.mark.parametrize('name', GOOD)
def test_arrays_of_another_kind_are_refused(name: str) -> None:
    """Nothing is converted."""
    good = GOOD[name]
    call(name, good)
    for i, array in enumerate(good):
        if isinstance(array, np.ndarray):
            for other in (array.astype(np.float16), array[np.newaxis], array.tolist()):
                with pytest.raises(TypeError):
                    call(name, (*good[:i], other, *good[i + 1 :]))


@pytest.mark.parametrize(
    ('name', 'argument', 'wrong'),
    [
        ('predict_in_tiles', 0, SERIES.columns[:5].copy()),
        ('predict_in_tiles', 0, SERIES.columns[:, :-1].copy()),
        ('predict_in_tiles', 1, PAD - 1),
        ('predict_in_tiles', 1, -1),
        ('predict_in_tiles', 1, 2**62),
        ('predict_in_tiles', 2, (PAD + 1, 2, 3, 2, True)),
        ('predict_in_tiles', 2, (3, -1, 3, 2, True)),
        ('predict_in_tiles', 2, (3, 2, 3, 3, True)),
        ('predict_in_tiles', 3, THREE[:2]),
        ('predict_in_tiles', 3, np.zeros((3, 3, 200))),
        ('predict_one_by_one', 1, SERIES.columns.shape[1] - N + 1),
        ('predict_one_by_one', 2, BEFORE[1:]),
        ('predict_one_by_one', 4, PLACES + 1),
        ('predict_one_by_one', 4, PLACES[1:]),
        ('predict_one_by_one', 5, PLACES - 1),
        ('predict_one_by_one', 6, (3, 2, 3, 0, True)),
        ('predict_one_by_one', 7, THREE[:, :, 1:]),
        ('find_near_ends', 0, BEFORE[1:]),
        ('estimate_precision', 0, EACH[:2]),
        ('estimate_precision', 1, np.array([0, 2, N + 1])),
        ('estimate_precision', 1, np.array([-1, 2, N])),
        ('estimate_precision', 1, np.array([0, 2, 1])),
        ('score_windows', 0, THREE[:, :, 1:]),
        ('score_windows', 1, EACH[:, 1:]),
        ('score_windows', 2, PLACES - 1),
        ('score_windows', 5, np.zeros(N - 1)),
        ('find_worst', 0, PLACES + 1),
        ('find_worst', 1, np.ones(N - 1)),
        ('find_worst', 5, FLAGS[1:]),
        ('unlink_points', 0, PLACES[:2] - 1),
        ('unlink_points', 4, FLAGS[1:]),
    ],
)
def test_what_does_not_fit_is_refused(name: str, argument: int, wrong: object) -> None:
    """Shapes belong together, windows stay within the padding, and points are there."""
    good = GOOD[name]
    with pytest.raises(ValueError, match='must'):
        call(name, (*good[:argument], wrong, *good[argument + 1 :]))


def test_links_in_a_circle_end() -> None:
    """However links are made, a walk takes no more steps than its reach."""
    circle = np.roll(PLACES, 1)
    columns, pad, _, _, *others = GOOD['predict_one_by_one']
    call('predict_one_by_one', (columns, pad, circle, circle, *others))
    call('find_worst', (PLACES, np.ones(N), circle, circle, 10**6, FLAGS))
    assert call('find_near_ends', (circle, circle, 3, 2)) is not None


@pytest.mark.parametrize('name', ['predict_one_by_one', 'find_worst', 'unlink_points'])
def test_links_to_no_point_end_a_segment(name: str) -> None:
    """Whatever number a link has, nothing beyond the points is read or written."""
    nowhere = np.array([2**62, N, -(2**63), N + 9, -1])
    call(name, tuple(nowhere if a is BEFORE or a is AFTER else a for a in GOOD[name]))
