# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``clean``. It imports what is heavy when it runs, so that help is instant."""

# ruff: noqa: PLC0415  as said above

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from lidar_outlier_filter.cli.interrupts import stopping
from lidar_outlier_filter.cli.terminal import (
    DONE,
    INCOMPLETE,
    REFUSED,
    add_parameter_options,
    progress_bar,
    read_parameters,
    say,
)
from lidar_outlier_filter.errors import FilterError, ParameterError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    from rich.table import Table

    from lidar_outlier_filter.cli.terminal import Advance, Commands
    from lidar_outlier_filter.files.clean import CleanReport, Wanted

CLEANED, OUTLIERS = '_cleaned', '_outliers'  # behind the name of a file


def add_clean(commands: Commands) -> None:
    """Add the command ``clean``."""
    parser = commands.add_parser(
        'clean',
        help='filter clouds that are files',
        description='Judge all points of a file together, and write a copy with every attribute '
        'kept. Reads and writes LAS, LAZ, PCD, PLY, CSV, Parquet, and tables of SQLite databases. '
        'Beside each copy goes a log, .log and .json. The detectors along scan lines need a time '
        'and scan lines (LAS: gps_time, and the scan direction, angle or edges; others: columns '
        'such as time and ring); where a file has none, the chain is sor unless one is given, '
        'and in tiles it is alpha_beta_gamma. Exit '
        'status: 0 all done; 1 refused, nothing is written; 3 some of the files were '
        'refused, or none of the points of one could be tested.',
    )
    parser.add_argument('files', type=Path, nargs='+', metavar='FILE', help='the clouds')
    parser.add_argument(
        '--output',
        type=Path,
        metavar='PATH',
        help='new file, or a folder for it (for several files: a folder); default: FILE_cleaned',
    )
    parser.add_argument(
        '--rejected',
        choices=('mark', 'remove', 'separate'),
        help='mark (default): by classification 7 in LAS, by columns outlier, outlier_score and '
        'outlier_detectors elsewhere, in a table of their own for a database; remove; or separate: '
        'put into a file of their own',
    )
    parser.add_argument(
        '--outliers',
        type=Path,
        metavar='FILE',
        help='new file for the rejected points (--rejected separate); default: FILE_outliers',
    )
    parser.add_argument(
        '--columns', metavar='X,Y[,Z]', help='the two or three coordinates; default: x,y,z'
    )
    parser.add_argument(
        '--table', metavar='NAME', help='table of a database; default: the only one'
    )
    parser.add_argument(
        '--tile',
        type=float,
        default=0.0,
        metavar='METRES',
        help='judge the cloud in square tiles of this side, to save memory; so large that one '
        'holds a million points or so. The answer is that of one piece, which is the default (0); '
        'that of quadric depends on the side',
    )
    parser.add_argument('--chain', metavar='D[,D…]', help='detectors, in their order')
    add_parameter_options(parser)
    parser.set_defaults(run=_clean)


def _clean(options: argparse.Namespace) -> int:
    wanted = _wanted(options)
    reports = []
    if options.output and len(options.files) > 1 and not options.output.is_dir():
        raise ParameterError('--output of several files', 'a folder', options.output)
    if options.outliers and len(options.files) > 1:
        raise ParameterError('--outliers', 'given for one file', f'{len(options.files)} files')
    for path in options.files:
        output, outliers = _outputs(path, options)
        try:
            report = _run(path, output, outliers, wanted)
        except FilterError as err:
            say(str(err))
            continue
        reports.append(report)
        _say_how(path, report, wanted)
    if reports:
        _show(reports)
    untested = [report for report in reports if report.points == report.untested + report.invalid]
    for report in untested:
        say(f'{report.input}: {" and ".join(report.chain)} could test none of its points')
    if len(reports) == len(options.files) and not untested:
        return DONE
    return INCOMPLETE if reports else REFUSED


def _say_how(path: Path, report: CleanReport, wanted: Wanted) -> None:
    """Say in which way a file is not judged as it is."""
    if report.metres:
        sizes = ', '.join(f'{name} = {size:.10g} m' for name, size in report.metres.items())
        say(f'{path} is not in metres ({sizes}): it is judged in metres')
    if report.coarse:
        say(f'{path}: {report.coarse}')
    if report.lack:
        say(f'{path} has {report.lack}: chain {", ".join(report.chain)}')
    elif report.tile > 0 and 'chain' not in wanted.parameters:
        say(f'{path} is judged in tiles: chain {", ".join(report.chain)}')


def _wanted(options: argparse.Namespace) -> Wanted:
    """Take from the options what is wanted."""
    from lidar_outlier_filter.files.clean import MARK, SEPARATE, Wanted

    values = read_parameters(options.params, options.settings)
    if options.chain is not None:
        values['chain'] = _names(options.chain)
    return Wanted(
        options.rejected or (MARK if options.outliers is None else SEPARATE),
        _names(options.columns or ''),
        options.table,
        options.tile,
        values,
    )


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(',') if name.strip())


def _outputs(path: Path, options: argparse.Namespace) -> tuple[Path, Path | None]:
    """Name the outputs after the file, beside it, where nothing else is said."""
    from lidar_outlier_filter.files.clean import SEPARATE

    output = options.output or path.with_name(path.stem + CLEANED + path.suffix)
    if options.output and options.output.is_dir():
        output = options.output / (path.stem + CLEANED + path.suffix)
    if options.outliers is None and options.rejected == SEPARATE:
        stem = output.stem.removesuffix(CLEANED)
        return output, output.with_name(stem + OUTLIERS + output.suffix)
    return output, options.outliers


def _run(path: Path, output: Path, outliers: Path | None, wanted: Wanted) -> CleanReport:
    """Clean one file, with a bar for each of its steps."""
    from lidar_outlier_filter.files.clean import clean

    with stopping() as leave_if_asked, ExitStack() as bars:
        steps: dict[str, Advance] = {}

        def progress(step: str, done: int, total: int) -> None:
            leave_if_asked()
            if step not in steps:
                bars.close()
                steps[step] = bars.enter_context(progress_bar(f'{path.name}: {step}'))
            steps[step](done, total)

        return clean(path, output, wanted, outliers, progress, lambda slow: say(f'{path}: {slow}'))


def _show(reports: Sequence[CleanReport]) -> None:
    """Print the table of the files, and what was written."""
    from rich.console import Console

    console = Console()
    console.print(_table(reports))
    for report in reports:
        for written in report.outputs:
            console.print(f'written to {written}', markup=False, highlight=False, soft_wrap=True)


def _table(reports: Sequence[CleanReport]) -> Table:
    """Make the table, a row for each file."""
    from rich.table import Table

    detectors = dict.fromkeys(name for report in reports for name in report.chain)
    numbers = ('points', 'invalid', 'untested', 'rejected')
    table = Table('file', *numbers, *(f'by {name}' for name in detectors), 'seconds')
    for column in table.columns[1:]:
        column.justify, column.overflow = 'right', 'fold'
    for report in reports:
        by = (report.rejected_by.get(name) for name in detectors)
        table.add_row(
            Path(report.input).name,
            *(f'{getattr(report, name):,}' for name in numbers),
            *('' if count is None else f'{count:,}' for count in by),
            f'{sum(report.seconds.values()):.1f}',
        )
    return table
