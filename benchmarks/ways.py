# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The ways in which the default can judge, on clouds that have no scan pattern as they come.

    scripts/environment python benchmarks/ways.py [--write] [--seeds 401 402 403] [--only NAME]

The same points are judged by the weighted sum, by the trees on the neighbours of each point, and by
the trees on the scan pattern, where one can be found. Streets are simulated; of clean recordings,
which are moved along a curve, everything that is rejected counts as lost. ``--write`` puts the
table into the page of the detector.
"""

# ruff: noqa: INP001, T201  a script, no package

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from ways_clouds import FEW, few_lines, moved_recordings, moved_street, swinging

from lidar_outlier_filter.core.detectors.boosted_trees.pattern.judge import find_either, judge
from lidar_outlier_filter.core.detectors.boosted_trees.survey import judge as survey
from lidar_outlier_filter.core.detectors.boosted_trees.weighted_sum.detector import (
    detect,
    neighbours,
)
from lidar_outlier_filter.core.neighbours.floor import look_around
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_lab.results.markdown import NOTHING, put, table

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from ways_clouds import Stretch

    from lidar_outlier_filter.annotations import Bools
    from lidar_outlier_filter.core.points.points import Points

    Judge = Callable[[Points], Bools | None]

COMMAND = 'benchmarks/ways.py --write'
PAGE = Path(__file__).parents[1] / 'doc' / 'development' / 'default.md'
PARAMETERS = FilterParameters()
SEEDS = (401, 402, 403)
STREETS = (16, 32, 64, 128)
SURVEYS = ('leslar-a', 'leslar-b', 'leslar-c')


def by_sum(points: Points) -> Bools:
    """Judge by the weighted sum."""
    near = Neighbourhood(points.xyz, neighbours())
    return np.asarray(detect(near, points, PARAMETERS) > 1)


def by_survey(points: Points) -> Bools:
    """Judge as files without scan lines are judged."""
    odds, _ = survey.measure(points.xyz, look_around(points.xyz, np.arange(len(points))))
    return np.asarray(survey.score(odds, 1.0) > 1)


def by_pattern(points: Points) -> Bools | None:
    """Judge by the scan pattern; None where none is found."""
    found = find_either(points, 'auto')
    return None if found is None else judge(found.pattern, 1.0, profile=found.profile) > 1


WAYS: dict[str, Judge] = {'weighted sum': by_sum, 'neighbours': by_survey, 'pattern': by_pattern}


class Count(NamedTuple):
    """What a way did with points that count: how many, and its processor seconds."""

    bad: int = 0
    good: int = 0
    found: int = 0
    lost: int = 0
    seen: int = 0
    seconds: float = 0.0

    def add(self, other: Count) -> Count:
        """Add up two."""
        return Count(
            self.bad + other.bad,
            self.good + other.good,
            self.found + other.found,
            self.lost + other.lost,
            self.seen + other.seen,
            self.seconds + other.seconds,
        )

    def cell(self) -> str:
        """Write F1, recall, good points lost, and points per second of processor time."""
        if not self.seen:
            return NOTHING
        lost = f'{100 * self.lost / max(self.good, 1):.3f} %'
        speed = f'{self.seen / self.seconds / 1000:.0f} k/s'
        if not self.bad:
            return f'{lost}; {speed}'
        f1 = 2 * self.found / max(self.found + self.lost + self.bad, 1)
        return f'{f1:.3f} ({self.found / self.bad:.2f}); {lost}; {speed}'


def count(stretch: Stretch, way: Judge) -> Count:
    """Let a way judge a stretch, and count."""
    begin = time.process_time()  # others may be at work on the machine
    rejected = way(stretch.points)
    took = time.process_time() - begin
    if rejected is None:
        return Count()
    own, bad = stretch.own, stretch.bad
    return Count(
        int((bad & own).sum()),
        int((~bad & own).sum()),
        int((rejected & bad & own).sum()),
        int((rejected & ~bad & own).sum()),
        len(own),
        took,
    )


def cases(seeds: Iterable[int], data: Path) -> Iterator[tuple[str, Iterator[Stretch]]]:
    """Name each case, and make its stretches."""
    for rings in STREETS:
        parts = (one for seed in seeds for one in moved_street(rings, seed))
        yield f'`street-{rings}`, moved', parts
    for sensor, stretches in moved_recordings(data):
        yield f'{sensor}, real and clean, moved', stretches
    for name in SURVEYS:
        yield f'`{name}`, mirror swings', (one for seed in seeds for one in swinging(name, seed))
    for lines in FEW:
        for name in SURVEYS:
            parts = (one for seed in seeds for one in few_lines(name, seed, lines))
            yield f'`{name}`, {lines} line{"s"[: lines - 1]}', parts


def row(name: str, stretches: Iterator[Stretch]) -> list[str]:
    """Let all ways judge a case."""
    total = dict.fromkeys(WAYS, Count())
    for number, stretch in enumerate(stretches):
        if number == 0:  # its kernels are compiled, or loaded
            for judged in WAYS.values():
                judged(stretch.points)
        for way, judged in WAYS.items():
            total[way] = total[way].add(count(stretch, judged))
    return [name, *(one.cell() for one in total.values())]


def main() -> None:
    """Judge all cases, and print or write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--write', action='store_true', help='put the table into the page')
    parser.add_argument('--seeds', nargs='+', type=int, default=list(SEEDS))
    parser.add_argument('--only', default='', help='cases whose name contains this')
    parser.add_argument('--data', type=Path, default=PAGE.parents[3] / 'shared' / 'data' / 'bags')
    options = parser.parse_args()
    rows = []
    for name, stretches in cases(options.seeds, options.data):
        if options.only in name:
            rows.append(row(name, stretches))
            print(rows[-1], flush=True)
    text = table(('cloud', *WAYS), rows)
    if options.write:
        PAGE.write_text(put(PAGE.read_text('utf-8'), 'ways', text, COMMAND), 'utf-8')
    print(text)


if __name__ == '__main__':
    main()
