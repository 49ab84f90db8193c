# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``clean``. What many files need is imported for them only."""

# ruff: noqa: PLC0415  as said above

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.cli import tables
from lidar_outlier_filter.cli.arguments import check_accepted_share, check_workers
from lidar_outlier_filter.cli.terminal import (
    DONE,
    INCOMPLETE,
    beside,
    can_draw,
    names_in,
    read_parameters,
    refuse_inside,
    say,
    saying_how_far,
    show,
    stoppable_bar,
)
from lidar_outlier_filter.disk.new_files import check_new, new_output
from lidar_outlier_filter.errors import CloudError, ParameterError, refusing
from lidar_outlier_filter.files.clean import clean_file
from lidar_outlier_filter.files.cloud_file import SUFFIXES, UNREAD_SUFFIXES, check_file, split_name
from lidar_outlier_filter.files.judged_file import MARK, SEPARATE, CleanOptions, JudgedFile
from lidar_outlier_filter.files.rejected_list import LISTS
from lidar_outlier_filter.files.text import is_prose
from lidar_outlier_filter.parameters.filter import FilterParameters

if TYPE_CHECKING:
    from lidar_outlier_filter.archive.jobs import Task
    from lidar_outlier_filter.report.worst import Worst

    Inspect = Callable[[JudgedFile], Worst]

CLEANED, OUTLIERS = '_cleaned', '_outliers'  # suffixes of the stem of an output
EACH = tuple(suffix[1:] for suffix in LISTS)  # of --list: a list beside the output of each file


def run_clean(options: argparse.Namespace) -> int:
    """Clean one file, or several; return the exit status."""
    parameters = read_parameters(options.params, options.settings, options.chain)
    if options.scores:
        parameters['scores'] = True
    folder = _folder(options)
    is_single = folder is None and len(options.files) == 1
    if is_single:
        _check(options, 1, is_archive=False)
    picture = options.picture if options.picture is None or can_draw() else None
    is_wanted = options.dry_run or options.picture
    inspect = partial(_find_worst, picture=picture) if is_wanted else None
    clean = _clean_one if is_single else _clean_many
    status = clean(options, parameters, folder, inspect)
    if picture is not None and picture.is_file():
        show(f'written to {picture}')
    return INCOMPLETE if status == DONE and picture != options.picture else status


def _clean_many(
    options: argparse.Namespace,
    parameters: dict[str, object],
    folder: Path | None,
    inspect: Inspect | None,
) -> int:
    from lidar_outlier_filter.archive.jobs import CleanJob
    from lidar_outlier_filter.cli.archive import go_through

    tasks = _tasks(options, folder)
    _check(options, len(tasks), is_archive=True)
    if folder is not None and not options.dry_run:
        with refusing(ParameterError, f'--output {folder}', 'a folder', OSError):
            folder.mkdir(parents=True, exist_ok=True)
    job = CleanJob(parameters, asdict(_clean_options(options)), inspect)
    records, results = go_through(tasks, job, options, 'cleaning', folder)
    tables.show_cleaned(tasks, records, results, job)
    return tables.status(records)


def _clean_options(options: argparse.Namespace) -> CleanOptions:
    return CleanOptions(
        rejected=options.rejected or (MARK if options.outliers is None else SEPARATE),
        coordinates=names_in(options.columns or ''),
        table=options.table,
        tile=options.tile,
        mark=options.mark,
        mark_class=options.mark_class,
        old_class=options.old_class,
        strips=options.strips,
        only=_classes(options, 'only'),
        keep=_classes(options, 'keep'),
        ignore=_classes(options, 'ignore'),
        dry=options.dry_run,
        unit=options.unit,
        accept_share=options.accept_share,
        buffer=options.buffer,
        reasons=options.list is not None,
        trajectory=None if options.trajectory is None else str(options.trajectory.absolute()),
    )


