# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``report``. It imports what is heavy when it runs, so that help is instant."""

# ruff: noqa: PLC0415  as said above

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from lidar_outlier_filter.cli.evaluate import add_truth, truth_of
from lidar_outlier_filter.cli.terminal import (
    DONE,
    INCOMPLETE,
    REFUSED,
    add_parameter_options,
    beside,
    can_draw,
    read_parameters,
    say,
    show,
    stoppable_bar,
)
from lidar_outlier_filter.errors import ParameterError, refused_for

if TYPE_CHECKING:
    import argparse

    from lidar_outlier_filter.cli.terminal import Commands
    from lidar_outlier_filter.evaluation.labels import Codes
    from lidar_outlier_filter.report.sources import Source

MAX_DRAWN_POINTS = 10_000_000  # points


def add_report(commands: Commands) -> None:
    """Add the command ``report``."""
    parser = commands.add_parser(
        'report',
        help='make a page: rejected points, reasons, and the effect of other thresholds',
        description='Judge a recording or a file, and write one page that needs no network: the '
        'points in 3-D, a slider for the threshold of each detector, reasons, groups, histograms. '
        'Exit status: 0 all done; 1 refused, nothing is written; 3 written, but some clouds were '
        'refused, or --figures lacks matplotlib.',
        epilog='examples:\n  lidar-outlier-filter report drive --output drive.html\n'
        '  lidar-outlier-filter report street.laz --points 2000000',
    )
    parser.add_argument(
        'data',
        type=Path,
        metavar='RECORDING_OR_FILE',
        help='bag folder, .mcap, .db3 or ROS 1 .bag; or a file as for clean',
    )
    parser.add_argument(
        '--output', type=Path, metavar='FILE', help='new file; default: NAME_report.html'
    )
    parser.add_argument(
        '--figures',
        type=Path,
        metavar='DIR',
        help='new folder for figures as SVG and PNG; the page is then written only with --output',
    )
    parser.add_argument('--topic', metavar='T', help='topic of the clouds; default: the only one')
    parser.add_argument(
        '--points',
        type=int,
        default=MAX_DRAWN_POINTS,
        metavar='N',
        help='draw at most N points, 16 bytes each; counts are of all points; default: %(default)s',
    )
    add_parameter_options(parser)
    add_truth(parser)
    parser.set_defaults(run=_report)


def _outputs(options: argparse.Namespace) -> list[Path | None]:
    """Return page and folder of figures, as far as they are asked for and can be drawn."""
    from lidar_outlier_filter.disk.new_files import FILE, FOLDER, check_new

    output, figures = options.output, options.figures
    if figures is not None and not can_draw():
        figures = None
    elif output is None and figures is None:
        output = beside(options.data, '_report.html')
    for path, must_be in ((output, FILE), (figures, FOLDER)):
        if path is not None:
            check_new(path, must_be)
    return [output, figures]


def _report(options: argparse.Namespace) -> int:
    from lidar_outlier_filter.disk.new_files import FOLDER, new_output
    from lidar_outlier_filter.report.gather import gather
    from lidar_outlier_filter.report.page import page

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
            from lidar_outlier_filter.report.figures import draw_all

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
    from lidar_outlier_filter.evaluation.labels import is_recording
    from lidar_outlier_filter.parameters.filter import FilterParameters
    from lidar_outlier_filter.report.sources import FileSource, RecordedSource

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
