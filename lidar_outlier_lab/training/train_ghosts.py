# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Add trees on ghosts alone to the model of spinning sensors.

They judge points behind nearer ones that the ensembles of :mod:`.train` doubt and keep. Good are
all points that are no outliers, those of weather too. Sensors are left out in folds, each once, for
the threshold and the figures.
"""

import json
import zlib
from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats, Progress, Singles
from lidar_outlier_filter.core.detectors.boosted_trees.pattern_trees import (
    find_mirrored,
    first_pass,
    second_pass,
)
from lidar_outlier_filter.core.detectors.boosted_trees.trees import (
    OF_GHOSTS,
    PATTERN_MODEL,
    TreeModel,
    find_valleys,
    parse,
    read_trees,
)
from lidar_outlier_filter.core.detectors.boosted_trees.window import prepare
from lidar_outlier_lab.simulation.weather.kinds import WEATHERS
from lidar_outlier_lab.training.held_out import CLEAN, STREET
from lidar_outlier_lab.training.learner import Drawn, draw_rows, judge_pass, learn
from lidar_outlier_lab.training.train import Sweep, pattern_of

GHOSTS = 'ghosts'  # the kind of sweeps
# Mixed pixels of recordings are unlabelled in all of them, and are no ghosts.
KINDS = {CLEAN, STREET, *WEATHERS} - {'mixed'}
# With intensities or without; `share` would tell how many outliers the training had.
USED = [name for name in OF_GHOSTS if name not in {'bright', 'rank', 'share'}]
ROWS = [OF_GHOSTS.index(name) for name in USED]
ROUNDS, FOLDS = 100, 4  # trees, and parts of the sensors
GOOD, BAD = 4000, 1500  # points of a sweep that are drawn
GOOD_COUNTS = 0.05  # how much good points count, of which there are many more
MAX_SHARE = 0.02  # ghosts of a sweep count as if they were at most so many of its points
MIN_GHOSTS = 30  # of a sweep, for training and figures
MOST_LOST = 5e-5  # of the good points of clean sweeps, mean of sensors that were left out
LIMITS = np.arange(-30, 81) / 10.0


class _Kept(NamedTuple):
    """The points of a sweep that are doubted and kept: features (F, N), and which are outliers."""

    sweep: Sweep
    values: Singles
    outlier: Bools
    good: int  # points of the whole sweep
    bad: int
    found: int  # of the bad, by both ensembles


def add_ghosts(
    sweeps: Sequence[Sweep],
    text: str,
    progress: Progress = lambda _done, _total, _what: None,
) -> str:
    """Add the trees to a model's text, with a threshold that its own holds for, too.

    Where too few sensors have ghosts that are doubted, and good points, the model stays as it is.
    """
    progress(0, 1, 'ghosts alone')
    data = json.loads(text)
    model, some = parse(data, PATTERN_MODEL), [one for one in sweeps if one.kind in KINDS]
    seen = [_see(one, model) for one in some]
    seen = [one for one in seen if one.sweep.kind != GHOSTS or one.bad >= MIN_GHOSTS]
    if not all(_can_train(others) for _, others in _folds(seen)):
        return text
    limit, data['held_out']['ghosts'] = _held_out(seen)
    data['ghosts'] = learn([_draw(one) for one in seen], USED, ROUNDS)
    data['ghosts']['start'] += model.threshold - limit
    return json.dumps(data, separators=(',', ':'))


def _folds(seen: Sequence[_Kept]) -> Iterator[tuple[list[_Kept], list[_Kept]]]:
    """Return the sweeps of some sensors, and those of all others; each sensor comes once."""
    sensors = list(dict.fromkeys(one.sweep.sensor for one in seen))
    for k in range(FOLDS):
        fold = sensors[k::FOLDS]
        yield (
            [one for one in seen if one.sweep.sensor in fold],
            [one for one in seen if one.sweep.sensor not in fold],
        )


def _can_train(seen: Sequence[_Kept]) -> bool:
    ghosts = any(one.outlier.any() for one in seen if one.sweep.kind == GHOSTS)
    return ghosts and any(not one.outlier.all() for one in seen)


def _see(sweep: Sweep, model: TreeModel) -> _Kept:
    pattern = pattern_of(sweep)
    prepared, there = prepare(pattern), pattern.order >= 0
    first = first_pass(prepared, model.first)
    odds = second_pass(prepared, first, model)
    (own,) = find_valleys(odds[there], np.array([model.threshold]), model.drop)
    places, values = find_mirrored(prepared, first, odds <= own)
    outlier = np.zeros(len(there), np.bool_)
    outlier[there] = sweep.outlier[pattern.order[there]]
    bad, found = int(outlier.sum()), int((outlier & (odds > own)).sum())
    good = int(there.sum()) - bad
    return _Kept(sweep, values[ROWS], outlier[places], good, bad, found)


def _draw(seen: _Kept) -> Drawn:
    """Draw points that count as many as there are; outliers of other causes are left out."""
    rng = np.random.default_rng(zlib.crc32(seen.sweep.name.encode()))
    bad, points = np.flatnonzero(seen.outlier & (seen.sweep.kind == GHOSTS)), seen.good + seen.bad
    share = min(1.0, MAX_SHARE * points / max(seen.bad, 1))
    good = np.flatnonzero(~seen.outlier)
    of_good, of_bad = GOOD_COUNTS * len(good) / points, share * len(bad) / points
    rows, weight = draw_rows(rng, ((good, GOOD, of_good), (bad, BAD, of_bad)))
    return Drawn(seen.values[:, rows], seen.outlier[rows], weight)


def _held_out(seen: Sequence[_Kept]) -> tuple[float, dict[str, float]]:
    """Choose the threshold; return what is found and lost more by it, means of the sensors."""
    before = defaultdict[str, list[float]](list)
    found, lost = (defaultdict[str, list[Floats]](list) for _ in range(2))
    for fold, others in _folds(seen):
        trees = read_trees(learn([_draw(one) for one in others], USED, ROUNDS), tuple(USED))
        for one in fold:
            above = judge_pass(trees, one.values, None) > LIMITS[:, None]
            if one.sweep.kind == CLEAN:
                lost[one.sweep.sensor].append(above.sum(axis=1) / one.good)
            elif one.sweep.kind == GHOSTS:
                more = (above & one.outlier).sum(axis=1)
                before[one.sweep.sensor].append(one.found / one.bad)
                found[one.sweep.sensor].append((one.found + more) / one.bad)
    mean = [[np.mean(some, axis=0) for some in each.values()] for each in (found, lost)]
    at = int(np.flatnonzero(np.mean(mean[1], axis=0) <= MOST_LOST)[0])
    figures = {
        'found_before': np.mean([np.mean(some) for some in before.values()]),
        'found': np.mean(mean[0], axis=0)[at],
        'lost': np.mean(mean[1], axis=0)[at],
        'worst': np.max(mean[1], axis=0)[at],
    }
    return float(LIMITS[at]), {name: round(float(value), 6) for name, value in figures.items()}