def _clean_one(
    options: argparse.Namespace,
    parameters: dict[str, object],
    folder: Path | None,
    inspect: Inspect | None,
) -> int:
    """Clean a single file with a progress bar; an error ends the command."""
    path, worst = options.files[0].absolute(), list[Any]()
    output, *others = (name.absolute() for name in _outputs(path, options, folder, path.name))
    listed = others.pop() if str(options.list) in EACH else options.list

    def interrupted() -> str:
        return f'nothing is written to {output}; the same command starts over'

    def inspect_judged(judged: JudgedFile) -> None:
        if inspect is not None:
            worst.append(inspect(judged))

    how, start = _clean_options(options), perf_counter()
    with saying_how_far(interrupted), stoppable_bar(path.name) as progress:
        progress(0, 1, 'reading')
        report = clean_file(
            path,
            output,
            FilterParameters().changed(parameters),
            how,
            outliers=options.outliers or next(iter(others), None),
            rejected=listed,
            progress=progress,
            slow=lambda slow: say(f'{path}: {slow}'),
            inspect=inspect_judged,
        )
    tables.show_file(path, report, next(iter(worst), None), perf_counter() - start)
    return INCOMPLETE if report.is_untested else DONE


def _find_worst(judged: JudgedFile, picture: Path | None) -> Worst:
    """Find the worst tiles of a file, and draw them, before its outputs are written."""
    from lidar_outlier_filter.report.worst import find

    found = find(judged)
    if picture is not None:
        from lidar_outlier_filter.report.figures import draw_worst

        with new_output(picture) as built:
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
    return output


def _check(options: argparse.Namespace, count: int, *, is_archive: bool) -> None:
    check_workers(options, is_archive=is_archive)
    each = str(options.list) in EACH
    if each and is_archive and options.dry_run:
        raise ParameterError('--list of several files', 'left out with --dry-run', options.list)
    for name in ('outliers', 'picture') if each else ('outliers', 'picture', 'list'):
        value = getattr(options, name)
        if value and (count > 1 or (is_archive and name == 'list')):
            got = f'{count} files' if count > 1 else 'a folder'
            or_each = f', or {" or ".join(EACH)} for each' if name == 'list' else ''
            raise ParameterError(f'--{name}', f'given for one file{or_each}', got)
        if value and (options.scheduler or options.scheduler_file):
            raise ParameterError(f'--{name}', 'left out with --scheduler', value)
    check_accepted_share(options)
    if options.trajectory is not None:
        check_file(options.trajectory)
    if options.picture and options.picture.suffix.lower() != '.png':
        raise ParameterError('--picture', 'a name that ends with .png', options.picture)
    if options.list and not each and options.list.suffix.lower() not in LISTS:
        raise ParameterError('--list', f'a name that ends with {" or ".join(LISTS)}', options.list)
    if options.picture:
        check_new(options.picture, what='--picture')


def _tasks(options: argparse.Namespace, folder: Path | None) -> list[Task]:
    """List the tasks of all files; folders are searched recursively."""
    from lidar_outlier_filter.archive.locations import find_files

    tasks = []
    for path in options.files:
        if not path.is_dir() or folder is None:
            tasks.append(_task(path, options, folder, path.name))
            continue
        root, before = path.resolve(), len(tasks)
        for file in find_files(root, (*SUFFIXES, *UNREAD_SUFFIXES)):
            if is_prose(file):
                say(f'{file} is skipped: it is text without columns of numbers')
            else:
                tasks.append(_task(file, options, folder, str(file.relative_to(root))))
        if len(tasks) == before:
            raise CloudError(f'the folder {path}', f'one with {" ".join(SUFFIXES)}', 'none')
    return tasks


def _task(path: Path, options: argparse.Namespace, folder: Path | None, source: str) -> Task:
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
    output: Path | None = options.output
    if folder is not None or output is None:
        stem, suffix = split_name(path)
        output = (path if folder is None else folder / source).with_name(stem + CLEANED + suffix)
    outputs = [output]
    if options.rejected == SEPARATE and options.outliers is None:
        stem, suffix = split_name(output)
        outputs.append(output.with_name(stem.removesuffix(CLEANED) + OUTLIERS + suffix))
    if str(options.list) in EACH:
        outputs.append(output.with_name(f'{output.name}.rejected.{options.list}'))
    return outputs


def _classes(options: argparse.Namespace, option: str) -> tuple[int, ...]:
    """Parse classes: integers separated by commas."""
    text = getattr(options, f'{option}_classes') or ''
    names = names_in(text)
    if not all(name.isdecimal() for name in names):
        must_be = 'whole numbers, with commas between'
        raise ParameterError(f'--{option}-classes', must_be, text)
    return tuple(map(int, names))
