# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""``replay`` of many recordings, and of one by whoever has time."""

# ruff: noqa: PLC0415  help is instant

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from lidar_outlier_filter.cli.archive_run import go_through, hidden_in, refuse_inside
from lidar_outlier_filter.cli.archive_tables import show, status
from lidar_outlier_filter.cli.interrupts import stopping
from lidar_outlier_filter.cli.terminal import (
    beside,
    progress_bar,
    read_parameters,
    say,
    saying_how_far,
)
from lidar_outlier_filter.errors import FilterError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Iterator, Sequence

    from lidar_outlier_filter.archive.locations import Location
    from lidar_outlier_filter.archive.one_recording import ReplayOrder
    from lidar_outlier_filter.archive.step import Step
    from lidar_outlier_filter.archive.task import Task
    from lidar_outlier_filter.archive.workers import Workers
    from lidar_outlier_filter.cli.terminal import Advance
    from lidar_outlier_filter.recordings.remote_path import RecordingPath
    from lidar_outlier_filter.recordings.replay import ReplayReport

# Bytes: less is replayed before several processes would have started.
SHORT = 300_000_000
MEGABYTE = 1_000_000  # bytes


@dataclass(frozen=True)
class FoundRecordings:
    """The recordings of a folder, which is searched, or those that fit a pattern, below a root."""

    root: RecordingPath
    is_searched: bool
    locations: Sequence[Location]

    @property
    def size(self) -> int:
        """Count bytes."""
        return sum(location.size for location in self.locations)


def is_archive(address: str) -> bool:
    """Return whether an address is that of a folder of recordings, or a pattern."""
    from lidar_outlier_filter.archive.locations import METADATA, path_at

    path = path_at(address)
    if not path.exists():
        return any(letter in address for letter in '*?[')
    if not path.is_dir() or (path / METADATA).exists():
        return False
    # A recording that was not closed has no metadata, but files that are named after its folder.
    return not any(
        one.suffix in {'.mcap', '.db3'} and one.name.startswith(path.name) for one in path.iterdir()
    )


def find_all(address: str) -> FoundRecordings:
    """Find the recordings of a folder, or those that a pattern fits.

    Raises
    ------
    RecordingError
        If there are none.

    """
    from lidar_outlier_filter.archive.locations import find, path_at

    path = path_at(address)
    if isinstance(path, Path):
        path = path.resolve()
    locations, is_searched = find([str(path)]), path.exists()
    while not path.exists():
        path = path.parent
    return FoundRecordings(path, is_searched, locations)


def replay_archive(options: argparse.Namespace) -> int:
    """Replay all recordings of a folder or a pattern into one folder."""
    found = find_all(options.recording)
    order, folder = _order(options), _folder(options, found)
    tasks = _tasks(found, folder)
    workers = partial(_workers, options)
    entries, tried = go_through(tasks, order, folder, found.root.name, workers)
    show(tasks, entries, tried, order, folder)
    return status(entries)


def replay_one(options: argparse.Namespace) -> ReplayReport:
    """Replay one recording here, with the kernels on all cores, or by a worker of a cluster."""
    from lidar_outlier_filter.archive.hands import ByWhom
    from lidar_outlier_filter.archive.locations import location_of, path_at
    from lidar_outlier_filter.archive.run import run_alone
    from lidar_outlier_filter.archive.task import Task

    path = path_at(options.recording)
    output = _output(options, path)
    task, order = Task(location_of(path), output), _order(options)
    with (
        saying_how_far(lambda: f'nothing is written to {output}; the same command begins anew'),
        stopping() as leave_if_asked,
        progress_bar(path.name) as advance,
    ):
        if options.scheduler is None:
            return _replay_here(task, order, leave_if_asked, advance)

        def show(step: Step) -> None:
            advance(step.done, step.messages)

        with hidden_in(output) as hidden, _workers(options, [task]) as workers:
            by = ByWhom(workers, hidden, show, leave_if_asked, say)
            report: ReplayReport = run_alone(task, order, by)
            return report


def _replay_here(
    task: Task, order: ReplayOrder, leave_if_asked: Callable[[], object], advance: Advance
) -> ReplayReport:
    """Replay in this process."""
    from lidar_outlier_filter.archive.locations import staged
    from lidar_outlier_filter.archive.uploads import published
    from lidar_outlier_filter.recordings.replay import replay

    def progress(done: int, total: int) -> None:
        leave_if_asked()
        advance(done, total)

    with published(task.output) as built, staged(task.location) as path:
        report = replay(
            path,
            built,
            parameters=order.parameters,
            **order.options,
            progress=progress,
            inform=say,
        )
        task.location.check_unchanged()
    return replace(report, output=task.output)


def _order(options: argparse.Namespace) -> ReplayOrder:
    from lidar_outlier_filter.archive.one_recording import ReplayOrder

    parameters = read_parameters(options.params, options.settings, options.chain)
    return ReplayOrder(
        tuple(options.topics),
        parameters,
        options.drop_input,
        options.salvage,
        options.largest_message * MEGABYTE,
    )


@contextmanager
def _workers(options: argparse.Namespace, todo: Sequence[Task]) -> Iterator[Workers | None]:
    """Start workers, or use those of a cluster; None: this process replays."""
    from lidar_outlier_filter.archive.workers import are_available, cluster_workers, local_workers
    from lidar_outlier_filter.core.kernels.threads import cores

    jobs = options.jobs
    if jobs is None:
        size = sum(task.location.size for task in todo)
        jobs = cores() if are_available() and size >= SHORT else 1
    jobs = min(jobs, len(todo))
    if options.scheduler is not None:
        with cluster_workers(options.scheduler, say) as workers:
            yield workers
    elif jobs > 1:
        with local_workers(jobs) as workers:
            yield workers
    else:
        yield None


def check_workers(options: argparse.Namespace) -> None:
    """Refuse options that no workers can follow.

    Raises
    ------
    FilterError
        If there is one.

    """
    if options.jobs is not None and options.jobs < 1:
        raise FilterError('--jobs', 'at least 1', options.jobs)
    if options.jobs is not None and options.scheduler is not None:
        must_be = 'left out with --scheduler, whose cluster has its own processes'
        raise FilterError('--jobs', must_be, options.jobs)


def _output(options: argparse.Namespace, path: RecordingPath) -> RecordingPath:
    """Return the output that is given, or name one beside what is replayed."""
    from lidar_outlier_filter.archive.locations import path_at

    if options.output is not None:
        return path_at(options.output)
    if not isinstance(path, Path):
        raise FilterError('--output', 'given for recordings of a store', 'none')
    return beside(path, '_cleaned')


def _folder(options: argparse.Namespace, found: FoundRecordings) -> RecordingPath:
    """Name the folder of the outputs; refuse one that the next run would search."""
    folder = _output(options, found.root)
    if found.is_searched:
        refuse_inside(folder, found.root)
    return folder


def _tasks(found: FoundRecordings, folder: RecordingPath) -> list[Task]:
    """Name the output of each recording as it is named below the folder that was searched."""
    from lidar_outlier_filter.archive.task import Task

    tasks = []
    for location in found.locations:
        inside = str(location.path)[len(str(found.root)) :].lstrip('/')
        suffix = '' if location.is_folder else location.path.suffix
        output = folder / inside.removesuffix(suffix)
        tasks.append(Task(location, output, inside.count('/') + 1))
    return tasks
