# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Several files of ``clean``: their outputs, the bar for all of them, and what became of each."""

# ruff: noqa: PLC0415  help is instant

from __future__ import annotations

from contextlib import contextmanager
from functools import partial
from time import monotonic
from typing import TYPE_CHECKING

from lidar_outlier_filter.cli.archive_progress import progress_of_all
from lidar_outlier_filter.cli.terminal import LINE_PERIOD, say, saying_how_far

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from lidar_outlier_filter.archive.file_cleaners import CleanedFile, Job
    from lidar_outlier_filter.archive.manifest import Manifest
    from lidar_outlier_filter.archive.many_files import ManyFiles, Result
    from lidar_outlier_filter.archive.step import Step
    from lidar_outlier_filter.archive.work import Hands
    from lidar_outlier_filter.core.judging.slow import SlowDetector
    from lidar_outlier_filter.files.cleaning.clean_log import Wanted
    from lidar_outlier_filter.files.cleaning.judged_file import JudgedFile

    Watch = Callable[[JudgedFile], object]

PARTS = ('reading', 'judging', 'writing')  # of the work on a file


def clean_many(  # noqa: PLR0913  which files, how, where to, and by whom
    jobs: Sequence[Job],
    wanted: Wanted,
    folder: Path | None,
    by: int | str,
    look: Watch,
    *,
    resume: bool,
) -> list[Result]:
    """Clean several files ``by`` so many threads, or by the workers of the scheduler of an address.

    With a folder, its manifest says what becomes of each, unless nothing is written.

    Raises
    ------
    FilterError
        If the folder or the manifest cannot be used, or two files have one output.

    """
    from lidar_outlier_filter.archive.many_files import ManyFiles

    with (
        progress_of_all('cleaning') as (show, leave_if_asked),
        _opened(None if wanted.dry else folder) as (manifest, hidden),
    ):
        begun = monotonic()
        progress = _ManyFilesProgress(jobs, wanted, leave_if_asked, look)
        many = ManyFiles(wanted, manifest, resume=resume)

        def tick() -> None:
            leave_if_asked()
            step = progress.step
            if step.recording and monotonic() - begun > LINE_PERIOD:
                show(step)

        by_whom = (
            _threads(by, progress) if isinstance(by, int) else _workers(by, wanted, look, hidden)
        )
        with saying_how_far(partial(_how_far, many, len(jobs), folder)), by_whom as cleaners:
            results = many.run(jobs, cleaners, tick, progress.finish)
        if manifest is not None and folder is not None:
            _write_page(manifest, folder)
        return results


def _how_far(many: ManyFiles, total: int, folder: Path | None) -> str:
    """Say how many files are done, and how to go on."""
    from lidar_outlier_filter.archive.manifest import FAILED

    done = sum(result.state != FAILED for result in many.results.values())
    said = f'{done} of {total} files are done'
    if folder is None:
        return f'{said}; the same command cleans the others, and refuses these'
    return f'{said} in {folder}; the same command with --resume goes on with the others'


def _write_page(manifest: Manifest, folder: Path) -> None:
    """Write the page on all files of a folder beside its manifest."""
    from dataclasses import asdict

    from lidar_outlier_filter.archive.page import write_page
    from lidar_outlier_filter.cli.archive import PAGE

    lines = [asdict(manifest.entries[source]) for source in sorted(manifest.entries)]
    write_page(lines, folder / PAGE, 'file')


@contextmanager
def _opened(folder: Path | None) -> Iterator[tuple[Manifest | None, Path | None]]:
    """Open the manifest of a folder; give a hidden folder in it, too, for what is not whole yet."""
    if folder is None:
        yield None, None
        return
    from lidar_outlier_filter.archive.manifest import opened_manifest
    from lidar_outlier_filter.disk.new_files import hidden_folder

    with opened_manifest(folder, say) as manifest, hidden_folder(folder / 'files') as hidden:
        yield manifest, hidden


@contextmanager
def _threads(count: int, progress: _ManyFilesProgress) -> Iterator[Hands[Job]]:
    from lidar_outlier_filter.archive.file_cleaners import ThreadsThatClean

    yield ThreadsThatClean(count, progress.clean)


@contextmanager
def _workers(
    address: str, wanted: Wanted, look: Watch, hidden: Path | None
) -> Iterator[Hands[Job]]:
    from lidar_outlier_filter.archive.file_workers import WorkersThatClean
    from lidar_outlier_filter.archive.workers import cluster_workers

    with cluster_workers(address, say) as workers:
        yield WorkersThatClean(workers, wanted, look, hidden)


class _ManyFilesProgress:
    """How far files are that are cleaned at once."""

    def __init__(
        self,
        jobs: Sequence[Job],
        wanted: Wanted,
        leave_if_asked: Callable[[], None],
        look: Watch,
    ) -> None:
        from lidar_outlier_filter.archive.step import Progress

        self._wanted, self._look = wanted, look
        self._leave_if_asked = leave_if_asked
        self._progress = Progress({str(job.path): _size(job.path) for job in jobs}, 'points')

    def clean(self, job: Job) -> CleanedFile:
        """Clean a file, and note how far it is."""
        from lidar_outlier_filter.archive.file_cleaners import clean_job

        path = job.path

        def note(done: int, total: int, part: str) -> None:
            self._leave_if_asked()
            share = (PARTS.index(part) + done / max(total, 1)) / len(PARTS)
            # In one piece nobody knows how far the judging is.
            self._progress.note(str(path), done, total, share)

        def say_slow(slow: SlowDetector) -> None:
            say(f'{path}: {slow}')

        return clean_job(job, self._wanted, self._look, note, say_slow)

    def finish(self, job: Job) -> None:
        """Note that nothing more becomes of a file."""
        self._progress.finish(str(job.path))

    @property
    def step(self) -> Step:
        """All of it together; the file that is named is the one furthest, or the last one done."""
        return self._progress.step


def _size(path: Path) -> int:
    """Return the bytes of a file; whoever opens it says what is wrong with it."""
    try:
        return path.stat().st_size
    except OSError:
        return 0
