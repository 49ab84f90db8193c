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
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.archive.file_cleaners import JUDGE, CleanedFile, Job, clean_job
from lidar_outlier_filter.archive.fingerprints import judging_code
from lidar_outlier_filter.archive.sent_work import Sent, SentWork
from lidar_outlier_filter.archive.worker_start import name_of_worker
from lidar_outlier_filter.archive.workers import check_code
from lidar_outlier_filter.disk.new_files import new_files
from lidar_outlier_filter.errors import CloudError, FilterError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from lidar_outlier_filter.archive.workers import Workers
    from lidar_outlier_filter.files.cleaning.clean_log import Wanted
    from lidar_outlier_filter.files.cleaning.judged_file import JudgedFile


@dataclass(frozen=True)
class Attempt:
    """A file that a worker cleaned: where its outputs are now, and by which code."""

    cleaned: CleanedFile
    made: Sequence[Path]
    code: str


class WorkersThatClean(SentWork[Job]):
    """Workers of a cluster, each thread of which cleans a file."""

    def __init__(
        self,
        workers: Workers,
        wanted: Wanted,
        look: Callable[[JudgedFile], object],
        folder: Path | None,
    ) -> None:
        """See :class:`.SentWork`; without a folder nothing is written. ``look`` goes to them."""
        super().__init__(workers, folder)
        parameters = {**wanted.parameters, 'threads': 1}
        self._wanted, self._look = replace(wanted, parameters=parameters), look

    @property
    def at_once(self) -> int:
        """How many files they take."""
        return self._workers.ahead

    def _send(self, job: Job, prefix: str) -> Any:
        given = (job.absolute(), self._wanted, self._look, self._folder, prefix)
        return self._workers.send(clean_file, *given)

    def take(self, job: Job, sent: Sent[Job]) -> CleanedFile:
        """Give the outputs of a file their names, and return what became of it.

        Raises
        ------
        FilterError
            If it could not be cleaned, or an output cannot have its name.
        SchedulerError
            If the scheduler has gone, or the worker is of another version.

        """
        what = f'the file {job.path}'
        try:
            done = self._result(sent, what)
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
