# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Many recordings or files by one command: manifest, progress, how to go on, and the page."""

# ruff: noqa: PLC0415  help is instant

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.cli.archive_progress import progress_of_all
from lidar_outlier_filter.cli.terminal import say, saying_how_far
from lidar_outlier_filter.errors import RecordingError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from contextlib import AbstractContextManager

    from lidar_outlier_filter.archive.manifest import Entry, Manifest
    from lidar_outlier_filter.archive.order import One, Order
    from lidar_outlier_filter.archive.workers import Workers
    from lidar_outlier_filter.recordings.remote_path import RecordingPath

PAGE = 'archive.html'


def go_through(  # noqa: PLR0913  which, how, where to, by whom
    tasks: Sequence[One],
    order: Order[One],
    folder: RecordingPath | None,
    name: str,
    workers: Callable[[Sequence[One]], AbstractContextManager[Workers | None]],
    threads: int = 1,
    keep: Callable[[One, Any], object] = lambda _task, _made: None,
) -> tuple[list[Entry], list[One]]:
    """Work on what the manifest of a folder does not prove; without one, on all.

    ``keep`` is called with what was made. Return the entries of all, and what was worked on.

    Raises
    ------
    FilterError
        If the folder or the manifest cannot be used, or two outputs have one name.
    SchedulerError
        If the scheduler goes away.

    """
    from lidar_outlier_filter.archive.hands import ByWhom
    from lidar_outlier_filter.archive.manifest import opened_manifest
    from lidar_outlier_filter.archive.run import pending, run_all

    _check_outputs(tasks, order)
    with opened_manifest(folder, say) as manifest:
        todo = pending(tasks, order, manifest)
        if todo:
            with (
                saying_how_far(_how_far(tasks, todo, order, manifest)),
                progress_of_all(name) as (show, leave_if_asked),
                hidden_in(folder and folder / f'{order.what}s') as hidden,  # until workers ended
                workers(todo) as some,
            ):
                by = ByWhom(some, hidden, show, leave_if_asked, _once(), threads)
                run_all(todo, order, manifest, by, keep)
        if folder is not None:
            _write_page(manifest, folder, order.what)
        return [manifest.entries[task.source] for task in tasks], todo


def _check_outputs(tasks: Sequence[One], order: Order[One]) -> None:
    """Refuse two with one output."""
    known: dict[str, One] = {}
    for task in tasks:
        other = known.setdefault(str(task.output), task)
        if other is not task:
            got = f'{other.location.path} and {task.location.path}'
            raise order.error(f'the output {task.output}', f'that of one {order.what}', got)


def _how_far(
    tasks: Sequence[One], todo: Sequence[One], order: Order[One], manifest: Manifest
) -> Callable[[], str]:
    """Give what says how many are done, and how to go on."""
    from lidar_outlier_filter.archive.manifest import FAILED

    before = dict(manifest.entries)

    def how_far() -> str:
        now = [manifest.entries.get(task.source) for task in todo]
        new = (entry for entry in now if entry and entry is not before.get(entry.source))
        done = len(tasks) - len(todo) + sum(entry.state != FAILED for entry in new)
        said = f'{done} of {len(tasks)} {order.what}s are done'
        if manifest.folder is None:
            return f'{said}; the same command {order.verb} the others, and refuses these'
        return f'{said} in {manifest.folder}; the same command goes on with the others'

    return how_far


def _write_page(manifest: Manifest, folder: RecordingPath, what: str) -> None:
    """Write the page on all that the manifest names beside it."""
    from tempfile import TemporaryDirectory

    from lidar_outlier_filter.archive.page import write_page

    lines = [asdict(manifest.entries[source]) for source in sorted(manifest.entries)]
    if isinstance(folder, Path):
        write_page(lines, folder / PAGE, what)
        return
    with TemporaryDirectory(prefix='.lidar_outlier_filter-') as scratch:
        write_page(lines, Path(scratch, PAGE), what)
        (folder / PAGE).write_from(Path(scratch, PAGE))


@contextmanager
def hidden_in(path: RecordingPath | None) -> Iterator[Path | None]:
    """Give a hidden folder beside a path, for what has no name yet; None: it has none here."""
    from lidar_outlier_filter.disk.new_files import hidden_folder
    from lidar_outlier_filter.recordings.bags import writable

    if not isinstance(path, Path):
        yield None
        return
    with ExitStack() as stack:
        with writable(path):
            folder = stack.enter_context(hidden_folder(path, 'made'))
        yield folder


def refuse_inside(folder: RecordingPath, root: RecordingPath) -> None:
    """Refuse a folder of outputs that the next run would search.

    Raises
    ------
    RecordingError
        If it is one.

    """
    inside = str(folder.resolve() if isinstance(folder, Path) else folder)
    if inside.startswith(f'{root}/'):
        raise RecordingError('the output', f'outside of {root}, which is searched', folder)


def _once() -> Callable[[str], object]:
    """Say each sentence once: most recordings of an archive are read alike."""
    said: set[str] = set()

    def inform(sentence: str) -> None:
        if sentence not in said:
            said.add(sentence)
            say(sentence)

    return inform
