# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Run a job over many recordings or files: skip what is done; a failure costs only its own."""

from __future__ import annotations

import os
import socket
from collections import deque
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from lidar_outlier_filter.archive.fingerprints import code_version, content_hash, parameters_hash
from lidar_outlier_filter.archive.jobs import JobResult, expected_record
from lidar_outlier_filter.archive.publish import look, publish, settle, workshop
from lidar_outlier_filter.archive.sidecar import DONE, NO_CLOUDS, ArchiveRecord
from lidar_outlier_filter.errors import FilterError, NoCloudsError, SchedulerError, quote_error

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from lidar_outlier_filter.archive.jobs import Inform, Job, Note, Task
    from lidar_outlier_filter.archive.publish import FoundOutputs
    from lidar_outlier_filter.archive.workers import Workers

POLL_S = 0.2  # between two checks for an interrupt
AHEAD = 2  # tasks for each worker, of which one waits
LOOKING = 16  # threads that look for outputs, most of which wait for a disk or a store


@dataclass(frozen=True)
class Result:
    """The record of a task, what was made if it was not there, and what is to be said."""

    record: ArchiveRecord
    made: JobResult | None = None
    said: Sequence[str] = ()


def attempt(task: Task, job: Job, record: ArchiveRecord, note: Note, inform: Inform) -> Result:
    """Read, judge and write one recording or file, unless another run has done so.

    Raises
    ------
    FilterError
        If it cannot be read, has changed meanwhile, or the outputs cannot be written.

    """
    began = perf_counter()
    if job.dry:
        made = job.make(task, Path(), note, inform)
        return Result(replace(record, state=DONE, **made.counts), made)
    before = look(task)
    if (done := _done(task, record, before)) is not None:
        return Result(done)
    with workshop(task.folder) as built:
        try:
            made = job.make(task, built, note, inform)
            record = replace(record, state=DONE, **made.counts)
        except NoCloudsError as err:
            made = JobResult({})
            record = replace(record, state=NO_CLOUDS, error=str(err))
        source_hash = content_hash(task.location)
        task.location.check_unchanged(job.what)
        record = replace(
            record,
            source_hash=source_hash,
            seconds=round(perf_counter() - began, 3),
            finished=datetime.now(UTC).isoformat(timespec='seconds'),
        )
        return Result(publish(task, built, record, made.log, before), made)


def attempt_safely(
    task: Task, job: Job, record: ArchiveRecord, note: Note, inform: Inform
) -> Result:
    """Return a failed record instead of an error: it costs only its own recording or file."""
    began = perf_counter()
    try:
        return attempt(task, job, record, note, inform)
    except SchedulerError:
        raise
    except FilterError as err:
        wrong = err
    except Exception as err:  # noqa: BLE001  whatever it is, the next one is worked on
        wrong = FilterError(f'the {job.what} {task.location.path}', job.done, quote_error(err))
    finished = datetime.now(UTC).isoformat(timespec='seconds')
    seconds = round(perf_counter() - began, 3)
    return Result(replace(record, error=str(wrong), seconds=seconds, finished=finished))


def attempt_on_worker(task: Task, job: Job, record: ArchiveRecord) -> Result:
    """Work on a task on a worker of Dask, with kernels on one thread.

    Raises
    ------
    SchedulerError
        If the code or a file of parameters here differs from that of the command.

    """
    name = f'{socket.gethostname()}:{os.getpid()}'
    own = parameters_hash(job.filter, job.options), code_version()
    if own != (record.parameters, record.code):
        must_be = f'of version {record.code}, with the same plug-ins and mask'
        raise SchedulerError(f'the worker {name}', must_be, own[1])
    said: list[str] = []
    job = replace(job, parameters={**job.parameters, 'threads': 1})
    record = replace(record, worker=name)
    result = attempt_safely(task, job, record, bool, said.append)
    return replace(result, said=said)


class Progress:
    """How much of a run is done; threads may report to it.

    Attributes
    ----------
    number, total : tasks that are finished, and all
    last : the source of the task that reported or finished last

    """

    def __init__(self, tasks: Iterable[Task]) -> None:
        """Take the tasks of a run."""
        sizes = [task.location.size for task in tasks]
        self._running: dict[Task, float] = {}  # shares that are done
        self._bytes_finished, self._bytes_total = 0, sum(sizes)
        self.number, self.total = 0, len(sizes)
        self.last = ''

    def report(self, task: Task, share: float) -> None:
        """Note which share of a task is done."""
        self._running[task] = share
        self.last = task.source

    def finish(self, task: Task) -> None:
        """Note that a task is finished."""
        self._running.pop(task, None)
        self._bytes_finished += task.location.size
        self.number += 1
        self.last = task.source

    def bytes_done(self) -> tuple[int, int]:
        """Return how many bytes of the inputs are done, and all."""
        running = self._running.copy().items()
        done = self._bytes_finished + sum(share * task.location.size for task, share in running)
        return round(done), self._bytes_total


