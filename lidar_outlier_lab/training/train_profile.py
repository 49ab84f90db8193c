# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Train the trees that judge profile scanners on simulated streets, and write their file.

As for spinning sensors, there are two ensembles, and the second sees the results of the first.
Streets are in three folds, each of which is left out once: what the second ensemble sees of a
street is what a first one says that never saw it. The threshold and the figures of the file are of
ensembles, too, that never saw the street.

So the trees that judge a street never saw it. But first results of the other folds, which their
second ensemble learns from, are of ensembles that did; and the threshold is chosen on the streets
that the figures are of. Both can make the figures better than those of a street never seen.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lidar_outlier_filter.core.detectors.boosted_trees.features import PROFILE, SECOND_PASS, WINDOW
from lidar_outlier_filter.core.detectors.boosted_trees.pattern_trees import (
    FoundPattern,
    prepare_all,
)
from lidar_outlier_filter.core.detectors.boosted_trees.trees import VERSION
from lidar_outlier_filter.core.points.points import SECOND, Points
from lidar_outlier_filter.core.scan_pattern.profile_pattern import find_profile_pattern
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.messages.truth import Cause
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_lab.simulation.scenes.profile_streets import training_street
from lidar_outlier_lab.simulation.world.drive import simulate
from lidar_outlier_lab.training.folds import learn_in_folds, least_limit, lost_shares
from lidar_outlier_lab.training.learner import (
    Drawn,
    Trained,
    judge_pass,
    window_features,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from lidar_outlier_filter.core.annotations import Ints, Progress, Singles
    from lidar_outlier_filter.core.detectors.boosted_trees.trees import Trees
    from lidar_outlier_filter.core.detectors.boosted_trees.window import Prepared
    from lidar_outlier_lab.simulation.world.drive import Drive

STREETS = 64
FOLDS = 3  # of streets
ROUNDS = (100, 120)  # trees of both ensembles
LEARN_FROM = -3.0  # log-odds of the first from which on points train the second
DOUBTFUL = -1.0  # first log-odds above which the second ensemble judges a point
GOOD, BAD = (4000, 8000), (400, 1000)  # points of a street, and of each cause, in both passes
GOOD_COUNTS = 5.0  # how much good points count
BAD_COUNTS = {Cause.MIXED: 0.5, Cause.BARRIER: 2.0}  # and outliers of a cause; 1 for others
LIMITS = np.arange(0, 61) / 10.0  # log-odds tried as thresholds
MAX_LOST_SHARE = 2.5e-5  # share of the good points that may be lost, of the median street
MEASURED = [*WINDOW].index('bright')  # features of the window: these scanners need no intensities
NAMES = (*[*WINDOW][:MEASURED], *PROFILE)
MIN_BLOCK_POINTS = 1000  # points of a block, fewer are left out
DIGITS = 6


class Street(NamedTuple):
    """Points of a drive, in order of their times, and why each is where it is.

    ``code`` is of :class:`Cause`.
    """

    name: str
    points: Points
    code: Ints


class _Block(NamedTuple):
    """What is judged together: its pattern, and which points are not of its halo (P,)."""

    prepared: Prepared
    own: NDArray[np.bool_]
    code: Ints


def make_streets(
    count: int = STREETS, progress: Progress = lambda _done, _total, _what: None
) -> list[Street]:
    """Simulate so many streets."""
    found = []
    for seed in range(count):
        progress(seed, count, f'street {seed + 1} of {count}')
        found.append(measured(f'profile street {seed}', training_street(seed)))
    return found


def measured(name: str, drive: Drive) -> Street:
    """Simulate a drive whose scanner numbers its lines."""
    parts = list(simulate(drive))
    shot = np.concatenate([returns.shot for _, returns in parts])
    points = np.concatenate([returns.points for _, returns in parts])
    xyz = np.stack([points[axis] for axis in 'xyz'], axis=1).astype(np.float64)
    line = points['line'].astype(np.int64)
    seen = Points(xyz, shot * drive.sensor.interval, line, np.ones(len(shot), np.bool_))
    return Street(name, seen, points['label'].astype(np.int64))


def train_profile(
    streets: Sequence[Street],
    about: Mapping[str, Any],
    seed: int = 1,
    rounds: tuple[int, int] = ROUNDS,
    progress: Progress = lambda _done, _total, _what: None,
) -> Trained:
    """Train both ensembles.

    Parameters
    ----------
    streets : at least as many as folds
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
        If there are too few streets, or no point is an outlier.

    """
    if len(streets) < FOLDS:
        raise FilterError('the training streets', f'at least {FOLDS}', len(streets))
    if not any(street.code.any() for street in streets):
        raise FilterError('the training streets', 'ones with outliers', 'none')
    first, odds = _pass(streets, None, seed, rounds[0], progress)
    again, results = _pass(streets, odds, seed, rounds[1], progress)
    code = [np.concatenate([b.code[b.own] for b in _blocks(street)]) for street in streets]
    threshold = _choose_threshold(code, results)
    held_out = _figures(code, results, threshold)
    data = {
        'version': VERSION,
        **about,
        'seed': seed,
        'uses': [*NAMES, *SECOND_PASS],
        'streets': [street.name for street in streets],
        'held_out': held_out,
        'doubtful': DOUBTFUL,
        'threshold': threshold,
        'first': first,
        'again': again,
    }
    return Trained(json.dumps(data, separators=(',', ':')), threshold, held_out)


def _pass(
    streets: Sequence[Street],
    odds: Sequence[list[Singles]] | None,
    seed: int,
    rounds: int,
    progress: Progress,
) -> tuple[dict[str, Any], Any]:
    """Train one ensemble on all streets; return the held-out log-odds of each street, too.

    ``odds`` are the first pass's log-odds of all points of each block; None: this is the first,
    which returns the same. The second returns the log-odds of each street's points.
    """
    again = odds is not None
    names = (*NAMES, *(SECOND_PASS if again else ()))
    steps, done = 2 * (FOLDS + 2), again * (FOLDS + 2)
    progress(done, steps, 'features')
    drawn = [
        _draw(street, seed, number, None if odds is None else odds[number])
        for number, street in enumerate(streets)
    ]
    folds = [number % FOLDS for number in range(len(streets))]

    def judge(number: int, trees: Trees) -> Any:
        found = list(_judge(streets[number], trees, None if odds is None else odds[number]))
        return np.concatenate([r[b] for r, b in found]) if again else [r for r, _ in found]

    def show(k: int, text: str) -> None:
        progress(done + 1 + k, steps, text)

    return learn_in_folds(drawn, folds, names, rounds, judge, show, 'street')


def _blocks(street: Street) -> Iterator[_Block]:
    """Cut a street as the filter does; stretches without a pattern are left out.

    Every step does so anew, to save memory: 100 000 points take 10 MB.
    """
    parameters = FilterParameters()
    block, halo = round(parameters.block * SECOND), round(parameters.halo * SECOND)
    t = street.points.t
    for begin in range(0, int(t[-1]) + 1, block):
        low, high = np.searchsorted(t, (begin - halo, begin + block + halo))
        if high - low < MIN_BLOCK_POINTS:
            continue
        pattern = find_profile_pattern(street.points.take(slice(int(low), int(high))))
        if pattern is None:
            continue
        prepared = prepare_all(FoundPattern(pattern, profile=True))
        order = low + pattern.order[pattern.order >= 0]
        own = (t[order] >= begin) & (t[order] < begin + block)
        yield _Block(prepared, own, street.code[order])


def _values(block: _Block, odds: Singles | None) -> Singles:
    """Return the features (F, P) of a pass."""
    values = window_features(block.prepared, odds)
    return np.concatenate([values[:MEASURED], values[len(WINDOW) :]])


def _draw(street: Street, seed: int, number: int, odds: list[Singles] | None) -> Drawn:
    """Draw points: in the second pass, only those that the first does not call clearly good."""
    again = odds is not None
    values, codes = [], []
    for n, block in enumerate(_blocks(street)):
        before = None if odds is None else odds[n]
        drawable = block.own if before is None else block.own & (before > LEARN_FROM)
        values.append(_values(block, before)[:, drawable])
        codes.append(block.code[drawable])
    code = np.concatenate(codes)
    rng = np.random.default_rng([seed, number, again])
    rows, weights = [], []
    for cause in np.unique(code).tolist():
        every = np.flatnonzero(code == cause)
        most = BAD[again] if cause else GOOD[again]
        some = rng.choice(every, min(most, len(every)), replace=False)
        share = len(every) / len(street.code)
        # Rare causes count more than their share.
        counts = (
            BAD_COUNTS.get(Cause(cause), 1.0) * np.sqrt(share) if cause else GOOD_COUNTS * share
        )
        rows.append(some)
        weights.append(np.full(len(some), counts / max(len(some), 1)))
    row = np.concatenate(rows)
    return Drawn(np.concatenate(values, axis=1)[:, row], code[row] > 0, np.concatenate(weights))


def _judge(
    street: Street, trees: Trees, odds: list[Singles] | None
) -> Iterator[tuple[Singles, NDArray[np.bool_]]]:
    """Return the log-odds of the points of each block in a pass, and which points are its own.

    The second pass judges only those that are not clearly good.
    """
    for n, block in enumerate(_blocks(street)):
        before = None if odds is None else odds[n]
        yield judge_pass(trees, _values(block, before), before, DOUBTFUL), block.own


def _choose_threshold(code: Sequence[Ints], odds: Sequence[Singles]) -> float:
    """Choose the least threshold that leaves good points alone; where none does, the greatest.

    By the median street: of foliage, which some have, a few points always look like outliers.
    """
    lost = [lost_shares(*one, LIMITS) for one in zip(code, odds, strict=True)]
    return least_limit(LIMITS, np.median(lost, axis=0), MAX_LOST_SHARE)


def _figures(code: Sequence[Ints], odds: Sequence[Singles], threshold: float) -> dict[str, Any]:
    """Say what a threshold gives on streets that were left out: by cause, and all together."""
    every, rejected = np.concatenate(code), np.concatenate(odds) > threshold
    bad = every > 0
    f1 = 2.0 * np.count_nonzero(rejected & bad) / max(np.count_nonzero(rejected) + bad.sum(), 1)
    recall = {
        Cause(cause).name.lower(): round(float(rejected[every == cause].mean()), DIGITS)
        for cause in np.unique(every[bad]).tolist()
    }
    streets = [
        float((some[of == 0] > threshold).mean()) for of, some in zip(code, odds, strict=True)
    ]
    return {
        'f1': round(float(f1), DIGITS),
        'recall': recall,
        'lost': round(float(rejected[~bad].mean()), DIGITS),
        'lost_of_median_street': round(float(np.median(streets)), DIGITS),
    }
