# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the trees of spinning sensors find in weather of a law, on sensors, that never trained.

    scripts/environment python benchmarks/weather_left_out.py [--data DIR] [--law NAME] [--write]

Each law of weather is left out once: none of its sweeps trains, and none chooses the threshold.
Sensors are left out in folds beside it: trees that judge a sweep know neither its law nor its
sensor. Each pair of sensor and weather is one cell: F1 of the trees, at the best threshold of the
cell, and of the range-scaled distance, tuned on the cell. All laws take half an hour of processor
time. ``--write`` puts the tables into ``doc/results/weather.md``, and what they say together into
``doc/accuracy.md``.
"""

# ruff: noqa: INP001, T201  a script, which prints

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.evaluation.confusion import curve
from lidar_outlier_lab.results.markdown import NOTHING, table, write
from lidar_outlier_lab.results.peers import distances
from lidar_outlier_lab.training.held_out import LIMITS, MIN_OUTLIERS, NO_WEATHER, worst_quarter
from lidar_outlier_lab.training.ring_tables import known_scanners
from lidar_outlier_lab.training.scenes import LAWS, TRAINED, make_sweeps, read_recordings
from lidar_outlier_lab.training.train import Recipe, Sweep, train

ROOT = Path(__file__).resolve().parents[1]
PAGE, SUMMARY = ROOT / 'doc' / 'results' / 'weather.md', ROOT / 'doc' / 'accuracy.md'
COMMAND = 'benchmarks/weather_left_out.py --write'
FOLDS = 3  # of sensors; the training has eight, and takes three times as long
SEED = 1
OWN = 'optics'  # the law of the simulator's own weather
HEAD = (
    *('law', 'cells', 'mean F1', 'worst quarter', 'worst cell', 'the rule wins'),
    'within 0.02 of the best threshold',
)

Cells = dict[tuple[str, str], Floats]  # by sensor and weather: F1, at best, of the rule


def law_of(kind: str) -> str:
    """Return the law of a kind of sweeps; nothing for those without weather."""
    law, _, weather = kind.rpartition(' ')
    return '' if weather in NO_WEATHER else law or OWN


def left_out(sweeps: Sequence[Sweep], law: str) -> Cells:
    """Train without a law, and judge its weather on sensors left out."""
    begin = time.monotonic()
    judged = {one.kind for one in sweeps if law_of(one.kind) == law}
    unseen = {one.kind for one in sweeps if law_of(one.kind) not in {'', OWN, *TRAINED} - {law}}
    trained = train(sweeps, {}, Recipe(SEED, folds=FOLDS, unseen=unseen))
    at = int(np.argmin(np.abs(LIMITS - trained.threshold)))
    cells: dict[tuple[str, str], list[Floats]] = {}
    for sweep, found in zip((s for s in sweeps if s.judged), trained.judged, strict=True):
        if sweep.kind in judged and found.outliers >= MIN_OUTLIERS:
            apart = distances(sweep.points.xyz, 3)[:, 2] / sweep.points.range
            rule = curve(sweep.outlier, apart).best
            f1 = found.f1[at], found.best, rule
            cells.setdefault((sweep.sensor, sweep.kind.rpartition(' ')[2]), []).append(np.array(f1))
    print(law, f'{time.monotonic() - begin:.0f} s', flush=True)
    return {cell: np.mean(some, axis=0) for cell, some in cells.items()}


def summary(law: str, cells: Cells) -> list[str]:
    """Lay out what all cells of a law say together."""
    every = np.array([*cells.values()])
    return [
        f'[{law}](results/weather.md#{law})',
        f'{len(every)}',
        *(triple(some) for some in (every.mean(axis=0), worst_quarter(every), every.min(axis=0))),
        f'{np.count_nonzero(every[:, 2] > every[:, 0])}',
        f'{np.count_nonzero(every[:, 1] - every[:, 0] <= 0.02)}',  # noqa: PLR2004  the head
    ]


def triple(some: Floats) -> str:
    """Lay out one cell."""
    return ' / '.join(f'{value:.2f}' for value in some)


def by_sensor(cells: Cells) -> str:
    """Lay out all cells of a law, and the mean of each weather."""
    sensors, kinds = (list(dict.fromkeys(names)) for names in zip(*cells, strict=True))
    rows = [
        [
            sensor,
            *(
                triple(cells[sensor, kind]) if (sensor, kind) in cells else NOTHING
                for kind in kinds
            ),
        ]
        for sensor in sensors
    ]
    means = [
        np.mean([f1 for cell, f1 in cells.items() if cell[1] == kind], axis=0) for kind in kinds
    ]
    rows.append(['mean', *map(triple, means)])
    return table(('sensor', *(kind.replace('_', ' ') for kind in kinds)), rows)


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument('--data', type=Path, default=ROOT.parent / 'shared' / 'data')
    parser.add_argument('--law', choices=(OWN, *LAWS))
    parser.add_argument('--write', action='store_true')
    options = parser.parse_args()
    scanners = known_scanners(options.data / 'ring_tables')
    sweeps = make_sweeps(read_recordings(options.data), scanners, SEED, laws=LAWS)
    rows = []
    for law in (options.law,) if options.law else (OWN, *LAWS):
        cells = left_out(sweeps, law)
        rows.append(summary(law, cells))
        print(text := by_sensor(cells), flush=True)
        if options.write:
            write(PAGE, law, text, command=COMMAND)
    print(text := table(HEAD, rows))
    if options.write and not options.law:
        write(SUMMARY, 'weather left out', text, command=COMMAND)


if __name__ == '__main__':
    main()
