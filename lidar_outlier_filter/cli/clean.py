# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``clean``. Large modules are imported when it runs, so that ``--help`` is fast."""

# ruff: noqa: PLC0415  see above

from __future__ import annotations

from functools import partial
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.cli import tables
from lidar_outlier_filter.cli.archive import (
    add_worker_options,
    check_workers,
    go_through,
    refuse_inside,
)
from lidar_outlier_filter.cli.terminal import (
    DONE,
    INCOMPLETE,
    add_chain_option,
    add_parameter_options,
    beside,
    can_draw,
    names_in,
    read_parameters,
    say,
    saying_how_far,
    show,
    stoppable_bar,
)
from lidar_outlier_filter.errors import ParameterError, refusing

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable

    from lidar_outlier_filter.archive.jobs import Task
    from lidar_outlier_filter.cli.terminal import Commands
    from lidar_outlier_filter.files.judged_file import CleanOptions, JudgedFile
    from lidar_outlier_filter.report.worst import Worst

    Inspect = Callable[[JudgedFile], Worst | None]

CLEANED, OUTLIERS = '_cleaned', '_outliers'  # suffixes of the stem of an output
EXAMPLES = """\
examples:
  lidar-outlier-filter clean street.laz --dry-run --picture worst.png
  lidar-outlier-filter clean strips --output cleaned --ignore-classes 7,18"""


def add_clean(commands: Commands) -> None:
    """Add the command ``clean``."""
    parser = commands.add_parser(
        'clean',
        help='filter files of points',
        description='Judge all points of a file together, and write a copy with every attribute '
        'kept. Reads and writes LAS, LAZ, PCD, PLY, PTX, CSV, Parquet, and tables of SQLite '
        'databases; reads E57, written as PLY. Each copy gets a log, NAME.json. '
        'alpha_beta_gamma needs a time and scan lines (LAS: gps_time, and the scan direction, '
        'angle or edges; others: columns such as time and ring); boosted_trees uses them if there '
        'are any. Exit status: 0 all done; 1 all refused, nothing written; 3 a file was refused '
        'or fully untested, or matplotlib is missing.',
        epilog=EXAMPLES,
    )
    add = parser.add_argument
    add('files', type=Path, nargs='+', metavar='FILE', help='clouds, or folders of clouds')
    _add_outputs(parser)
    _add_marks(parser)
    add(
        '--strips',
        action='store_true',
        help='judge the points of each point_source_id (LAS) separately: the strips of a flight',
    )
    add_worker_options(parser)
    add(
        '--tile',
        type=float,
        default=0.0,
        metavar='METRES',
        help='keep large arrays in files, for clouds larger than memory; quadric judges in square '
        'tiles of this side, and its verdicts depend on it; a tile should hold about a million '
        'points. Default: 0, in memory',
    )
    add(
        '--columns',
        metavar='X,Y[,Z]',
        help='the two or three coordinates; default: x,y,z. Columns of a text file without a '
        'header are called 1, 2, 3: --columns 1,2,3',
    )
    add(
        '--unit',
        choices=('m', 'cm', 'mm', 'ft', 'us-ft'),
        help='unit of the coordinates; default: from the LAS or LAZ header, else metres',
    )
    add('--table', metavar='NAME', help='table of a database; default: the only one')
    add_chain_option(parser)
    add_parameter_options(parser)
    parser.set_defaults(run=_clean)


def _add_outputs(parser: argparse.ArgumentParser) -> None:
    """Add the options for output files."""
    add = parser.add_argument
    add(
        '--output',
        type=Path,
        metavar='PATH',
        help='new file, or the folder for it (for several files: a folder, which is created); '
        'default: FILE_cleaned',
    )
    add(
        '--outliers',
        type=Path,
        metavar='FILE',
        help='new file for the rejected points (--rejected separate); default: FILE_outliers',
    )
    add(
        '--dry-run',
        action='store_true',
        help='write no cloud; print rejected points by detector, class and place, and the '
        'largest groups',
    )
    add(
        '--picture',
        type=Path,
        metavar='FILE.png',
        help='draw a map of rejected points, and the largest groups from the side, as a new PNG; '
        'also in a dry run',
    )


