# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How long each detector takes for hard shapes, as times of what it takes for a street.

    scripts/environment python benchmarks/geometry.py [--points 300000] [DETECTOR ...]

The shapes are those of the tests, in ``test/helpers/shapes.py``. Times are those of one thread on
the processor, the least of two runs.
The exit status is 1 if one is more than five times the street's.
"""

# ruff: noqa: INP001, T201  a script, no package

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from time import process_time
from typing import TYPE_CHECKING

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))

from helpers.shapes import CHAINS, SHAPES, scanned, street

from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.parameters.filter import FilterParameters

if TYPE_CHECKING:
    from lidar_outlier_filter.core.points.points import Points

LONGEST = 5.0  # times as long as on the street


def seconds(chain: Chain, points: Points) -> float:
    """Time a chain on a cloud."""
    times = []
    for _ in range(2):
        begin = process_time()
        chain.judge(points)
        times.append(process_time() - begin)
    return min(times)


def ratios(name: str, count: int, *, spins: bool) -> dict[str, float]:
    """Time a detector on all shapes: seconds on the street, and how many times that on others."""
    values = {'chain': (name.partition(',')[0],), 'threads': 1, **CHAINS[name]}
    chain = Chain(FilterParameters().changed(values))
    points = scanned(street(np.random.default_rng(1), count), spins=spins)
    chain.judge(points)
    found = {'street, s': seconds(chain, points)}
    for shape, make in SHAPES.items():
        points = scanned(make(np.random.default_rng(1), count), spins=spins)
        found[shape] = seconds(chain, points) / found['street, s']
    return found


def main() -> int:
    """Time it all, and print the table in Markdown."""
    parser = argparse.ArgumentParser(description='Time detectors on hard shapes.')
    parser.add_argument('--points', type=int, default=300_000)
    parser.add_argument('detectors', nargs='*', default=list(CHAINS), metavar='DETECTOR')
    options = parser.parse_args()
    columns: dict[str, dict[str, float]] = {}
    for name in options.detectors:
        columns[name] = ratios(name, options.points, spins=False)
        if name == 'boosted_trees':
            columns['boosted_trees, spinning'] = ratios(name, options.points, spins=True)
    print('| shape |', ' | '.join(columns), '|')
    print('| --- |', '---: | ' * len(columns))
    for shape in ('street, s', *SHAPES):
        print(
            f'| {shape} |', ' | '.join(f'{column[shape]:.2f}' for column in columns.values()), '|'
        )
    worst = max(value for column in columns.values() for value in list(column.values())[1:])
    print(f'the longest is {worst:.2f} times the street')
    return int(worst > LONGEST)


if __name__ == '__main__':
    sys.exit(main())
