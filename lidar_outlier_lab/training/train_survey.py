# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Train the trees that judge clouds without scan lines, and write their file.

There are two ensembles; the second sees the log-odds of the first. Scenes are in three folds, each
of which is left out once (cross-validation): the second ensemble learns from log-odds of ensembles
that were trained without the scene. The threshold and the figures of the file are of such, too.

Two leaks remain, which can make the figures better than on new scenes: the second ensemble learns
from first log-odds of the other folds, whose ensembles did see the scene; and the threshold is
chosen on the scenes that the figures are measured on.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lidar_outlier_filter.core.detectors.boosted_trees.far_features import MAX_NEIGHBOURS, Far
from lidar_outlier_filter.core.detectors.boosted_trees.neighbour_trees import (
    far_values,
    first_odds,
    near_values,
    neighbours,
)
from lidar_outlier_filter.core.detectors.boosted_trees.trees import (
    NAMES,
    SURVEY_MODEL,
    VERSION,
    add_up,
)
from lidar_outlier_filter.core.neighbours.duplicates import K
from lidar_outlier_filter.core.neighbours.floor import look_around
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.messages.truth import Cause
from lidar_outlier_lab.simulation.scenes.survey_scenes import training_scene
from lidar_outlier_lab.training.folds import learn_in_folds, least_limit, lost_shares
from lidar_outlier_lab.training.learner import Drawn, Trained

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from lidar_outlier_filter.core.annotations import Floats, Ints, Progress, Singles
    from lidar_outlier_filter.core.detectors.boosted_trees.trees import Trees
    from lidar_outlier_filter.core.neighbours.floor import Floor
    from lidar_outlier_lab.simulation.scenes.survey_scenes import SurveyScene

SCENES = 90
FOLDS = 3  # of scenes
ROUNDS = (80, 220)  # trees of both ensembles
DOUBTFUL = -4.5  # first log-odds above which the second ensemble judges a point
GOOD, BAD = (3000, 4000), (400, 1000)  # points of a scene, and of each cause, in both passes
GOOD_COUNTS = 5.0  # how much good points count
# Single points cannot tell them from edges, so they are neither good nor bad.
NEITHER = (Cause.MIXED, Cause.NEAR_SURFACE, Cause.SNOW)
LIMITS = np.arange(-20, 121) / 10.0  # log-odds tried as thresholds
MAX_LOST_SHARE = 1e-4  # share of the good points that may be lost, of the median kind of scene
DIGITS = 6


class _SceneSeen(NamedTuple):
    """A scene as the trees see it, in tree order."""

    name: str
    hood: Neighbourhood
    around: Floor
    cause: Ints


def make_scenes(
    count: int = SCENES, progress: Progress = lambda _done, _total, _what: None
) -> list[SurveyScene]:
    """Simulate so many scenes."""
    found = []
    for seed in range(count):
        progress(seed, count, f'scene {seed + 1} of {count}')
        found.append(training_scene(seed))
    return found


def train_survey(
    scenes: Sequence[SurveyScene],
    about: Mapping[str, Any],
    seed: int = 1,
    rounds: tuple[int, int] = ROUNDS,
    progress: Progress = lambda _done, _total, _what: None,
) -> Trained:
    """Train both ensembles.

    Parameters
    ----------
    scenes : at least as many as folds
    about : description of the training, for the file
    seed : of the points drawn, from 0
    rounds : trees of both ensembles
    progress : is called before every step: how many of how many are done, and of what; it may leave

    Returns
    -------
    Trained
        The same for the same arguments.

    Raises
    ------
    FilterError
        If there are too few scenes, or no point is an outlier.

    """
    if len(scenes) < FOLDS:
        raise FilterError('the training scenes', f'at least {FOLDS}', len(scenes))
    if not any(scene.cause.any() for scene in scenes):
        raise FilterError('the training scenes', 'ones with outliers', 'none')
    seen = [_see(scene) for scene in scenes]
    first, odds = _pass(seen, None, seed, rounds[0], progress)
    again, results = _pass(seen, odds, seed, rounds[1], progress)
    threshold = _choose_threshold(seen, results)
    held_out = _figures(seen, results, odds, threshold)
    data = {
        'version': VERSION,
        **about,
        'seed': seed,
        'uses': [*NAMES[SURVEY_MODEL][1]],
        'scenes': [scene.name for scene in scenes],
        'held_out': held_out,
        'doubtful': DOUBTFUL,
        'threshold': threshold,
        'first': first,
        'again': again,
    }
    return Trained(json.dumps(data, separators=(',', ':')), threshold, held_out)


def _see(scene: SurveyScene) -> _SceneSeen:
    hood = Neighbourhood(scene.xyz, K)
    around = look_around(scene.xyz, np.arange(len(scene.xyz)))
    return _SceneSeen(scene.name, hood, around, scene.cause[hood.order].astype(np.int64))


