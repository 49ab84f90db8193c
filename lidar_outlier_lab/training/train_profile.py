# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Train the trees that judge profile scanners on simulated streets; see :mod:`.folds`.

Mixed pixels train neither ensemble of :mod:`.folds`: they have one of their own.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Ints, Progress, Rows, Singles
from lidar_outlier_filter.core.detectors.boosted_trees.features import PROFILE, SECOND_PASS, WINDOW
from lidar_outlier_filter.core.detectors.boosted_trees.pattern_trees import (
    FoundPattern,
    may_be_mixed,
    prepare_all,
)
from lidar_outlier_filter.core.detectors.boosted_trees.trees import (
    PROFILE_MODEL,
    Trees,
    read_trees,
)
from lidar_outlier_filter.core.detectors.boosted_trees.window import Prepared
from lidar_outlier_filter.core.points.points import SECOND, Points
from lidar_outlier_filter.core.scan_pattern.profile_pattern import find_profile_pattern
from lidar_outlier_filter.evaluation.truth import Cause, Kind
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_lab.simulation.scenes.profile_streets import training_street
from lidar_outlier_lab.simulation.world.drive import Drive, join, second_echoes, simulate
from lidar_outlier_lab.training.folds import DIGITS, FOLDS, SceneRecipe
from lidar_outlier_lab.training.learner import Drawn, draw_rows, judge_pass, learn, window_features

STREETS = 144
# Good points that are few, or look like outliers, count more than their share.
THIN = (Kind.WIRE, Kind.FENCE, Kind.FOLIAGE, Kind.POLE, Kind.SIGN, Kind.TERRAIN)
LEARN_FROM = -3.0  # log-odds of the first from which on points train the second
MEASURED = [*WINDOW].index('bright')  # features of the window: these scanners need no intensities
NAMES = (*[*WINDOW][:MEASURED], *PROFILE)
MIN_BLOCK_POINTS = 1000  # points of a block, fewer are left out
RECIPE = SceneRecipe(
    what='street',
    names=(NAMES, (*NAMES, *SECOND_PASS)),
    rounds=(100, 120),
    good=(4000, 8000),
    bad=(400, 1000),
    good_counts=5.0,
    rare_counts=0.5,
    limits=np.arange(0, 61) / 10.0,
    most_lost=1e-4,
    doubtful=-1.0,
    bad_counts={Cause.BARRIER: 2.0, Cause.BIRD: 0.5, Cause.SINGLE: 2.0},
    neither={Cause.MIXED},
)
MIXED_ROUNDS, MIXED_RATE = 300, 0.3  # trees, and how much each corrects
MIXED_GOOD, MIXED_BAD = 24_000, 6000  # points of a street that are drawn
SOFT, SOFT_COUNTS = (-Kind.FOLIAGE, -Kind.TERRAIN), 2.0  # good points that count more there
MIXED_LIMITS = np.arange(-20, 121) / 10.0
MIXED_LOST = 4.2e-5  # of a street's good points, the mean of streets that were left out


class _Block(NamedTuple):
    """What is judged together: its pattern, and which points are not of its halo (P,)."""

    prepared: Prepared
    own: Bools
    code: Ints

    def values(self, odds: Singles | None) -> Singles:
        """Return the features (F, P) of a pass."""
        values = window_features(self.prepared, odds)
        return np.concatenate([values[:MEASURED], values[len(WINDOW) :]])


@dataclass(frozen=True)
class Street:
    """Points of a drive, in order of their times, and why each is where it is.

    ``code`` is of :class:`Cause`, of all points, or below 0 of a good point of a ``THIN`` kind;
    ``odds`` are a list, of the points of each block.
    """

    name: str
    points: Points
    code: Ints

    @property
    def kind(self) -> str:
        """Each street counts alone: of foliage, which some have, a few always look wrong."""
        return self.name

    @property
    def total(self) -> int:
        """How many points it has, those that no block judges too."""
        return len(self.code)

    @cached_property
    def cause(self) -> Ints:
        """Causes of the points that blocks judge."""
        return np.maximum(np.concatenate([code[own] for own, code in self._judged]), Cause.GOOD)

    @cached_property
    def _judged(self) -> list[tuple[Bools, Ints]]:
        return [(block.own, block.code) for block in self._blocks()]

    def _blocks(self) -> Iterator[_Block]:
        """Cut it as the filter does; stretches without a pattern are left out.

        Every step does so anew, to save memory: 100 000 points take 10 MB.
        """
        parameters = FilterParameters()
        length, halo = round(parameters.block * SECOND), round(parameters.halo * SECOND)
        t = self.points.t
        for begin in range(0, int(t[-1]) + 1, length):
            low, high = np.searchsorted(t, (begin - halo, begin + length + halo))
            if high - low < MIN_BLOCK_POINTS:
                continue
            pattern = find_profile_pattern(self.points.take(slice(int(low), int(high))))
            if pattern is None:
                continue
            prepared = prepare_all(FoundPattern(pattern, PROFILE_MODEL))
            order = low + pattern.order[pattern.order >= 0]
            own = (t[order] >= begin) & (t[order] < begin + length)
            yield _Block(prepared, own, self.code[order])

    def table(self, odds: list[Singles] | None) -> tuple[Ints, Callable[[Ints], Singles]]:
        """Return the causes and features of the points that may train a pass."""
        values, codes = [], []
        for n, block in enumerate(self._blocks()):
            before = None if odds is None else odds[n]
            drawable = block.own if before is None else block.own & (before > LEARN_FROM)
            values.append(block.values(before)[:, drawable])
            codes.append(block.code[drawable])
        every = np.concatenate(values, axis=1)
        return np.concatenate(codes), lambda rows: every[:, rows]

    def judge(self, trees: Trees, odds: list[Singles] | None) -> list[Singles]:
        """Return the log-odds of each block; the second pass judges what is not clearly good."""
        return [
            judge_pass(trees, block.values(before), before, RECIPE.doubtful)
            for n, block in enumerate(self._blocks())
            for before in (None if odds is None else odds[n],)
        ]

    def between(self, first: Trees) -> tuple[Ints, Singles]:
        """Return codes and features of the points that trees on mixed pixels judge.

        Outliers of other causes are left out.
        """
        code, found = [], []
        for block in self._blocks():
            values, pattern = block.values(None), block.prepared.pattern
            score = np.zeros(len(pattern.order), np.float32)
            score[pattern.order >= 0] = judge_pass(first, values, None)
            asked = may_be_mixed(pattern, score)[pattern.order >= 0] & block.own
            asked &= (block.code <= 0) | (block.code == Cause.MIXED)
            code.append(block.code[asked])
            found.append(values[:, asked])
        return np.concatenate(code), np.concatenate(found, axis=1)

    def own(self, odds: list[Singles]) -> Singles:
        """Return the log-odds of the points that are of no halo."""
        pairs = zip(odds, self._judged, strict=True)
        return np.concatenate([some[own] for some, (own, _) in pairs])


