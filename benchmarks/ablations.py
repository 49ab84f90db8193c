# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the parts of the default are worth: other trees, fewer passes, and no trees at all.

    scripts/environment python benchmarks/ablations.py judge [--presets P ...] [--seeds N ...]
                                                             [--trees NAME=FILE ...]
    scripts/environment python benchmarks/ablations.py train FILE [--additive] [--streets N]

``judge`` shows each preset as the filter would judge it: with the trees of the package, with their
first pass alone, by the weighted sum on the features of a search tree, and with trees that FILE
has. The kind of sensor that a file is for shows in what it says. ``train`` makes such a file for
profile scanners, from fewer streets, or with trees of one question, so that no feature's meaning
depends on another; beside it, train one of three questions from as many streets.
"""
# ruff: noqa: INP001, T201  a script, no package

from __future__ import annotations

import argparse
import json
import math
from contextlib import contextmanager
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

from lidar_outlier_filter.core.detectors.boosted_trees import ways
from lidar_outlier_filter.core.detectors.boosted_trees.models import (
    NAMES,
    PATTERN_MODEL,
    PROFILE_MODEL,
    TreeModel,
    load,
    read_trees,
)
from lidar_outlier_filter.core.detectors.boosted_trees.pattern import judge as pattern
from lidar_outlier_filter.evaluation.confusion import FOUND, KEPT, LOST, MISSED
from lidar_outlier_lab.results.contest import score
from lidar_outlier_lab.results.contest_tables import TARGETS
from lidar_outlier_lab.results.contestants import OURS
from lidar_outlier_lab.results.samples import simulated
from lidar_outlier_lab.simulation.presets import PRESETS
from lidar_outlier_lab.training import learner
from lidar_outlier_lab.training.train_profile import ROUNDS, STREETS, make_streets, train_profile

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy as np

    from lidar_outlier_lab.results.contest import Record

MORE = 3  # times as many trees of one question as of three
Models = dict[str, TreeModel]  # by the file of the package that each stands for


def read_model(path: Path) -> Models:
    """Read a file that ``train`` wrote."""
    data: dict[str, Any] = json.loads(path.read_text(encoding='utf-8'))
    stands_for = PROFILE_MODEL if 'streets' in data else PATTERN_MODEL
    names, names_again = NAMES[stands_for]
    model = TreeModel(
        read_trees(data['first'], names),
        read_trees(data['again'], names_again),
        float(data['doubtful']),
        float(data['threshold']),
        float(data.get('threshold_bright', data['threshold'])),
    )
    return {stands_for: model}


def first_alone() -> Models:
    """Return the models of the package without their second pass."""
    return {name: load(name)._replace(doubtful=math.inf) for name in (PATTERN_MODEL, PROFILE_MODEL)}


@contextmanager
def judging(models: Models | None) -> Iterator[None]:
    """Let the default judge by other trees; None: by the weighted sum."""
    if models is None:
        with patch.object(ways, 'find_either', lambda *_, **__: None):
            yield
    else:
        with patch.object(pattern, 'load', lambda name: models.get(name) or load(name)):
            yield


def judge(presets: list[str], seeds: list[int], files: dict[str, Path]) -> None:
    """Print how each variant judges each preset, all seeds together."""
    variants: dict[str, Models | None] = {
        'default': {},
        'first pass alone': first_alone(),
        'weighted sum': None,
        **{name: read_model(path) for name, path in files.items()},
    }
    for preset in presets:
        records: dict[str, list[Record]] = {name: [] for name in variants}
        for seed in seeds:
            (sample,) = simulated(preset, seed)
            for name, models in variants.items():
                with judging(models):
                    records[name].append(score(OURS[0], sample))
        for name, some in records.items():
            print(f'{preset:11} {name:24} {summary(some)}', flush=True)


def summary(records: list[Record]) -> str:
    """Say what one variant gives."""
    total = sum(record.counts.sum(axis=0) for record in records)
    f1 = [_f1(record.counts.sum(axis=0)) for record in records]
    each = ' '.join(f'{one:.3f}' for one in f1)
    best, lost = fmean(record.best for record in records), total[LOST] / (total[LOST] + total[KEPT])
    return f'F1 {_f1(total):.3f} ({each}) best {best:.3f} lost {total[LOST]}, {lost:.4%}'


def _f1(counts: np.ndarray) -> float:
    return float(2 * counts[FOUND] / (2 * counts[FOUND] + counts[LOST] + counts[MISSED]))


def train(output: Path, streets: int, *, additive: bool) -> None:
    """Train trees for profile scanners, and write their file."""
    rounds = (MORE * ROUNDS[0], MORE * ROUNDS[1]) if additive else ROUNDS
    about = {'about': f'{streets} streets, {"one question" if additive else "three questions"}'}
    with patch.object(learner, 'DEPTH', 1 if additive else learner.DEPTH):
        result = train_profile(make_streets(streets), about, rounds=rounds)
    output.write_text(result.text, encoding='utf-8')
    print(json.dumps(result.held_out), 'threshold', result.threshold)


def main() -> None:
    """Judge, or train."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').splitlines()[0])
    commands = parser.add_subparsers(dest='command', required=True)
    of_judge = commands.add_parser('judge')
    of_judge.add_argument('--presets', nargs='+', choices=PRESETS, default=list(TARGETS))
    of_judge.add_argument('--seeds', nargs='+', type=int, default=[301, 302, 303, 304, 305])
    of_judge.add_argument('--trees', nargs='+', default=[], metavar='NAME=FILE')
    of_train = commands.add_parser('train')
    of_train.add_argument('output', type=Path, metavar='FILE')
    of_train.add_argument('--additive', action='store_true')
    of_train.add_argument('--streets', type=int, default=STREETS, metavar='N')
    options = parser.parse_args()
    if options.command == 'train':
        train(options.output, options.streets, additive=options.additive)
    else:
        files = dict(each.split('=', 1) for each in options.trees)
        judge(options.presets, options.seeds, {name: Path(one) for name, one in files.items()})


if __name__ == '__main__':
    main()
