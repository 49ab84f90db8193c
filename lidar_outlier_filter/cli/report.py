# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``report``."""

import argparse
from pathlib import Path

from lidar_outlier_filter.cli.evaluate import truth_of
from lidar_outlier_filter.cli.terminal import (
    DONE,
    INCOMPLETE,
    REFUSED,
    beside,
    can_draw,
    read_parameters,
    say,
    show,
    stoppable_bar,
)
from lidar_outlier_filter.disk.new_files import FILE, FOLDER, check_new, new_output
from lidar_outlier_filter.errors import ParameterError, refused_for
from lidar_outlier_filter.evaluation.labels import Codes, is_recording
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.report.gather import gather
from lidar_outlier_filter.report.page import page
from lidar_outlier_filter.report.sources import FileSource, RecordedSource, Source


def _outputs(options: argparse.Namespace) -> list[Path | None]:
    """Return page and folder of figures, as far as they are asked for and can be drawn."""
    output, figures = options.output, options.figures
    if figures is not None and not can_draw():
        figures = None
    elif output is None and figures is None:
        output = beside(options.data, '_report.html')
    for path, must_be in ((output, FILE), (figures, FOLDER)):
        if path is not None:
            check_new(path, must_be)
    return [output, figures]


def run_report(options: argparse.Namespace) -> int:
    """Write the page, or the figures."""
    output, figures = _outputs(options)
    if output is None and figures is None:
        return REFUSED
    if options.points < 1:
        raise ParameterError('--points', 'at least 1', options.points)
    with stoppable_bar(options.data.name) as progress:
        source, codes = _source(options)
        found = gather(source, codes, options.points, progress)
        if output is not None:
            with new_output(output) as built:
                built.write_text(page(found), encoding='utf-8')
        if figures is not None:
            from lidar_outlier_filter.report.figures import draw_all  # noqa: PLC0415  an extra

            with new_output(figures, FOLDER) as built:
                draw_all(found, built)
    show(*(f'written to {path}' for path in (output, figures) if path is not None))
    drawn, valid = len(found.points), found.all.points
    if drawn < valid:
        say(f'{drawn} of {valid} points are drawn (--points); all are counted')
    refused = sum(found.found.refusals.values())
    if refused:
        reasons = refused_for(found.found.refusals, found.found.sentences)
        say(f'{refused} clouds were refused, for: {reasons}')
    return INCOMPLETE if refused or figures != options.figures else DONE


def _source(options: argparse.Namespace) -> tuple[Source, Codes]:
    values = read_parameters(options.params, options.settings)
    parameters = FilterParameters().changed(values)
    files, codes = truth_of(options, options.data)
    if is_recording(options.data):
        given = (options.data, parameters, options.topic, options.label, files)
        return RecordedSource(*given), codes
    if options.topic is not None:
        raise ParameterError('--topic', 'given for a recording only', repr(options.topic))
    truth = (files[0] if files else options.data, options.label)
    named = bool(files) or bool(options.label)
    return FileSource(options.data, parameters, truth=truth, named=named), codes