def add_mixed(streets: Sequence[Street], text: str, seed: int = 1) -> str:
    """Add trees on mixed pixels to a model, whose threshold holds for them, too."""
    data, rng = json.loads(text), np.random.default_rng(seed)
    first = read_trees(data['first'], NAMES)
    tables = [street.between(first) for street in streets]
    drawn = [_drawn(*table, rng) for table in tables]
    found, lost = [], []
    for k in range(FOLDS):
        some = [one for n, one in enumerate(drawn) if n % FOLDS != k]
        trees = read_trees(learn(some, NAMES, MIXED_ROUNDS, MIXED_RATE), NAMES)
        for n in range(k, len(streets), FOLDS):
            code, values = tables[n]
            above = judge_pass(trees, values, None) > MIXED_LIMITS[:, None]
            found.append(above[:, code > 0].sum(axis=1))
            lost.append(above[:, code <= 0].sum(axis=1) / np.count_nonzero(streets[n].cause == 0))
    mean = np.mean(lost, axis=0)
    at = int(np.flatnonzero(mean <= MIXED_LOST)[0])
    total = sum(np.count_nonzero(street.cause == Cause.MIXED) for street in streets)
    data['mixed'] = learn(drawn, NAMES, MIXED_ROUNDS, MIXED_RATE)
    data['mixed']['start'] += data['threshold'] - float(MIXED_LIMITS[at])
    figures = {'found': sum(found)[at] / total, 'lost': mean[at], 'worst': np.max(lost, axis=0)[at]}
    data['held_out']['mixed'] = {name: round(float(one), DIGITS) for name, one in figures.items()}
    return json.dumps(data, separators=(',', ':'))


def _drawn(code: Ints, values: Singles, rng: np.random.Generator) -> Drawn:
    """Draw good and mixed points of a street, which count as many as there are, or more."""
    good, bad = np.flatnonzero(code <= 0), np.flatnonzero(code > 0)
    rows, weight = draw_rows(rng, ((good, MIXED_GOOD, len(good)), (bad, MIXED_BAD, len(bad))))
    weight[np.isin(code[rows], SOFT)] *= SOFT_COUNTS
    return Drawn(values[:, rows], code[rows] > 0, weight)


def make_streets(progress: Progress = lambda _done, _total, _what: None) -> list[Street]:
    """Simulate so many streets."""
    found = []
    for seed in range(STREETS):
        progress(seed, STREETS, f'street {seed + 1} of {STREETS}')
        found.append(measured(f'profile street {seed}', *training_street(seed)))
    return found


def measured(name: str, drive: Drive, echoes: int = 1) -> Street:
    """Simulate a drive whose scanner numbers its lines."""
    points, rows = measured_rows(drive, echoes)
    code, kind = rows['label'].astype(np.int64), rows['surface'].astype(np.int64)
    return Street(name, points, np.where((code == 0) & np.isin(kind, THIN), -kind, code))


def measured_rows(drive: Drive, echoes: int = 1) -> tuple[Points, Rows]:
    """Simulate a drive whose scanner numbers its lines, with one or two echoes of a shot.

    Returns points in order of their times, and all that the simulator says of each.
    """
    first = join([returns for _, returns in simulate(drive)])
    every = join([first, second_echoes(drive, first.shot)]) if echoes > 1 else first
    every = every.take(np.argsort(every.shot, kind='stable'))
    rows = every.points
    xyz = np.stack([rows[axis] for axis in 'xyz'], axis=1).astype(np.float64)
    there = np.ones(len(rows), np.bool_)
    line = rows['line'].astype(np.int64)
    return Points(xyz, every.shot * drive.sensor.interval, line, there), rows