def _pass(
    scenes: Sequence[_SceneSeen],
    odds: Sequence[Singles] | None,
    seed: int,
    rounds: int,
    progress: Progress,
) -> tuple[dict[str, Any], list[Singles]]:
    """Train one ensemble on all scenes; return the held-out log-odds of each scene, too.

    ``odds`` are the first pass's log-odds of all points of each scene; None: this is the first.
    """
    again = odds is not None
    names = NAMES[SURVEY_MODEL][again]
    steps, done = 2 * (FOLDS + 2), again * (FOLDS + 2)
    progress(done, steps, 'features')
    drawn = [
        _draw(scene, seed, number, None if odds is None else odds[number])
        for number, scene in enumerate(scenes)
    ]
    folds = [_fold(number) for number in range(len(scenes))]

    def judge(number: int, trees: Trees) -> Singles:
        return _judge(scenes[number], trees, None if odds is None else odds[number])

    def show(k: int, text: str) -> None:
        progress(done + 1 + k, steps, text)

    return learn_in_folds(drawn, folds, names, rounds, judge, show, 'scene')


def _fold(number: int) -> int:
    """Return the fold of a scene: kinds take turns within each."""
    return number // 10 % FOLDS if number >= FOLDS else number


def _values(scene: _SceneSeen, which: Ints, odds: Singles | None) -> Singles:
    """Return the features (F, M) of some points in a pass."""
    near = neighbours(scene.hood, scene.around)
    if odds is None:
        return near_values(near, which)
    index = scene.hood.nearest_of(which, min(MAX_NEIGHBOURS, len(scene.hood) - 1))
    return far_values(Far(near, odds, index), which)


def _draw(scene: _SceneSeen, seed: int, number: int, odds: Singles | None) -> Drawn:
    """Draw points: in the second pass, only those that the first does not call clearly good."""
    again = odds is not None
    drawable = np.ones(len(scene.cause), np.bool_) if odds is None else odds > DOUBTFUL
    rng = np.random.default_rng([seed, number, again])
    rows, weights = [np.empty(0, np.int64)], [np.empty(0)]
    for cause in np.setdiff1d(scene.cause[drawable], NEITHER).tolist():
        every = np.flatnonzero(drawable & (scene.cause == cause))
        most = BAD[again] if cause else GOOD[again]
        some = rng.choice(every, min(most, len(every)), replace=False)
        share = len(every) / len(scene.cause)
        # Rare causes count more than their share.
        counts = np.sqrt(share) if cause else GOOD_COUNTS * share
        rows.append(some)
        weights.append(np.full(len(some), counts / max(len(some), 1)))
    row = np.concatenate(rows)
    return Drawn(_values(scene, row, odds), scene.cause[row] > 0, np.concatenate(weights))


def _judge(scene: _SceneSeen, trees: Trees, odds: Singles | None) -> Singles:
    """Return the log-odds of each point in a pass; the second judges only doubtful points anew."""
    if odds is None:
        return first_odds(neighbours(scene.hood, scene.around), trees)
    which, result = np.flatnonzero(odds > DOUBTFUL), odds.copy()
    total = np.empty(len(which), np.float32)
    add_up(trees, _values(scene, which, odds), total)
    result[which] = total
    return result


def _choose_threshold(scenes: Sequence[_SceneSeen], odds: Sequence[Singles]) -> float:
    """Choose the least threshold that leaves good points alone; where none does, the greatest.

    By the median kind of scene: there are kinds where points that are right lie alone.
    """
    kinds: dict[str, list[Floats]] = {}
    for scene, some in zip(scenes, odds, strict=True):
        kinds.setdefault(_kind(scene), []).append(lost_shares(scene.cause, some, LIMITS))
    lost = np.median([np.mean(some, axis=0) for some in kinds.values()], axis=0)
    return least_limit(LIMITS, lost, MAX_LOST_SHARE)


def _kind(scene: _SceneSeen) -> str:
    return scene.name.split()[0]


def _figures(
    scenes: Sequence[_SceneSeen],
    results: Sequence[Singles],
    first: Sequence[Singles],
    threshold: float,
) -> dict[str, Any]:
    """Say what a threshold gives on scenes that were left out: by kind, by cause, and together."""
    kinds: dict[str, Any] = {}
    for kind in sorted({_kind(scene) for scene in scenes}):
        some = [n for n, scene in enumerate(scenes) if _kind(scene) == kind]
        code = np.concatenate([scenes[n].cause for n in some])
        kinds[kind] = _counted(code, np.concatenate([results[n] for n in some]) > threshold)
    code = np.concatenate([scene.cause for scene in scenes])
    counted = ~np.isin(code, NEITHER)
    rejected = (np.concatenate(results) > threshold)[counted]
    doubtful = (np.concatenate(first) > DOUBTFUL)[counted]
    code = code[counted]
    recall = {
        Cause(cause).name.lower(): round(float(rejected[code == cause].mean()), DIGITS)
        for cause in np.unique(code[code > 0]).tolist()
    }
    return {
        **_counted(code, rejected),
        'recall': recall,
        'kinds': kinds,
        'doubtful': round(float(doubtful[code == 0].mean()), DIGITS),
        'clearly_good': round(float(1.0 - doubtful[code > 0].mean()), DIGITS),
    }


def _counted(code: Ints, rejected: NDArray[np.bool_]) -> dict[str, float]:
    counted = ~np.isin(code, NEITHER)
    bad, rejected = code[counted] > 0, rejected[counted]
    both = int((rejected & bad).sum())
    f1 = 2.0 * both / max(int(rejected.sum()) + int(bad.sum()), 1)
    return {
        'f1': round(float(f1), DIGITS),
        'lost': round(float(rejected[~bad].mean()), DIGITS),
    }
