# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Whole recordings that workers of this machine replay, several at once.

Where an archive has enough of them, each worker reads, judges and writes one: nothing is read or
decoded twice, and nobody waits for the one process that writes. A worker writes each time it tries
a recording into another hidden folder of this run, so that one that dies spoils no output.
"""

from __future__ import annotations

import heapq
import shutil
from collections import deque
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import mkdtemp
from time import monotonic
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from lidar_outlier_filter.archive.fingerprints import judging_code
from lidar_outlier_filter.archive.locations import staged
from lidar_outlier_filter.archive.worker_start import name_of_worker
from lidar_outlier_filter.archive.workers import check_code
from lidar_outlier_filter.disk.new_files import publish
from lidar_outlier_filter.errors import FilterError, RecordingError
from lidar_outlier_filter.recordings.bags import writable
from lidar_outlier_filter.recordings.replay import replay
from lidar_outlier_filter.stream.topics import CLOUD

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from lidar_outlier_filter.archive.order import Order
    from lidar_outlier_filter.archive.task import Task
    from lidar_outlier_filter.archive.workers import Workers
    from lidar_outlier_filter.recordings.bags import Topic
    from lidar_outlier_filter.recordings.replay import ReplayReport

IDLE = 1.1  # times as long as with all workers busy to the end, at most
SECONDS = 0.5  # between two messages of a worker on how far it is


@dataclass(frozen=True)
class ReplayedRecording:
    """What a worker made of a recording, and what it would have said meanwhile.

    ``made`` is the output, and ``times`` are the bag times of the clouds, ns. ``code`` is of
    :func:`.fingerprints.judging_code`.
    """

    report: ReplayReport
    made: Path
    times: Mapping[Topic, Sequence[int]]
    said: Sequence[str]
    worker: str
    code: str


class WholeRecordings:
    """The recordings that workers replay as a whole; each is asked for in its turn."""

    def __init__(self, tasks: Sequence[Task], order: Order, workers: Workers, folder: Path) -> None:
        """Choose among the recordings; workers of this machine write into a hidden ``folder``."""
        self._workers, self._folder = workers, folder.absolute()
        self._order = replace(order, parameters={**order.parameters, 'threads': 1})
        self._unsent = deque(choose(tasks, max(1, workers.count)))
        self._chosen = frozenset(self._unsent)
        self._sent: dict[Task, Any] = {}
        self._topic = f'replay-{uuid4().hex[:8]}'
        self._steps: dict[str, tuple[int, int]] = {}
        workers.client.subscribe_topic(self._topic, self._note)

    def __contains__(self, task: Task) -> bool:
        """Return whether a recording is one of those chosen."""
        return task in self._chosen

    @property
    def all_sent(self) -> bool:
        """Whether workers that are free may have other work."""
        return not self._unsent

    def take(
        self, task: Task, output: Path, tick: Callable[[], object], step: Callable[..., object]
    ) -> ReplayedRecording:
        """Wait for a recording, and put its output under its name; others are sent meanwhile.

        ``tick`` is called now and then, and may leave by an exception; ``step`` is called with how
        many messages of how many are done.

        Raises
        ------
        RecordingError
            If it cannot be replayed, or several workers died of it.
        SchedulerError
            If the scheduler goes away, or the worker is of another version.

        """
        self._send()
        future = self._sent.pop(task)
        try:
            while not future.done():
                tick()
                self._workers.first_done([future])
                step(*self._steps.get(str(task.output), (0, 0)))
        except BaseException:
            self._workers.give_up(future)
            raise
        self._send()
        what = f'the recording {task.location.path}'
        found = self._workers.result(future, what)
        if isinstance(found, FilterError):
            raise found
        if not isinstance(found, ReplayedRecording):
            raise RecordingError(what, 'replayed by this version', type(found).__name__)
        check_code(found.worker, found.code, judging_code())
        with writable(output):
            publish(found.made, output)
        shutil.rmtree(found.made.parent, ignore_errors=True)
        return replace(found, report=replace(found.report, output=output))

    def _send(self) -> None:
        ahead = self._workers.ahead
        while self._unsent and len(self._sent) < ahead:
            task = self._unsent.popleft()
            given = (task, self._order, self._folder, self._topic)
            self._sent[task] = self._workers.send(replay_whole, *given)

    def _note(self, event: tuple[float, tuple[str, int, int]]) -> None:
        """Note how far a worker is, as it says; Dask calls it from a thread of its own."""
        output, done, total = event[1]
        self._steps[output] = done, total


def choose(tasks: Sequence[Task], workers: int) -> Sequence[Task]:
    """Choose those, from the first on, of which each worker has its share: none is idle for long.

    Each in turn goes to the worker that is free first. All others are better cut into pieces.
    Where one lies on a store, or goes there, none is chosen.
    """
    if not all(
        isinstance(path, Path) for task in tasks for path in (task.location.path, task.output)
    ):
        return ()
    ends = [0] * workers
    total = chosen = 0
    for number, task in enumerate(tasks, 1):
        total += task.location.size
        heapq.heapreplace(ends, ends[0] + task.location.size)
        if max(ends) * workers <= IDLE * total:
            chosen = number
    return tasks[:chosen]


def replay_whole(
    task: Task, order: Order, folder: Path, topic: str
) -> ReplayedRecording | FilterError:
    """Replay a recording into a new folder within ``folder``; say under ``topic`` how far it is.

    An error is returned: Dask would try again what it gets by an exception.
    """
    made = Path(mkdtemp(dir=folder)) / task.output.name
    times: dict[Topic, list[int]] = {}
    said: list[str] = []

    def note(cloud: Topic | None, time: int) -> None:
        if cloud is not None and cloud.msgtype == CLOUD:
            times.setdefault(cloud, []).append(time)

    try:
        with staged(task.location) as path:
            report = replay(
                path,
                made,
                parameters=order.parameters,
                **order.options,
                progress=_reporter(str(task.output), topic),
                inform=said.append,
                begin=note,
            )
        task.location.check_unchanged()
    except FilterError as err:
        return err
    return ReplayedRecording(report, made, times, said, name_of_worker(), judging_code())


def _reporter(output: str, topic: str) -> Callable[[int, int], None]:
    """Return what reports to the process that waits, now and then, how far an output is."""
    from distributed import get_worker  # noqa: PLC0415  an extra, and takes half a second

    worker, due = get_worker(), monotonic() + SECONDS

    def step(done: int, total: int) -> None:
        nonlocal due
        if monotonic() >= due:
            due = monotonic() + SECONDS
            worker.log_event(topic, (output, done, total))

    return step
