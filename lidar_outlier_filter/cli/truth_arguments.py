# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The arguments of the commands that compare with the truth, as arguments.py has the others."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from lidar_outlier_filter.cli.arguments import add_parameter_options, add_truth

if TYPE_CHECKING:
    from argparse import ArgumentParser

    from lidar_outlier_filter.cli.arguments import Commands


def add_evaluate(commands: Commands) -> None:
    """Add the command ``evaluate``."""
    parser = commands.add_parser(
        'evaluate',
        help='compare rejected points with labels',
        description='Count the outliers found and the good points lost, by labels in the clouds or '
        'in separate files. With scores (scores: true) also by detector, with ROC curves. '
        'Exit status: 0 all done; 1 refused; 3 written without pictures: matplotlib is missing.',
        epilog='examples:\n  lidar-outlier-filter evaluate drive_cleaned\n'
        '  lidar-outlier-filter evaluate street_cleaned.laz --labels truth.laz --codes 7,18',
    )
    add = parser.add_argument
    add(
        'verdicts',
        type=Path,
        metavar='OUTPUT',
        help='recording with TOPIC/cleaned and TOPIC/outliers; or a file: an output of clean, or '
        'any file with a column of scores',
    )
    add_truth(parser)
    add('--topic', metavar='T', help='topic that was filtered; default: the only one')
    add(
        '--score',
        default='',
        metavar='NAME',
        help='column of a file with the scores; default: outlier_score',
    )
    add(
        '--verdict',
        default='',
        metavar='NAME',
        help='column that is nonzero for rejected points (classification: 7 or 18); default: '
        'outlier, else the score, else classification',
    )
    add(
        '--threshold',
        type=float,
        metavar='X',
        help='points of a file with a larger score are rejected; default: 1',
    )
    add(
        '--output',
        type=Path,
        metavar='DIR',
        help='new folder for evaluation.json and, with scores, the curves as PNG and SVG',
    )


def add_tune(commands: Commands) -> None:
    """Add the command ``tune``."""
    parser = commands.add_parser(
        'tune',
        help='optimise parameters on labelled or injected outliers',
        description='Tune window, neighbour and threshold parameters of the chain, '
        'write a parameter file, and print its expected F1 and good points lost, on parts of '
        'the recording that are held out. The truth is a field of the clouds, files '
        'beside them, or outliers that are injected into a clean recording.',
        epilog='examples:\n  lidar-outlier-filter tune drive --output tuned.yaml\n'
        '  lidar-outlier-filter tune drive --output tuned.yaml --set chain=[sor]',
    )
    add = parser.add_argument
    add(
        'data',
        type=Path,
        nargs='+',
        metavar='DATA',
        help='recordings or files of points; with several, whole ones are held out, for a '
        'better estimate',
    )
    add_truth(parser)
    add('--topic', metavar='T', help='topic of the clouds; default: the only one')
    _add_injection(parser)
    _add_search(parser)
    add('--output', type=Path, metavar='FILE', help='new parameter file; default: DATA_tuned.yaml')


def _add_injection(parser: ArgumentParser) -> None:
    add = parser.add_argument
    add(
        '--inject',
        type=float,
        metavar='SHARE',
        help='treat all points as good, and turn this share into outliers, as Pirotti et al. '
        '(2018) did with 0.0026: half of them single points, half in clusters of 2 to 30',
    )
    add(
        '--inject-distance',
        type=float,
        nargs=2,
        default=(1.0, 200.0),
        metavar=('LOW', 'HIGH'),
        help='outlier shift, metres (clusters: at least 2 × LOW), to at least LOW from good '
        'points; default: 1 to 200',
    )


def _add_search(parser: ArgumentParser) -> None:
    add_parameter_options(parser)
    add = parser.add_argument
    add(
        '--search',
        action='append',
        default=[],
        dest='searched',
        metavar='NAME=V,V,...',
        help='values to try for one parameter, instead of the usual ones; may be repeated',
    )
    add(
        '--keep',
        action='append',
        default=[],
        metavar='NAME',
        help='a parameter not to change; may be repeated',
    )
    add(
        '--most-lost',
        type=float,
        default=0.01,
        metavar='SHARE',
        help='maximum share of good points that may be rejected; default: 0.01',
    )
    add(
        '--folds',
        type=int,
        metavar='N',
        help='folds of the cross-validation; default: 5, or one for each of several recordings',
    )
    add(
        '--seed',
        type=int,
        default=1,
        metavar='N',
        help='random seed of the injected outliers; default: 1',
    )
