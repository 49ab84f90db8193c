# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``clean``. It imports what is heavy when it runs, so that help is instant."""

# ruff: noqa: PLC0415  as said above

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

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
from lidar_outlier_filter.core.threads import cores
from lidar_outlier_filter.errors import FilterError, ParameterError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Sequence

    from rich.table import Table

    from lidar_outlier_filter.cli.terminal import Advance, Commands
    from lidar_outlier_filter.files.clean import Progress
    from lidar_outlier_filter.files.clean_log import CleanReport, Wanted

MUCH = 0.005  # share of the points that rarely are outliers
DONE_NOW, LEFT_OUT, FAILED = 'done', 'left out', 'refused'
CLEANED, OUTLIERS = '_cleaned', '_outliers'  # behind the name of a file


def add_clean(commands: Commands) -> None:
    """Add the command ``clean``."""
    parser = commands.add_parser(
        'clean',
        help='filter clouds that are files',
        description='Judge all points of a file together, and write a copy with every attribute '
        'kept. Reads and writes LAS, LAZ, PCD, PLY, CSV, Parquet, and tables of SQLite databases. '
        'Beside each copy goes a log, .log and .json. alpha_beta_gamma needs a time '
        'and scan lines (LAS: gps_time, and the scan direction, angle or edges; others: columns '
        'such as time and ring); evidence uses them where there are some. Exit '
        'status: 0 all done; 1 refused, nothing is written; 3 some of the files were '
        'refused, or none of the points of one could be tested.',
    )
    parser.add_argument('files', type=Path, nargs='+', metavar='FILE', help='the clouds')
    parser.add_argument(
        '--output',
        type=Path,
        metavar='PATH',
        help='new file, or a folder for it (for several files: a folder, which is made if there is '
        'none); default: FILE_cleaned',
    )
    parser.add_argument(
        '--rejected',
        choices=('mark', 'remove', 'separate'),
        help='mark (default): by classification 7 in LAS, by columns outlier, outlier_score and '
        'outlier_detectors elsewhere, in a table of their own for a database; remove; or separate: '
        'put into a file of their own',
    )
    parser.add_argument(
        '--mark',
        choices=('class', 'noise', 'withheld'),
        default='class',
        help='how rejected points of LAS are marked: class (default): 7; noise: 7 or 18, as they '
        'are below or above what is kept around; withheld: by this flag',
    )
    parser.add_argument(
        '--only-classes',
        metavar='C[,C…]',
        help='classes of LAS whose points may be rejected; all others stay as they are',
    )
    parser.add_argument(
        '--keep-classes', metavar='C[,C…]', help='classes of LAS whose points stay as they are'
    )
    parser.add_argument(
        '--strips',
        action='store_true',
        help='judge the points of each point_source_id (LAS) alone: the strips of a flight',
    )
    parser.add_argument(
        '--jobs',
        type=int,
        default=cores(),
        metavar='N',
        help='clean so many of several files at once; default: as many as there are cores',
    )
    parser.add_argument(
        '--dry-run',
        action='store_true',
        help='write nothing; print what would be rejected, by detector and by class',
    )
    parser.add_argument(
        '--resume',
        action='store_true',
        help='leave out files whose output is there already, made with the same options',
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
    if options.output and len(options.files) > 1:
        _make_folder(options)
    if options.outliers and len(options.files) > 1:
        raise ParameterError('--outliers', 'given for one file', f'{len(options.files)} files')
    if options.jobs < 1:
        raise ParameterError('--jobs', 'at least 1', options.jobs)
    results = _clean_all(options, wanted)
    reports = [result.report for result in results if result.report is not None]
    for result in results:
        _say_how(result)
    if reports:
        _show(reports)
    good = [result for result in results if result.state != FAILED]
    if len(good) == len(results) and not any(_is_untested(report) for report in reports):
        return DONE
    return INCOMPLETE if good else REFUSED


class _Result(NamedTuple):
    """What became of a file: a report, or why there is none."""

    path: Path
    state: str
    report: CleanReport | None = None
    why: str = ''


def _clean_all(options: argparse.Namespace, wanted: Wanted) -> list[_Result]:
    """Clean the files, some at a time; the results are in the order of the files."""
    import lidar_outlier_filter.files.clean  # noqa: F401  from here on signals are only noted

    single = len(options.files) == 1
    with stopping() as leave_if_asked, ExitStack() as bars:
        advance = None if single else bars.enter_context(progress_bar('cleaning'))
        finished: list[Path] = []

        def run(path: Path) -> _Result:
            steps = _StepsOfFile(path, leave_if_asked, bars if single else None)
            result = _clean_one(path, options, wanted, steps)
            finished.append(path)
            if advance is not None:
                advance(len(finished), len(options.files), path.name)
            return result

        if single or options.jobs == 1:
            return [run(path) for path in options.files]
        with ThreadPoolExecutor(options.jobs) as pool:
            try:
                return list(pool.map(run, options.files))
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise


def _clean_one(
    path: Path, options: argparse.Namespace, wanted: Wanted, progress: Progress
) -> _Result:
    from lidar_outlier_filter.files.clean import clean
    from lidar_outlier_filter.files.done import is_done

    output, outliers = _outputs(path, options)
    if options.resume and is_done(path, output, outliers, wanted):
        return _Result(path, LEFT_OUT, why=f'is done already: {output}')
    try:
        report = clean(
            path, output, wanted, outliers, progress, lambda slow: say(f'{path}: {slow}')
        )
    except FilterError as err:
        return _Result(path, FAILED, why=str(err))
    return _Result(path, DONE_NOW, report)


class _StepsOfFile:
    """Shows the steps of one file, a bar for each, where there is room for them."""

    def __init__(
        self, path: Path, leave_if_asked: Callable[[], None], bars: ExitStack | None
    ) -> None:
        self._name, self._leave_if_asked, self._bars = path.name, leave_if_asked, bars
        self._steps: dict[str, Advance] = {}

    def __call__(self, step: str, done: int, total: int) -> None:
        self._leave_if_asked()
        if self._bars is None:
            return
        if step not in self._steps:
            self._bars.close()
            self._steps[step] = self._bars.enter_context(progress_bar(f'{self._name}: {step}'))
        self._steps[step](done, total)


def _is_untested(report: CleanReport) -> bool:
    return report.points == report.untested + report.invalid


def _make_folder(options: argparse.Namespace) -> None:
    """Make the folder for the outputs of several files, unless nothing is written."""
    if options.output.exists() and not options.output.is_dir():
        raise ParameterError('--output of several files', 'a folder', options.output)
    if not options.dry_run:
        try:
            options.output.mkdir(parents=True, exist_ok=True)
        except OSError as err:
            got = f'"{err.strerror}"'
            raise ParameterError(f'--output {options.output}', 'a folder', got) from err


def _classes(text: str | None, option: str) -> tuple[int, ...]:
    """Read classes, whole numbers with commas between."""
    names = _names(text or '')
    if not all(name.isdecimal() for name in names):
        raise ParameterError(option, 'whole numbers, with commas between', text)
    return tuple(map(int, names))


def _say_how(result: _Result) -> None:
    """Say why a file has no report, or in which way it is not judged as it is."""
    path, report = result.path, result.report
    if report is None:
        say(f'{path} {result.why}' if result.state == LEFT_OUT else result.why)
        return
    if report.metres:
        sizes = ', '.join(f'{name} = {size:.10g} m' for name, size in report.metres.items())
        say(f'{path} is not in metres ({sizes}): it is judged in metres')
    if report.coarse:
        say(f'{path}: {report.coarse}')
    if report.lack:
        say(f'{path} has {report.lack}: it is judged without scan lines')
    if _is_untested(report):
        say(f'{path}: {" and ".join(report.chain)} could test none of its points')
    if report.rejected > MUCH * report.points:
        say(f'{path}: {report.rejected / report.points:.1%} of its points are rejected')


def _wanted(options: argparse.Namespace) -> Wanted:
    """Take from the options what is wanted."""
    from lidar_outlier_filter.files.clean_log import MARK, SEPARATE, Wanted

    values = read_parameters(options.params, options.settings)
    if options.chain is not None:
        values['chain'] = _names(options.chain)
    return Wanted(
        options.rejected or (MARK if options.outliers is None else SEPARATE),
        _names(options.columns or ''),
        options.table,
        options.tile,
        options.mark,
        options.strips,
        _classes(options.only_classes, '--only-classes'),
        _classes(options.keep_classes, '--keep-classes'),
        options.dry_run,
        values,
    )


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(',') if name.strip())


