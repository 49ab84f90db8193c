# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``tune``."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from lidar_outlier_filter.cli.evaluate import truth_of
from lidar_outlier_filter.cli.terminal import (
    DONE,
    beside,
    parse_value,
    read_parameters,
    say,
    show,
    split_setting,
    stoppable_bar,
)
from lidar_outlier_filter.disk.new_files import check_new, new_output
from lidar_outlier_filter.errors import FilterError, ParameterError, RecordingError
from lidar_outlier_filter.evaluation.judged import CAUSES
from lidar_outlier_filter.evaluation.labels import is_recording
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.parameters.yaml_files import ros_lines, write_yaml
from lidar_outlier_filter.tuning import output as tuned
from lidar_outlier_filter.tuning.inject import Injection
from lidar_outlier_filter.tuning.output import Tuned
from lidar_outlier_filter.tuning.search import tune
from lidar_outlier_filter.tuning.training import Training, read_training, together

FOLDS = 5
NOT_WEATHER = (
    'Injected outliers are moved points.',
    'This F1 does not hold for snow, rain, fog, exhaust or mixed pixels.',
)


def run_tune(options: argparse.Namespace) -> int:
    """Search for the best parameters, and write them."""
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
    lost = tuned.whole(found.after).false_rejections.ratio
    if lost > options.most_lost:
        _show(found, parameters, options)
        must_be = f'at most {options.most_lost} (--most-lost) with some of the values tried'
        got = f'{lost:.4g} with the best: --search tries others, a shorter chain loses less'
        raise FilterError('the share of good points lost', must_be, got)
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
