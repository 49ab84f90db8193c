# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""``replay`` of many recordings, and of one by whoever has time."""

# ruff: noqa: PLC0415  help is instant

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from lidar_outlier_filter.cli.archive_progress import progress_of_all
from lidar_outlier_filter.cli.archive_tables import show, status
from lidar_outlier_filter.cli.interrupts import stopping
from lidar_outlier_filter.cli.terminal import (
    beside,
    progress_bar,
    read_parameters,
    say,
    saying_how_far,
)
from lidar_outlier_filter.errors import FilterError, RecordingError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Iterator, Sequence

    from lidar_outlier_filter.archive.locations import Location
    from lidar_outlier_filter.archive.manifest import Entry, Manifest
    from lidar_outlier_filter.archive.order import Order
    from lidar_outlier_filter.archive.step import Step
    from lidar_outlier_filter.archive.task import Task
    from lidar_outlier_filter.archive.workers import Workers
    from lidar_outlier_filter.cli.terminal import Advance
    from lidar_outlier_filter.recordings.remote_path import RecordingPath
    from lidar_outlier_filter.recordings.replay import ReplayReport

# Bytes: less is replayed before several processes would have started.
SHORT = 300_000_000
MEGABYTE = 1_000_000  # bytes
PAGE = 'archive.html'


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
    from lidar_outlier_filter.archive.manifest import FAILED, opened_manifest
    from lidar_outlier_filter.archive.run import pending

    found = find_all(options.recording)
    order, folder = _order(options), _folder(options, found)
    tasks = _tasks(found, folder)
    with opened_manifest(folder, say) as manifest:
        todo = pending(tasks, order, manifest)
        before = dict(manifest.entries)

        def how_far() -> str:
            now = [manifest.entries.get(task.source) for task in todo]
            new = (entry for entry in now if entry and entry is not before.get(entry.source))
            done = len(tasks) - len(todo) + sum(entry.state != FAILED for entry in new)
            said = f'{done} of {len(tasks)} recordings are done in {folder}'
            return f'{said}; the same command goes on with the others'

        if todo:
            with saying_how_far(how_far):
                _replay_all(options, found.root.name, todo, order, manifest)
        kept = [manifest.entries[task.source] for task in tasks]
        _write_page(kept, folder)
    show(tasks, kept, todo, folder)
    return status(kept)


def _replay_all(
    options: argparse.Namespace,
    name: str,
    todo: Sequence[Task],
    order: Order,
    manifest: Manifest,
) -> None:
    """Replay what is to be done of an archive, and show how far it is."""
    from lidar_outlier_filter.archive.replayers import Replaying
    from lidar_outlier_filter.archive.run import replay_all

    with (
        progress_of_all(name) as (show, leave_if_asked),
        _hidden(manifest.folder / 'recordings') as hidden,  # there until the workers have ended
        _workers(options, todo) as workers,
    ):
        by = Replaying(workers, hidden, show, leave_if_asked, _once())
        replay_all(todo, order, manifest, by)


def _write_page(entries: Sequence[Entry], folder: RecordingPath) -> None:
    """Write the page of an archive beside its manifest."""
    from tempfile import TemporaryDirectory

    from lidar_outlier_filter.archive.page import write_page

    lines = [asdict(entry) for entry in entries]
    if isinstance(folder, Path):
        write_page(lines, folder / PAGE)
        return
    with TemporaryDirectory(prefix='.lidar_outlier_filter-') as scratch:
        write_page(lines, Path(scratch, PAGE))
        (folder / PAGE).write_from(Path(scratch, PAGE))


def replay_one(options: argparse.Namespace) -> ReplayReport:
    """Replay one recording here, with the kernels on all cores, or by a worker of a cluster."""
    from lidar_outlier_filter.archive.locations import location_of, path_at
    from lidar_outlier_filter.archive.replayers import Replaying
    from lidar_outlier_filter.archive.run import replay_alone
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

        with _hidden(output) as hidden, _workers(options, [task]) as workers:
            return replay_alone(task, order, Replaying(workers, hidden, show, leave_if_asked, say))


def _replay_here(
    task: Task, order: Order, leave_if_asked: Callable[[], object], advance: Advance
) -> ReplayReport:
    """Replay in this process; a killed run may have left what is beside the output."""
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
            resume=order.resume,
            **order.options,
            progress=progress,
            inform=say,
        )
        task.location.check_unchanged()
    return replace(report, output=task.output)


def _order(options: argparse.Namespace) -> Order:
    from lidar_outlier_filter.archive.order import Order

    parameters = read_parameters(options.params, options.settings, options.chain)
    return Order(
        tuple(options.topics),
        parameters,
        options.drop_input,
        options.salvage,
        options.resume and not is_archive(options.recording),  # which goes on by its manifest
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
    if options.resume and options.scheduler is not None and not is_archive(options.recording):
        raise FilterError('--resume', 'left out with --scheduler for one recording', 'given')


@contextmanager
def _hidden(path: RecordingPath) -> Iterator[Path | None]:
    """Give a hidden folder beside a path, for what has no name yet; None: that is on a store."""
    from lidar_outlier_filter.disk.new_files import hidden_folder
    from lidar_outlier_filter.recordings.bags import writable

    if not isinstance(path, Path):
        yield None
        return
    with ExitStack() as stack:
        with writable(path):
            folder = stack.enter_context(hidden_folder(path, 'replayed'))
        yield folder


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
    inside = str(folder.resolve() if isinstance(folder, Path) else folder)
    if found.is_searched and inside.startswith(f'{found.root}/'):
        raise RecordingError('the output', f'outside of {found.root}, which is searched', folder)
    return folder


def _tasks(found: FoundRecordings, folder: RecordingPath) -> list[Task]:
    """Name the output of each recording as it is named below the folder that was searched."""
    from lidar_outlier_filter.archive.task import Task

    tasks: dict[RecordingPath, Task] = {}
    for location in found.locations:
        inside = str(location.path)[len(str(found.root)) :].lstrip('/')
        suffix = '' if location.is_folder else location.path.suffix
        output = folder / inside.removesuffix(suffix)
        if output in tasks:
            got = f'{tasks[output].location.path} and {location.path}'
            raise RecordingError(f'the output {output}', 'that of one recording', got)
        tasks[output] = Task(location, output, inside.count('/') + 1)
    return list(tasks.values())


def _once() -> Callable[[str], object]:
    """Say each sentence once: most recordings of an archive are read alike."""
    said: set[str] = set()

    def inform(sentence: str) -> None:
        if sentence not in said:
            said.add(sentence)
            say(sentence)

    return inform
