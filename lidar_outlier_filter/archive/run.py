# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Run a job over many recordings or files: skip what is done; a failure costs only its own."""

import os
import socket
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from time import perf_counter

from lidar_outlier_filter.archive.jobs import Inform, Job, Note, Result, Task
from lidar_outlier_filter.archive.publish import done_before, publish, workshop
from lidar_outlier_filter.archive.sidecar import (
    ArchiveRecord,
    code_version,
    content_hash,
    parameters_hash,
)
from lidar_outlier_filter.archive.workers import Workers
from lidar_outlier_filter.errors import (
    FilterError,
    SchedulerError,
    printable,
    quote_error,
    refusing,
)

POLL_S = 0.2  # between two checks for an interrupt
SEARCH_THREADS = 16  # threads that search for outputs; most wait for a disk or a store


def attempt(task: Task, job: Job, goal: ArchiveRecord, note: Note, inform: Inform) -> Result:
    """Read, judge and write one recording or file, unless another worker has done so.

    An error is a failed record: it costs only its own recording or file.

    Raises
    ------
    SchedulerError
        If the worker has other code.

    """
    began = perf_counter()

    def timed(record: ArchiveRecord) -> ArchiveRecord:
        now = datetime.now(UTC).isoformat(timespec='seconds')
        return replace(record, seconds=round(perf_counter() - began, 3), finished=now)

    try:
        # Whatever it is, the next one is worked on.
        with refusing(FilterError, f'the {job.what} {task.location.path}', job.done):
            if job.dry:
                made = job.make(task, Path(), goal, note, inform)
                return replace(made, record=timed(made.record))
            if (done := done_before(task, goal)) is not None:
                return Result(done)
            with workshop(task.folder) as built:
                made = job.make(task, Path(built), goal, note, inform)
                source_hash = content_hash(task.location)
                task.location.check_unchanged(job.what)
                record = timed(replace(made.record, source_hash=source_hash))
                publish(task, Path(built), record, made.log)
                return replace(made, record=record)
    except FilterError as err:
        return Result(timed(replace(goal, error=_with_name(task, err))))


def _with_name(task: Task, err: FilterError) -> str:
    """Say an error of a task with the name of its input, unless it says that."""
    name = printable(str(task.location.path))
    return str(err) if name in str(err) else f'{name}: {err}'


def attempt_on_worker(task: Task, job: Job, goal: ArchiveRecord) -> Result:
    """Work on a task on a worker of Dask, with kernels on one thread."""
    name = f'{socket.gethostname()}:{os.getpid()}'
    own = parameters_hash(job.filter, job.options), code_version()
    if own != (goal.parameters, goal.code):
        must_be = f'of version {goal.code}, with the same plug-ins and mask'
        raise SchedulerError(f'the worker {name}', must_be, own[1])
    messages: list[str] = []
    job = replace(job, parameters={**job.parameters, 'threads': 1})
    result = attempt(task, job, replace(goal, worker=name), bool, messages.append)
    return replace(result, messages=messages)


class Progress:
    """How much of a run is done; threads may report to it."""

    def __init__(self, tasks: Sequence[Task]) -> None:
        self._running: dict[Task, float] = {}  # shares that are done
        self._bytes, self._total = sum(task.location.size for task in tasks), len(tasks)
        self._bytes_done, self._finished, self._last = 0, 0, ''

    def report(self, task: Task, share: float) -> None:
        """Note which share of a task is done."""
        self._running[task] = share
        self._last = task.source

    def finish(self, task: Task) -> None:
        """Note that a task is finished."""
        self._running.pop(task, None)
        self._bytes_done += task.location.size
        self._finished += 1
        self._last = task.source

    def state(self) -> tuple[int, int, str]:
        """Return how many bytes of the inputs are done, and all; and a text with counts."""
        running = self._running.copy().items()
        done = self._bytes_done + sum(share * task.location.size for task, share in running)
        return round(done), self._bytes, f'{self._finished} of {self._total}, {self._last}'