def pending(tasks: Sequence[Task], job: Job) -> tuple[list[Task], dict[Task, ArchiveRecord]]:
    """Return the tasks to be done, and the records of the others: done before, or refused."""
    if job.dry:
        return list(tasks), {}

    def record_of(task: Task) -> ArchiveRecord | None:
        goal = expected_record(task, job)
        try:
            return _done(task, goal, look(task))
        except FilterError as err:
            return replace(goal, error=str(err))

    with ThreadPoolExecutor(LOOKING) as pool:
        found = dict(zip(tasks, pool.map(record_of, tasks), strict=True))
    records = {task: record for task, record in found.items() if record is not None}
    return [task for task in tasks if task not in records], records


def _done(task: Task, goal: ArchiveRecord, found: FoundOutputs) -> ArchiveRecord | None:
    """Return the record of a task that is done."""
    record = found.done(goal, task)
    if record is not None:
        settle(task, found, record)
    return record


@dataclass
class Run:
    """Submits tasks, several for each worker, and collects their results.

    Parameters
    ----------
    job, workers : what is done, and by whom
    show : called regularly with the progress
    leave : called regularly; may raise to stop the run
    inform : called with sentences
    keep : called with each result

    """

    job: Job
    workers: Workers
    show: Callable[[Progress], object] = bool
    leave: Callable[[], object] = lambda: None
    inform: Inform = str
    keep: Callable[[Task, Result], object] = lambda _task, _result: None

    def all(self, tasks: Sequence[Task]) -> dict[Task, ArchiveRecord]:
        """Run tasks; then those whose workers died, one at a time; return the record of each.

        Dask blames the death of a worker on all tasks that it had, also on those that waited.

        Raises
        ------
        SchedulerError
            If the scheduler is gone, or a worker has other code.

        """
        self._progress = Progress(tasks)
        self._records: dict[Task, ArchiveRecord] = {}
        self._suspects: list[Task] = []
        self._each(tasks, lambda: AHEAD * self.workers.count(), self._suspects)
        self._each(self._suspects, lambda: 1, None)
        return self._records

    def _each(
        self, tasks: Iterable[Task], at_once: Callable[[], int], suspects: list[Task] | None
    ) -> None:
        waiting = deque(tasks)
        running: dict[Future[Result], Task] = {}
        while waiting or running:
            free = at_once() - len(running) if waiting else 0
            for _ in range(min(free, len(waiting))):
                task = waiting.popleft()
                running[self._submit(task)] = task
            self.leave()
            self.workers.check()
            self.show(self._progress)
            for future in wait(running, POLL_S, FIRST_COMPLETED).done:
                self._end(running.pop(future), future, suspects)

    def _submit(self, task: Task) -> Future[Result]:
        record = expected_record(task, self.job)
        if self.workers.client is not None:
            return self.workers.executor.submit(attempt_on_worker, task, self.job, record)

        def note(share: float) -> None:
            self.leave()
            self._progress.report(task, share)

        return self.workers.executor.submit(
            attempt_safely, task, self.job, record, note, self.inform
        )

    def _end(self, task: Task, future: Future[Result], suspects: list[Task] | None) -> None:
        try:
            result = future.result()
        except SchedulerError:
            raise
        except CancelledError as err:
            raise self.workers.gone() from err
        except Exception as err:  # noqa: BLE001  whatever comes from another machine
            if suspects is not None and type(err).__name__ == 'KilledWorker':
                suspects.append(task)
                return
            result = Result(replace(expected_record(task, self.job), error=self._blame(task, err)))
        for sentence in result.said:
            self.inform(sentence)
        self._records[task] = result.record
        self.keep(task, result)
        self._progress.finish(task)
        self.show(self._progress)

    def _blame(self, task: Task, err: Exception) -> str:
        what = f'the {self.job.what} {task.location.path}'
        if type(err).__name__ == 'KilledWorker':
            got = f'{getattr(err, "allowed_failures", 0) + 1} that died, twice'
            return str(FilterError(what, f'{self.job.done} without a worker that dies', got))
        return str(FilterError(what, f'{self.job.done} by the workers', quote_error(err)))


def refuse_taken_names(tasks: Sequence[Task], job: Job, reserved: Mapping[str, str]) -> None:
    """Refuse tasks whose outputs would have the same name, or lie within one another.

    Parameters
    ----------
    tasks : whose outputs and sidecars are compared
    job : of which a sentence speaks
    reserved : paths that no output may have, and what they are

    Raises
    ------
    FilterError
        With the first such name.

    """
    known = dict(reserved)
    names = [(str(path), task) for task in tasks for path in (*task.outputs, task.sidecar)]
    for name, task in names:
        _refuse_taken(name, known.get(name), task, job)
        known[name] = str(task.location.path)
    for name, task in names:
        parts = name.split('/')
        for count in range(1, len(parts)):
            _refuse_taken(name, known.get('/'.join(parts[:count])), task, job)


def _refuse_taken(name: str, other: str | None, task: Task, job: Job) -> None:
    if other is not None:
        got = f'{other} and {task.location.path}'
        raise FilterError(f'the output {name}', f'that of one {job.what}', got)
