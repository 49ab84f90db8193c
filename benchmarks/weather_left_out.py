# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the trees of spinning sensors find of a weather that nobody showed them.

    scripts/environment python benchmarks/weather_left_out.py [--data DIR] [--law NAME] [--write]

Each recipe of weather is left out once: none of its sweeps trains, and none chooses the threshold.
Sensors are left out in folds beside it: trees that judge a sweep know neither its weather nor its
sensor. Row by row this is compared with trees that know the weather, and not the sensor. Takes an
hour of processor time. ``--write`` puts the table into ``doc/accuracy.md``.

``--law``: weather of one of ``LAWS`` on real recordings, judged by the shipped trees;
``doc/results/weather.md`` has their tables.
"""

# ruff: noqa: INP001, T201  a script, which prints

import argparse
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.evaluation.confusion import curve, f1, tally
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_lab.results.markdown import NOTHING, table, write
from lidar_outlier_lab.results.peers import distances
from lidar_outlier_lab.simulation.weather.chances import KINDS
from lidar_outlier_lab.training.held_out import MIN_OUTLIERS
from lidar_outlier_lab.training.ring_tables import known_scanners
from lidar_outlier_lab.training.scenes import (
    LAWS,
    known_recordings,
    make_sweeps,
    put_weather,
    read_sweeps,
)
from lidar_outlier_lab.training.single_sweeps import read_single_sweeps
from lidar_outlier_lab.training.train import Recipe, Sweep, train

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / 'doc' / 'accuracy.md'
PAGE_LAW = ROOT / 'doc' / 'results' / 'weather.md'
SECTION = 'weather left out'
COMMAND = 'benchmarks/weather_left_out.py --write'
FOLDS = 3  # of sensors; the training has eight, and takes three times as long
SEED = 1
# Kinds that the simulator makes in the same way are one recipe.
RECIPES = (
    ('light_snow', 'heavy_snow'),
    ('rain',),
    ('fog',),
    ('spray',),
    ('dust',),
    ('exhaust',),
    ('mixed',),
    ('ghosts',),
)
HEAD = (
    *('weather', 'F1, known', 'F1, left out', 'left out, best threshold'),
    *('good points lost, known', 'left out'),
)


def held_out(sweeps: Sequence[Sweep], unseen: Sequence[str]) -> dict[str, Any]:
    """Train without a recipe, and say what sensors left out give, by weather."""
    begin = time.monotonic()
    result = train(sweeps, {}, Recipe(SEED, folds=FOLDS, unseen=unseen))
    print(unseen, f'{time.monotonic() - begin:.0f} s', result.held_out['weather'], flush=True)
    return result.held_out['weather']


def row(kind: str, known: dict[str, Any], unseen: dict[str, Any]) -> list[str]:
    """Lay out one weather."""
    return [
        kind.replace('_', ' '),
        f'{known["f1"]:.2f}',
        f'{unseen["f1"]:.2f}',
        f'{unseen["best_f1"]:.2f}',
        f'{100 * known["lost"]:.2f} %',
        f'{100 * unseen["lost"]:.2f} %',
    ]


def by_law(data: Path, law: str) -> str:
    """Judge a sweep of each sensor in each weather, and lay out a row for each sensor."""
    rows, every = [], []
    for one in known_recordings(data / 'bags'):
        cloud, row = read_sweeps(one)[0], [one.sensor]
        for number, kind in enumerate(KINDS):
            points, outlier = put_weather(cloud, kind, [SEED, number], make=LAWS[law])
            if outlier.sum() < MIN_OUTLIERS:
                row.append(NOTHING)
                continue
            verdict = Chain(FilterParameters()).judge(points)
            apart = distances(points.xyz, 3)[:, 2] / points.range
            ours = float(f1(tally(outlier, verdict.outlier))[0])
            every.append((ours, curve(outlier, verdict.score).best, curve(outlier, apart).best))
            row.append(' / '.join(f'{value:.2f}' for value in every[-1]))
        rows.append(row)
        print(row, flush=True)
    worst = np.mean(sorted(every)[: len(every) // 4], axis=0)
    rows.append(['worst quarter', ' / '.join(f'{value:.2f}' for value in worst)])
    rows[-1] += [''] * (len(KINDS) - 1)
    return table(('sensor', *KINDS), rows)


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument('--data', type=Path, default=ROOT.parent / 'shared' / 'data')
    parser.add_argument('--law', choices=LAWS)
    parser.add_argument('--write', action='store_true')
    options = parser.parse_args()
    if options.law:
        text = by_law(options.data, options.law)
        print(text)
        if options.write:
            write(PAGE_LAW, options.law, text, command=f'{COMMAND} --law {options.law}')
        return
    recordings = [(one.sensor, read_sweeps(one)) for one in known_recordings(options.data / 'bags')]
    recordings += read_single_sweeps(options.data)
    scanners = known_scanners(options.data / 'ring_tables')
    sweeps = make_sweeps(recordings, scanners, SEED, law=False)
    known = held_out(sweeps, ())
    rows = [
        row(kind, known[kind], unseen[kind])
        for kinds in RECIPES
        for unseen in (held_out(sweeps, kinds),)
        for kind in kinds
    ]
    text = table(HEAD, rows)
    print(text)
    if options.write:
        write(PAGE, SECTION, text, command=COMMAND)


if __name__ == '__main__':
    main()