def pending(tasks: Sequence[Task], job: Job) -> tuple[list[Task], dict[Task, ArchiveRecord]]:
    """Return the tasks to be done, and the records of the others: done before, or refused."""
    if job.dry:
        return list(tasks), {}

    def record_of(task: Task) -> ArchiveRecord | None:
        goal = job.goal(task)
        try:
            return done_before(task, goal)
        except FilterError as err:
            return replace(goal, error=_with_name(task, err))

    with ThreadPoolExecutor(SEARCH_THREADS) as pool:
        found = dict(zip(tasks, pool.map(record_of, tasks), strict=True))
    records = {task: record for task, record in found.items() if record is not None}
    return [task for task in tasks if task not in records], records


@dataclass
class Run:
    """Submits tasks, one for each worker, and collects their results.

    Parameters
    ----------
    job, workers : the job, and its workers
    show : called regularly with the bytes that are done, all bytes, and a text
    leave : called regularly; may raise to stop the run
    inform : called with sentences

    """

    job: Job
    workers: Workers
    show: Callable[[int, int, str], object] = lambda *_: None
    leave: Callable[[], object] = lambda: None
    inform: Inform = str

    def all(self, tasks: Sequence[Task]) -> Iterator[tuple[Task, Result]]:
        """Yield the result of each task.

        Each worker has one task, because Dask counts a death against all tasks of a worker.

        Raises
        ------
        SchedulerError
            If the scheduler is gone, or a worker has other code.

        """
        self._progress = Progress(tasks)
        waiting = deque(tasks)
        running: dict[Future[Result], Task] = {}
        while waiting or running:
            free = max(1, self.workers.count()) - len(running) if waiting else 0
            for _ in range(min(free, len(waiting))):
                task = waiting.popleft()
                running[self._submit(task)] = task
            self.leave()
            self.workers.check()
            self.show(*self._progress.state())
            for future in wait(running, POLL_S, FIRST_COMPLETED).done:
                task = running.pop(future)
                yield task, self._result(task, future)
                self._progress.finish(task)
                self.show(*self._progress.state())

    def _submit(self, task: Task) -> Future[Result]:
        goal, submit = self.job.goal(task), self.workers.executor.submit
        if self.workers.client is not None:
            return submit(attempt_on_worker, task, self.job, goal)

        def note(share: float) -> None:
            self.leave()
            self._progress.report(task, share)

        return submit(attempt, task, self.job, goal, note, self.inform)

    def _result(self, task: Task, future: Future[Result]) -> Result:
        try:
            result = future.result()
        except SchedulerError:
            raise
        except CancelledError as err:
            raise self.workers.gone() from err
        except Exception as err:  # noqa: BLE001  whatever comes from another machine
            must_be, got = f'{self.job.done} by the workers', quote_error(err)
            if type(err).__name__ == 'KilledWorker':
                must_be = f'{self.job.done} without a worker that dies'
                got = f'{getattr(err, "allowed_failures", 0) + 1} that died'
            wrong = FilterError(f'the {self.job.what} {task.location.path}', must_be, got)
            result = Result(replace(self.job.goal(task), error=str(wrong)))
        for sentence in result.messages:
            self.inform(sentence)
        return result


def refuse_taken_names(tasks: Sequence[Task], job: Job, reserved: Mapping[str, str]) -> None:
    """Refuse tasks whose outputs would have the same name, or lie within one another.

    Parameters
    ----------
    tasks : whose outputs and sidecars are compared
    job : named in the error
    reserved : paths that no output may have, and what they are

    """
    names = [(path.split('/'), what) for path, what in reserved.items()]
    for task in tasks:
        paths = (*task.outputs, task.sidecar)
        names += [(str(path).split('/'), str(task.location.path)) for path in paths]
    for (outer, one), (inner, other) in pairwise(sorted(names)):
        if inner[: len(outer)] == outer:
            name = '/'.join(inner)
            raise FilterError(f'the output {name}', f'that of one {job.what}', f'{one} and {other}')
