# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes in folds, each of which is left out once, and a threshold that loses few good points."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from lidar_outlier_filter.core.detectors.boosted_trees.trees import read_trees
from lidar_outlier_lab.training.learner import learn

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from lidar_outlier_filter.core.annotations import Floats, Ints, Singles
    from lidar_outlier_filter.core.detectors.boosted_trees.trees import Trees
    from lidar_outlier_lab.training.learner import Drawn

Result = TypeVar('Result')


def learn_in_folds(  # noqa: PLR0913  scenes, and how each step of them goes
    drawn: Sequence[Drawn],
    folds: Sequence[int],
    names: tuple[str, ...],
    rounds: int,
    judge: Callable[[int, Trees], Result],
    progress: Callable[[int, str], object],
    what: str,
) -> tuple[dict[str, Any], list[Result]]:
    """Learn an ensemble from all scenes, and judge each scene by trees that never saw its fold.

    Parameters
    ----------
    drawn, folds : the points of each scene that train, and its fold, from 0
    names : of the features
    rounds : trees of an ensemble
    judge : judges the scene of a number by these trees
    progress : is called before every step, with its number and what it is; it may leave
    what : one scene, for people

    Returns
    -------
    The ensemble as its file has it, and what ``judge`` gave of each scene.

    """
    count = max(folds) + 1
    results: dict[int, Result] = {}
    for k in range(count):
        progress(k, f'without fold {k + 1} of {count}')
        some = [one for one, fold in zip(drawn, folds, strict=True) if fold != k]
        trees = read_trees(learn(some, names, rounds), names)
        results |= {number: judge(number, trees) for number, fold in enumerate(folds) if fold == k}
    progress(count, f'with every {what}')
    return learn(drawn, names, rounds), [results[number] for number in range(len(folds))]


def lost_shares(cause: Ints, odds: Singles, limits: Floats) -> Floats:
    """Return the share of a scene's good points, of cause 0, that each limit would lose."""
    good = np.sort(odds[cause == 0])
    count = len(good) - np.searchsorted(good, limits, 'right')
    share: Floats = count / max(len(good), 1)
    return share


def least_limit(limits: Floats, lost: Floats, most: float) -> float:
    """Choose the least limit that loses at most such a share; where none does, the greatest."""
    allowed = np.flatnonzero(lost <= most)
    return float(limits[allowed[0]] if len(allowed) else limits[-1])