def _add_marks(parser: argparse.ArgumentParser) -> None:
    """Add the options for marking rejected points, and for excluding points by class."""
    add = parser.add_argument
    add(
        '--rejected',
        choices=('mark', 'remove', 'separate'),
        help='mark (default): by classification 7 in LAS, by columns outlier, outlier_score and '
        'outlier_detectors elsewhere (in a database: in a new table), in PTX as missing returns; '
        'remove: leave them out; separate: write them to another file',
    )
    add(
        '--mark',
        choices=('class', 'noise', 'withheld'),
        default='class',
        help='how rejected points of LAS are marked: class (default): 7; noise: 7 below, 18 '
        'above the kept points around; withheld: the withheld flag',
    )
    add(
        '--scores',
        action='store_true',
        help='add outlier_score, outlier_detectors and outlier_reason, in LAS as extra bytes',
    )
    classes = 'C[,C…]'
    add(
        '--only-classes',
        metavar=classes,
        help='LAS classes whose points may be rejected; all others stay as they are',
    )
    add('--keep-classes', metavar=classes, help='LAS classes whose points stay as they are')
    add(
        '--ignore-classes',
        metavar=classes,
        help='LAS classes, such as 7,18 for known noise, whose points stay as they are and are not '
        'used as neighbours',
    )


def _clean(options: argparse.Namespace) -> int:
    parameters = read_parameters(options.params, options.settings, options.chain)
    if options.scores:
        parameters['scores'] = True
    folder = _folder(options)
    is_single = folder is None and len(options.files) == 1
    if is_single:
        _check(options, 1, is_archive=False)
    picture = options.picture if options.picture is None or can_draw() else None
    wanted = bool(options.dry_run or options.picture)
    inspect = partial(_find_worst, picture=picture, wanted=wanted)
    clean = _clean_one if is_single else _clean_many
    status = clean(options, parameters, folder, inspect)
    if picture is not None and picture.is_file():
        show(f'written to {picture}')
    return INCOMPLETE if status == DONE and picture != options.picture else status


def _clean_many(
    options: argparse.Namespace,
    parameters: dict[str, object],
    folder: Path | None,
    inspect: Inspect,
) -> int:
    """Clean several files, or all files of folders."""
    from dataclasses import asdict

    from lidar_outlier_filter.archive.jobs import CleanJob

    tasks = _tasks(options, folder)
    _check(options, len(tasks), is_archive=True)
    job = CleanJob(parameters, asdict(_clean_options(options)), inspect)
    records, results = go_through(tasks, job, options, 'cleaning', folder)
    tables.show_cleaned(tasks, records, results, job)
    return tables.status(records)


def _clean_options(options: argparse.Namespace) -> CleanOptions:
    from lidar_outlier_filter.files.judged_file import MARK, SEPARATE, CleanOptions

    return CleanOptions(
        rejected=options.rejected or (MARK if options.outliers is None else SEPARATE),
        coordinates=names_in(options.columns or ''),
        table=options.table,
        tile=options.tile,
        mark=options.mark,
        strips=options.strips,
        only=_classes(options, 'only'),
        keep=_classes(options, 'keep'),
        ignore=_classes(options, 'ignore'),
        dry=options.dry_run,
        unit=options.unit,
    )


def _clean_one(
    options: argparse.Namespace,
    parameters: dict[str, object],
    folder: Path | None,
    inspect: Inspect,
) -> int:
    """Clean a single file with a progress bar; an error ends the command."""
    from lidar_outlier_filter.files.clean import clean_file
    from lidar_outlier_filter.parameters.filter import FilterParameters

    path, worst = options.files[0].absolute(), list[Any]()
    output, *outliers = (name.absolute() for name in _outputs(path, options, folder, path.name))

    def interrupted() -> str:
        return f'nothing is written to {output}; the same command starts over'

    start = perf_counter()
    with saying_how_far(interrupted), stoppable_bar(path.name) as progress:
        report = clean_file(
            path,
            output,
            FilterParameters().changed(parameters),
            _clean_options(options),
            outliers=options.outliers or next(iter(outliers), None),
            progress=progress,
            slow=lambda slow: say(f'{path}: {slow}'),
            inspect=lambda judged: worst.append(inspect(judged)),
        )
    tables.show_file(path, report, worst[0], perf_counter() - start)
    return INCOMPLETE if report.is_untested else DONE