def _outputs(path: Path, options: argparse.Namespace) -> tuple[Path, Path | None]:
    """Name the outputs after the file, beside it, where nothing else is said."""
    from lidar_outlier_filter.files.clean_log import SEPARATE

    output = options.output or path.with_name(path.stem + CLEANED + path.suffix)
    if options.output and options.output.is_dir():
        output = options.output / (path.stem + CLEANED + path.suffix)
    if options.outliers is None and options.rejected == SEPARATE:
        stem = output.stem.removesuffix(CLEANED)
        return output, output.with_name(stem + OUTLIERS + output.suffix)
    return output, options.outliers


def _show(reports: Sequence[CleanReport]) -> None:
    """Print the table of the files, and what was written."""
    from rich.console import Console

    console = Console()
    console.print(_table(reports))
    if any(report.by_class for report in reports):
        console.print(_table_of_classes(reports))
    for report in reports:
        for written in report.outputs:
            console.print(f'written to {written}', markup=False, highlight=False, soft_wrap=True)


def _table(reports: Sequence[CleanReport]) -> Table:
    """Make the table, a row for each file."""
    from rich.table import Table

    detectors = dict.fromkeys(name for report in reports for name in report.chain)
    numbers = ('points', 'invalid', 'untested', 'rejected', 'low', 'high', 'spared')
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


def _table_of_classes(reports: Sequence[CleanReport]) -> Table:
    """Make the table of the classes of LAS, of all files together."""
    from rich.table import Table

    total: dict[int, tuple[int, int]] = {}
    for report in reports:
        for number, counts in report.by_class.items():
            before = total.get(number, (0, 0))
            total[number] = (before[0] + counts[0], before[1] + counts[1])
    table = Table('class', 'points', 'rejected', 'share')
    for column in table.columns:
        column.justify = 'right'
    for number, (points, rejected) in sorted(total.items()):
        table.add_row(str(number), f'{points:,}', f'{rejected:,}', f'{rejected / points:.3%}')
    return table
