# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Who cleans one file of many: a thread of this process, or a worker of a cluster."""

from __future__ import annotations

from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.disk.new_files import new_files
from lidar_outlier_filter.files.cleaning.clean import clean, list_logs

if TYPE_CHECKING:
    from collections.abc import Callable, Collection
    from concurrent.futures import Future
    from pathlib import Path

    from lidar_outlier_filter.annotations import Progress
    from lidar_outlier_filter.core.judging.slow import SaySlow
    from lidar_outlier_filter.files.cleaning.clean import MakeFiles
    from lidar_outlier_filter.files.cleaning.clean_log import CleanReport, Wanted
    from lidar_outlier_filter.files.cleaning.judged_file import JudgedFile

STEP = 0.2  # seconds between two looks at whether to go on
JUDGE = 'lidar_outlier_filter.files.cleaning.clean'  # the module whose code decides what is written
HERE = 'this process'


@dataclass(frozen=True)
class Job:
    """A file, and the clouds that are made of it."""

    path: Path
    output: Path
    outliers: Path | None = None

    @property
    def outputs(self) -> list[Path]:
        """All files that are written of it."""
        clouds = [self.output] if self.outliers is None else [self.output, self.outliers]
        return [*clouds, *list_logs(self.output)]

    def absolute(self) -> Job:
        """Return the same for a process that works in another folder."""
        outliers = None if self.outliers is None else self.outliers.absolute()
        return Job(self.path.absolute(), self.output.absolute(), outliers)


@dataclass(frozen=True)
class CleanedFile:
    """What became of a file: the report, what ``look`` found in it, and who cleaned it."""

    report: CleanReport
    found: Any = None
    worker: str = HERE


def clean_job(  # noqa: PLR0913  which file, how, three callbacks, and who makes the files
    job: Job,
    wanted: Wanted,
    look: Callable[[JudgedFile], object] = bool,
    progress: Progress = lambda _done, _total, _what: None,
    slow: SaySlow | None = None,
    make: MakeFiles = new_files,
) -> CleanedFile:
    """Clean a file; keep what ``look`` finds in it.

    Raises
    ------
    FilterError
        If it cannot be cleaned.

    """
    found: list[object] = []

    def note(judged: JudgedFile) -> None:
        found.append(look(judged))

    report = clean(job.path, job.output, wanted, job.outliers, progress, slow, note, make)
    return CleanedFile(report, found[0])


class ThreadsThatClean:
    """Threads of this process; the kernels of each use all cores."""

    def __init__(self, count: int, work: Callable[[Job], CleanedFile]) -> None:
        """Start so many, each of which does ``work``."""
        self.at_once, self._work = count, work
        self._pool = ThreadPoolExecutor(count)

    def submit(self, job: Job) -> Future[CleanedFile]:
        """See :class:`.Hands`."""
        return self._pool.submit(self._work, job)

    def first_done(
        self, futures: Collection[Future[CleanedFile]]
    ) -> Collection[Future[CleanedFile]]:
        """See :class:`.Hands`."""
        return wait(futures, STEP, FIRST_COMPLETED).done

    def take(self, _job: Job, future: Future[CleanedFile]) -> CleanedFile:
        """See :class:`.Hands`."""
        return future.result()

    def end(self) -> None:
        """Leave what has not begun, and wait for the rest."""
        self._pool.shutdown(cancel_futures=True)
