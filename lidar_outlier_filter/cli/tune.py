# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``tune``. It imports what is heavy when it runs, so that help is instant."""

# ruff: noqa: PLC0415  as said above

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from lidar_outlier_filter.cli.evaluate import add_truth, truth_of
from lidar_outlier_filter.cli.terminal import (
    DONE,
    add_parameter_options,
    beside,
    parse_value,
    read_parameters,
    say,
    show,
    split_setting,
    stoppable_bar,
)
from lidar_outlier_filter.errors import ParameterError, RecordingError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    from lidar_outlier_filter.cli.terminal import Commands
    from lidar_outlier_filter.parameters.filter import FilterParameters
    from lidar_outlier_filter.tuning.output import Tuned
    from lidar_outlier_filter.tuning.training import Training

FOLDS = 5
NOT_WEATHER = (
    'Injected outliers are moved points.',
    'This F1 does not hold for snow, rain, fog, exhaust or mixed pixels.',
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
    parser.add_argument(
        'data',
        type=Path,
        nargs='+',
        metavar='DATA',
        help='recordings or files of points; with several, whole ones are held out, for a '
        'better estimate',
    )
    add_truth(parser)
    parser.add_argument('--topic', metavar='T', help='topic of the clouds; default: the only one')
    _add_injection(parser)
    _add_search(parser)
    parser.add_argument(
        '--output', type=Path, metavar='FILE', help='new parameter file; default: DATA_tuned.yaml'
    )
    parser.set_defaults(run=_run)


def _add_injection(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        '--inject',
        type=float,
        metavar='SHARE',
        help='treat all points as good, and turn this share into outliers, as Pirotti et al. '
        '(2018) did with 0.0026: half of them single points, half in clusters of 2 to 30',
    )
    parser.add_argument(
        '--inject-distance',
        type=float,
        nargs=2,
        default=(1.0, 200.0),
        metavar=('LOW', 'HIGH'),
        help='outlier shift, metres (clusters: at least 2 × LOW), to at least LOW from good '
        'points; default: 1 to 200',
    )


def _add_search(parser: argparse.ArgumentParser) -> None:
    add_parameter_options(parser)
    parser.add_argument(
        '--search',
        action='append',
        default=[],
        dest='searched',
        metavar='NAME=V,V,...',
        help='values to try for one parameter, instead of the usual ones; may be repeated',
    )
    parser.add_argument(
        '--keep',
        action='append',
        default=[],
        metavar='NAME',
        help='a parameter not to change; may be repeated',
    )
    parser.add_argument(
        '--most-lost',
        type=float,
        default=0.01,
        metavar='SHARE',
        help='maximum share of good points that may be rejected; default: 0.01',
    )
    parser.add_argument(
        '--folds',
        type=int,
        metavar='N',
        help='folds of the cross-validation; default: 5, or one for each of several recordings',
    )
    parser.add_argument(
        '--seed',
        type=int,
        default=1,
        metavar='N',
        help='random seed of the injected outliers; default: 1',
    )


def _run(options: argparse.Namespace) -> int:
    from lidar_outlier_filter.disk.new_files import check_new, new_output
    from lidar_outlier_filter.parameters.filter import FilterParameters
    from lidar_outlier_filter.parameters.yaml_files import write_yaml
    from lidar_outlier_filter.tuning import output as tuned
    from lidar_outlier_filter.tuning.search import tune
    from lidar_outlier_filter.tuning.training import together

    output = options.output or beside(options.data[0], '_tuned.yaml')
    folds = options.folds
    if folds is None:
        folds = FOLDS if len(options.data) == 1 else len(options.data)
    check_new(output)
    parameters = FilterParameters().changed(read_parameters(options.params, options.settings))
    requested = _parse_searches(options.searched)
    with stoppable_bar('tuning') as progress:
        progress(0, 1, 'reading')
        data = together([_data(options, path, parameters) for path in options.data])
        found = tune(
            data,
            parameters,
            options.most_lost,
            folds,
            requested=requested,
            kept=options.keep,
            progress=progress,
        )
    about = tuned.sentence(found, ', '.join(path.name for path in options.data))
    with new_output(output) as built:
        built.write_text(f'# {about}\n{write_yaml(found.parameters.flat())}', encoding='utf-8')
    _show(found, parameters, options)
    show(f'written to {output}')
    if data.refused:
        say(f'{data.refused} of its clouds were refused by the filter, and not learnt from')
    if data.without_pose:
        say(f'{data.without_pose} of its clouds had no poses, and were judged in their own frame')
    return DONE


def _parse_searches(texts: Sequence[str]) -> dict[str, Sequence[object]]:
    """Read the values to try, NAME=V,V,..., by parameter; each is named once."""
    requested: dict[str, Sequence[object]] = {}
    for text in texts:
        name, values = split_setting('--search', text, 'NAME=V,V,...')
        if name in requested:
            raise ParameterError('--search', f'given once for {name}', 'more than once')
        requested[name] = [parse_value(name, value) for value in values.split(',')]
    return requested


def _data(options: argparse.Namespace, path: Path, parameters: FilterParameters) -> Training:
    """Read the clouds of a recording or a file, and their truth."""
    from lidar_outlier_filter.evaluation.judged import CAUSES
    from lidar_outlier_filter.tuning.inject import Injection
    from lidar_outlier_filter.tuning.training import read_training

    if options.labels and len(options.data) > 1:
        must_be = 'given for one recording; of several, the truth is in their clouds'
        raise RecordingError('--labels', must_be, f'{len(options.data)} recordings')
    files, codes = truth_of(options, path)
    injection = None
    if options.inject is not None:
        injection = Injection(options.inject, tuple(options.inject_distance), options.seed)
        if files or options.label or options.codes or options.ignore:
            raise RecordingError('--inject', 'given without labels', 'both')
        codes = CAUSES
    given = {'topic': options.topic, 'label': options.label, 'files': files}
    return read_training(path, parameters, codes, **given, injection=injection)


def _show(found: Tuned, parameters: FilterParameters, options: argparse.Namespace) -> None:
    """Print what was found, what is doubtful, and how to use it."""
    from lidar_outlier_filter.evaluation.labels import is_recording
    from lidar_outlier_filter.parameters.yaml_files import ros_lines
    from lidar_outlier_filter.tuning import output as tuned

    for table in tuned.tables(found, parameters):
        show(table, '')
    notes = list(found.notes)
    if options.inject is not None:
        notes += NOT_WEATHER
        if is_recording(options.data[0]):
            arguments = f'--onto {options.data[0]} --weather light_snow --output snowy'
            notes.append(f'Better: lidar-outlier-filter simulate {arguments}, and tune on snowy.')
    if notes:
        show(*notes, '')
    if steps := ros_lines(parameters, found.values):
        show('On a node that runs with its start-up parameters:', *steps, '')
