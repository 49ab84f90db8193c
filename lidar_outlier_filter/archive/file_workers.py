# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Whole files that workers clean; this process puts the outputs under their names.

A worker writes each time it tries a file into another hidden folder of this run. So neither a
worker that dies, nor one that was given up and still works, spoils an output.
"""

from __future__ import annotations

import shutil
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.archive.file_cleaners import JUDGE, CleanedFile, Job, clean_job
from lidar_outlier_filter.archive.fingerprints import judging_code
from lidar_outlier_filter.archive.worker_start import name_of_worker
from lidar_outlier_filter.archive.workers import check_code
from lidar_outlier_filter.disk.new_files import new_files
from lidar_outlier_filter.errors import CloudError, FilterError

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Sequence

    from lidar_outlier_filter.archive.workers import Workers
    from lidar_outlier_filter.files.cleaning.clean_log import Wanted
    from lidar_outlier_filter.files.cleaning.judged_file import JudgedFile


@dataclass(frozen=True)
class Attempt:
    """A file that a worker cleaned: where its outputs are now, and by which code."""

    cleaned: CleanedFile
    made: Sequence[Path]
    code: str


@dataclass(eq=False)
class SentFile:
    """A file that was sent to the workers; the folders of all attempts at it begin alike."""

    job: Job
    prefix: str
    future: Any


class WorkersThatClean:
    """Workers of a cluster, each thread of which cleans a file; see :class:`.Hands`."""

    def __init__(
        self,
        workers: Workers,
        wanted: Wanted,
        look: Callable[[JudgedFile], object],
        folder: Path | None,
    ) -> None:
        """Take workers that reach all files by the same paths as this process.

        They write into ``folder``; None: nothing is written. ``look`` goes to them.
        """
        self._workers, self._folder = workers, None if folder is None else folder.absolute()
        parameters = {**wanted.parameters, 'threads': 1}
        self._wanted, self._look = replace(wanted, parameters=parameters), look
        self._numbers = count()
        self._sent: set[SentFile] = set()

    @property
    def at_once(self) -> int:
        """How many files they take."""
        return self._workers.ahead

    def submit(self, job: Job) -> SentFile:
        """Begin with a file; return what stands for its result."""
        prefix = f'{next(self._numbers)}-'
        sent = SentFile(job, prefix, self._send(job, prefix))
        self._sent.add(sent)
        return sent

    def _send(self, job: Job, prefix: str) -> Any:
        given = (job.absolute(), self._wanted, self._look, self._folder, prefix)
        return self._workers.send(clean_file, *given)

    def first_done(self, files: Collection[SentFile]) -> list[SentFile]:
        """Wait for the first of some files, not for long; return those that are done.

        Dask blames a worker's death on all files that it had, also on those that waited. These are
        sent again.
        """
        self._workers.first_done([sent.future for sent in files])
        done = [sent for sent in files if sent.future.done()]
        for sent in done:
            deaths = self._workers.deaths(sent.future)
            if deaths > len(self._attempts(sent)) and self._folder is not None:
                sent.future = self._send(sent.job, sent.prefix)
        return [sent for sent in done if sent.future.done()]

    def take(self, job: Job, sent: SentFile) -> CleanedFile:
        """Give the outputs of a file their names, and return what became of it.

        Raises
        ------
        FilterError
            If it could not be cleaned, or an output cannot have its name.
        SchedulerError
            If the scheduler has gone, or the worker is of another version.

        """
        what = f'the file {job.path}'
        self._sent.remove(sent)
        try:
            done = self._workers.result(sent.future, what)
            if isinstance(done, FilterError):
                raise done
            if not isinstance(done, Attempt):
                raise CloudError(what, 'cleaned by this version', type(done).__name__)
            check_code(done.cleaned.worker, done.code, judging_code(JUDGE))
            if done.made:
                with new_files(job.outputs) as paths:
                    for made, path in zip(done.made, paths, strict=True):
                        shutil.move(made, path)
            return done.cleaned
        finally:
            for left in self._attempts(sent):
                shutil.rmtree(left, ignore_errors=True)  # who was given up may still write there

    def _attempts(self, sent: SentFile) -> list[Path]:
        """List the folders of all attempts at a file."""
        return [] if self._folder is None else list(self._folder.glob(f'{sent.prefix}*'))

    def end(self) -> None:
        """Forget all files that are left."""
        for sent in self._sent:
            self._workers.give_up(sent.future)


def clean_file(
    job: Job,
    wanted: Wanted,
    look: Callable[[JudgedFile], object],
    folder: Path | None,
    prefix: str,
) -> Attempt | FilterError:
    """Clean a file into a new folder within another; stop when that is no longer there.

    A refusal is returned: raised, it would be tried again.
    """
    worker = name_of_worker()
    try:
        own = None if folder is None else Path(mkdtemp(prefix=prefix, dir=folder))
    except OSError as err:
        must_be = f'a folder that the worker {worker} can write to'
        return CloudError(f'{folder}', must_be, f'"{err.strerror}"')
    made: list[Path] = []

    @contextmanager
    def make(paths: Sequence[Path]) -> Iterator[list[Path]]:
        made.extend(own / path.name for path in paths if own is not None)
        yield made

    def check(_done: int, _total: int, _step: str) -> None:
        if own is not None and not own.exists():
            raise CloudError(f'{folder}', 'there until all files are cleaned', 'none')

    try:
        cleaned = clean_job(job, wanted, look, check, make=make)
    except FilterError as err:
        return err
    return Attempt(replace(cleaned, worker=worker), made, judging_code(JUDGE))
