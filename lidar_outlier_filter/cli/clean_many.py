# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Several files of ``clean``: their outputs, the bar for all of them, and what became of each."""

# ruff: noqa: PLC0415  help is instant

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, nullcontext
from time import monotonic
from typing import TYPE_CHECKING

from lidar_outlier_filter.cli.archive_progress import progress_of_all
from lidar_outlier_filter.cli.terminal import LINE_PERIOD, say

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from contextlib import AbstractContextManager
    from pathlib import Path

    from lidar_outlier_filter.archive.manifest import Manifest
    from lidar_outlier_filter.archive.many_files import Job, Result
    from lidar_outlier_filter.archive.step import Step
    from lidar_outlier_filter.core.slow import SlowDetector
    from lidar_outlier_filter.files.clean_log import CleanReport, Wanted
    from lidar_outlier_filter.files.judged_file import JudgedFile

PARTS = ('reading', 'judging', 'writing')  # of the work on a file


def clean_many(  # noqa: PLR0913  which files, where to, and how
    jobs: Sequence[Job],
    wanted: Wanted,
    folder: Path | None,
    at_once: int,
    look: Callable[[JudgedFile], object],
    *,
    resume: bool,
) -> list[Result]:
    """Clean several files, so many at once; with a folder, its manifest says what becomes of each.

    Raises
    ------
    FilterError
        If the folder or the manifest cannot be used, or two files have one output.

    """
    from lidar_outlier_filter.archive.many_files import ManyFiles

    with (
        progress_of_all('cleaning') as (show, leave_if_asked),
        _manifest(folder) as manifest,
    ):
        begun = monotonic()
        progress = _ManyFilesProgress(jobs, leave_if_asked, look)
        many = ManyFiles(wanted, manifest, progress.clean, resume=resume)

        def tick() -> None:
            leave_if_asked()
            step = progress.step
            if step.recording and monotonic() - begun > LINE_PERIOD:
                show(step)

        with _threads(at_once) as pool:
            return many.run(jobs, pool, at_once, tick, progress.finish)


def _manifest(folder: Path | None) -> AbstractContextManager[Manifest | None]:
    if folder is None:
        return nullcontext()
    from lidar_outlier_filter.archive.manifest import opened_manifest

    return opened_manifest(folder)


@contextmanager
def _threads(count: int) -> Iterator[ThreadPoolExecutor]:
    """Give threads; where the caller leaves by an exception, what has not begun is left."""
    with ThreadPoolExecutor(count) as pool, ExitStack() as stack:
        stack.callback(pool.shutdown, wait=False, cancel_futures=True)
        yield pool


class _ManyFilesProgress:
    """How far files are that are cleaned at once."""

    def __init__(
        self,
        jobs: Sequence[Job],
        leave_if_asked: Callable[[], None],
        look: Callable[[JudgedFile], object],
    ) -> None:
        self._look = look
        self._sizes = {job.path: _size(job.path) for job in jobs}
        self._leave_if_asked = leave_if_asked
        self._done: set[Path] = set()
        self._shares: dict[Path, tuple[float, int, int]] = {}

    def clean(self, path: Path, output: Path, wanted: Wanted, outliers: Path | None) -> CleanReport:
        """Clean a file, and note how far it is."""
        from lidar_outlier_filter.files.clean import clean

        def note(part: str, done: int, total: int) -> None:
            self._leave_if_asked()
            share = (PARTS.index(part) + done / max(total, 1)) / len(PARTS)
            _, _, points = self._shares.get(path, (0.0, 0, 0))
            # In one piece nobody knows how far the judging is.
            self._shares[path] = share, done, total or points

        def say_slow(slow: SlowDetector) -> None:
            say(f'{path}: {slow}')

        return clean(path, output, wanted, outliers, note, say_slow, self._look)

    def finish(self, job: Job) -> None:
        """Note that nothing more becomes of a file."""
        self._done.add(job.path)

    @property
    def step(self) -> Step:
        """All of it together; the file that is named is the one furthest."""
        from lidar_outlier_filter.archive.step import Step

        running = {path: at for path, at in self._shares.copy().items() if path not in self._done}
        begun = sum(at[0] * self._sizes[path] for path, at in running.items())
        bytes_done = begun + sum(self._sizes[path] for path in self._done)
        path = max(running, key=lambda one: running[one][0], default=None)
        _, done, total = (0.0, 0, 0) if path is None else running[path]
        return Step(
            '' if path is None else path.name,
            len(self._done),
            len(self._sizes),
            done,
            total,
            bytes_done,
            sum(self._sizes.values()),
            'points',
        )


def _size(path: Path) -> int:
    """Return the bytes of a file; whoever opens it says what is wrong with it."""
    try:
        return path.stat().st_size
    except OSError:
        return 0
