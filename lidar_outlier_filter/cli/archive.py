# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Many recordings or files by one command: which ones, by which processes, progress, and page."""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from lidar_outlier_filter.archive import workers
from lidar_outlier_filter.archive.jobs import Job, ReplayJob, Result, Task
from lidar_outlier_filter.archive.locations import (
    PATTERN,
    find,
    is_recording,
    location_of,
    path_at,
    staged,
)
from lidar_outlier_filter.archive.page import PAGE, check_page, write_page
from lidar_outlier_filter.archive.publish import locked, new_bag
from lidar_outlier_filter.archive.run import Run, pending, refuse_taken_names
from lidar_outlier_filter.archive.sidecar import ArchiveRecord, read_folder
from lidar_outlier_filter.archive.workers import Workers
from lidar_outlier_filter.cli.tables import say_implausible, show_replayed, status
from lidar_outlier_filter.cli.terminal import (
    IMPLAUSIBLE,
    beside,
    progress_bar,
    read_parameters,
    refuse_inside,
    say,
    saying_how_far,
    stoppable_bar,
    stopping,
)
from lidar_outlier_filter.core.kernels.threads import cores
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.recordings.remote_path import RecordingPath
from lidar_outlier_filter.recordings.replay import ReplayReport, replay

MIN_SHARED_BYTES = 300_000_000  # less is done before several processes have started
MEGABYTE = 1_000_000


def is_archive(address: str) -> bool:
    """Return whether an address is a folder of recordings, or a pattern."""
    path = path_at(address)
    if not path.exists():
        return any(letter in address for letter in PATTERN)
    return path.is_dir() and not is_recording(path)


def replay_archive(options: argparse.Namespace) -> int:
    """Replay all recordings of a folder or a pattern into one folder; return the exit status."""
    path = path_at(options.recording)
    root = path.resolve() if isinstance(path, Path) else path
    locations, is_searched = find(str(root)), root.exists()
    while not root.exists():
        root = root.parent
    output = _output(options, root)
    folder = output.absolute() if isinstance(output, Path) else output
    if is_searched:
        refuse_inside(folder, root)
    parameters = read_parameters(options.params, options.settings, options.chain)
    job = ReplayJob(parameters, _replay_options(options))
    tasks = []
    for location in locations:
        name = str(location.path)[len(str(root)) :].lstrip('/')
        suffix = '' if location.is_folder else location.path.suffix
        tasks.append(Task(location, name, folder, (name.removesuffix(suffix),)))
    records, results = go_through(tasks, job, options, root.name, folder)
    show_replayed(tasks, records, results, job, folder)
    if any(record.is_failed for record in records) and not options.salvage:
        say('--salvage filters what can be read of damaged recordings')
    accepted = options.accept_share
    odd = [say_implausible(record.source, record.topics, accepted) for record in records]
    return IMPLAUSIBLE if any(odd) else status(records)


def replay_one(options: argparse.Namespace) -> ReplayReport:
    """Replay one recording in this process, with the kernels on all cores."""
    path = path_at(options.recording)
    output = _output(options, path)
    location = location_of(path)
    parameters = read_parameters(options.params, options.settings, options.chain)
    with (
        saying_how_far(lambda: f'nothing is written to {output}; the same command starts over'),
        stoppable_bar(path.name) as progress,
        new_bag(output) as built,
        staged(location) as source,
    ):
        report = replay(
            source,
            built,
            parameters=parameters,
            **_replay_options(options),
            progress=progress,
            inform=say,
        )
        location.check_unchanged()
    return replace(report, output=output)


def _replay_options(options: argparse.Namespace) -> dict[str, Any]:
    return {
        'topics': tuple(options.topics),
        'drop_input': options.drop_input,
        'salvage': options.salvage,
        'largest': options.largest_message * MEGABYTE,
    }


def _output(options: argparse.Namespace, path: RecordingPath) -> RecordingPath:
    """Return the output that is given, or name one beside the input."""
    if options.output is not None:
        return path_at(options.output)
    if not isinstance(path, Path):
        raise FilterError('--output', 'given for recordings of a store', 'none')
    return beside(path, '_cleaned')


def go_through(
    tasks: Sequence[Task],
    job: Job,
    options: argparse.Namespace,
    name: str,
    folder: RecordingPath | None,
) -> tuple[list[ArchiveRecord], dict[Task, Result]]:
    """Do a job for all tasks that are not done; write the page of ``folder``, if there is one.

    Return the records of all, and the results of the tasks that were done or tried now.

    Raises
    ------
    FilterError
        If two outputs have one name, another's file has that of the page, or another run works in
        an output folder.
    SchedulerError
        If the scheduler is gone.

    """
    refuse_taken_names(tasks, job, {str(folder / PAGE): 'the page'} if folder is not None else {})
    page_folder = None if job.dry else folder
    results: dict[Task, Result] = {}

    def how_far() -> str:
        count = sum(not record.is_failed for record in records.values())
        said = f'{count} of {len(tasks)} {job.what}s are done'
        return f'{said}; the same command continues with the others'

    with ExitStack() as locks:
        for path in {task.folder for task in tasks} if not job.dry else ():
            locks.enter_context(locked(path))
        if page_folder is not None:
            check_page(page_folder)
        todo, records = pending(tasks, job)
        if todo:
            with ExitStack() as stack:
                stack.enter_context(saying_how_far(how_far))
                leave = stack.enter_context(stopping())
                shown = stack.enter_context(progress_bar(name, lines=True))
                workers = stack.enter_context(_workers(options, todo, job))
                for task, result in Run(job, workers, shown, leave, cache(say)).all(todo):
                    results[task], records[task] = result, result.record
        if page_folder is not None:
            failed = [record for record in records.values() if record.is_failed]
            written = {record.source: record for record in (*read_folder(page_folder), *failed)}
            write_page(written.values(), page_folder, job.what)
    return [records[task] for task in tasks], results


@contextmanager
def _workers(options: argparse.Namespace, todo: Sequence[Task], job: Job) -> Iterator[Workers]:
    """Choose the workers: a cluster, processes of this machine, or this process.

    Small files are cleaned by threads: they are done before several processes have started.
    """
    is_large = sum(task.location.size for task in todo) >= MIN_SHARED_BYTES
    by_processes = is_large and workers.are_available()
    jobs = options.jobs
    if job.what == 'recording':
        by_processes = jobs is not None or by_processes
    if jobs is None:
        jobs = cores() if by_processes or job.what == 'file' else 1
    jobs = min(jobs, len(todo))
    with ExitStack() as stack:
        if options.scheduler or options.scheduler_file:
            found = workers.cluster_workers(options.scheduler, options.scheduler_file, cache(say))
        elif by_processes and jobs > 1:
            found = workers.local_workers(jobs)
        else:
            found = workers.threads(jobs)
        yield stack.enter_context(found)