def _find_worst(judged: JudgedFile, picture: Path | None, *, wanted: bool) -> Worst | None:
    """Find the worst tiles of a file, and draw them, before its outputs are written."""
    if not wanted:
        return None
    from lidar_outlier_filter.report.worst import find

    found = find(judged)
    if picture is not None:
        from lidar_outlier_filter.disk.new_files import new_output
        from lidar_outlier_filter.errors import CloudError
        from lidar_outlier_filter.report.figures import draw_worst

        with new_output(picture, error=CloudError) as built:
            draw_worst(judged, found, built)
    return found


def _folder(options: argparse.Namespace) -> Path | None:
    """Return the output folder; None if outputs are beside inputs, or ``--output`` is a file."""
    output: Path | None = options.output
    roots = [path.resolve() for path in options.files if path.is_dir()]
    if output is None and len(options.files) == len(roots) == 1:
        output = beside(roots[0], CLEANED)
    if output is None or (len(options.files) == 1 and not (output.is_dir() or roots)):
        if roots:
            raise ParameterError('--output of a folder and others', 'given', 'none')
        return None
    if output.exists() and not output.is_dir():
        raise ParameterError('--output of several files', 'a folder', output)
    for root in roots:
        refuse_inside(output, root)
    if not options.dry_run:
        with refusing(ParameterError, f'--output {output}', 'a folder', OSError):
            output.mkdir(parents=True, exist_ok=True)
    return output


def _check(options: argparse.Namespace, count: int, *, is_archive: bool) -> None:
    """Refuse conflicting options."""
    from lidar_outlier_filter.disk.new_files import FILE, check_new

    check_workers(options, is_archive=is_archive)
    for name, value in (('--outliers', options.outliers), ('--picture', options.picture)):
        if value and count > 1:
            raise ParameterError(name, 'given for one file', f'{count} files')
        if value and (options.scheduler or options.scheduler_file):
            raise ParameterError(name, 'left out with --scheduler', value)
    if options.picture and options.picture.suffix.lower() != '.png':
        raise ParameterError('--picture', 'a name that ends with .png', options.picture)
    if options.picture:
        check_new(options.picture, FILE, ParameterError, '--picture')


def _tasks(options: argparse.Namespace, folder: Path | None) -> list[Task]:
    """List the tasks of all files; folders are searched recursively."""
    from lidar_outlier_filter.archive.locations import find_files
    from lidar_outlier_filter.files.cloud_file import SUFFIXES
    from lidar_outlier_filter.files.text import is_prose

    tasks = []
    for path in options.files:
        if not path.is_dir() or folder is None:
            tasks.append(_task(path, options, folder, path.name))
            continue
        root = path.resolve()
        for file in find_files(root, SUFFIXES):
            if is_prose(file):
                say(f'{file} is skipped: it is text without columns of numbers')
            else:
                tasks.append(_task(file, options, folder, str(file.relative_to(root))))
    return tasks


def _task(path: Path, options: argparse.Namespace, folder: Path | None, source: str) -> Task:
    """Return the task of one file."""
    from lidar_outlier_filter.archive.jobs import Task
    from lidar_outlier_filter.archive.locations import Location, location_of

    outputs = _outputs(path, options, folder, source)
    folder = outputs[0].parent if folder is None else folder
    is_file = path.is_file()  # if not, opening it reports the error
    location = location_of(path.absolute()) if is_file else Location(path.absolute(), 0, '')
    names = tuple(str(output.relative_to(folder)) for output in outputs)
    return Task(location, source, folder.absolute(), names)


def _outputs(
    path: Path, options: argparse.Namespace, folder: Path | None, source: str
) -> list[Path]:
    """Return the paths of a file's outputs, in ``folder`` or else beside the file."""
    from lidar_outlier_filter.files.cloud_file import copy_suffix
    from lidar_outlier_filter.files.judged_file import SEPARATE

    name = path.stem + CLEANED + copy_suffix(path)
    if folder is not None:
        output = folder / Path(source).with_name(name)
    else:
        output = options.output or path.with_name(name)
    if options.rejected != SEPARATE or options.outliers is not None:
        return [output]
    stem = output.stem.removesuffix(CLEANED)
    return [output, output.with_name(stem + OUTLIERS + output.suffix)]


def _classes(options: argparse.Namespace, option: str) -> tuple[int, ...]:
    """Parse classes: integers separated by commas."""
    text = getattr(options, f'{option}_classes') or ''
    names = names_in(text)
    if not all(name.isdecimal() for name in names):
        must_be = 'whole numbers, with commas between'
        raise ParameterError(f'--{option}-classes', must_be, text)
    return tuple(map(int, names))
