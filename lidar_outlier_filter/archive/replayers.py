# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Who replays the recordings of an archive: this process, or workers, each a whole one at a time.

A worker reads, judges and writes. This process gives names, and notes what became of each.
"""

from __future__ import annotations

from concurrent.futures import Future
from dataclasses import dataclass, replace
from time import monotonic
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from lidar_outlier_filter.archive.fingerprints import judging_code
from lidar_outlier_filter.archive.one_recording import ReplayedRecording, replay_recording
from lidar_outlier_filter.archive.sent_work import Sent, SentWork
from lidar_outlier_filter.archive.worker_start import name_of_worker
from lidar_outlier_filter.archive.workers import check_code
from lidar_outlier_filter.errors import FilterError, RecordingError
from lidar_outlier_filter.stream.compiling import make_ready

if TYPE_CHECKING:
    from collections.abc import Callable, Collection
    from pathlib import Path

    from lidar_outlier_filter.archive.order import Order
    from lidar_outlier_filter.archive.step import Progress, Step
    from lidar_outlier_filter.archive.task import Task
    from lidar_outlier_filter.archive.work import Hands
    from lidar_outlier_filter.archive.workers import Workers

    Note = Callable[[str, int, int], object]

SECONDS = 0.5  # between two messages of a worker on how far it is


@dataclass(frozen=True)
class Replaying:
    """By whom recordings are replayed, where they are built, and what is called meanwhile.

    Attributes
    ----------
    workers : of this machine or of a cluster; None: this process
    hidden : folder for what has no name yet, which the workers reach; None: outputs go to a store
    show : is called with how far it is
    leave : may leave by an exception
    inform : gets sentences

    """

    workers: Workers | None
    hidden: Path | None
    show: Callable[[Step], object] = bool
    leave: Callable[[], object] = lambda: None
    inform: Callable[[str], object] = str

    def tick(self, progress: Progress) -> Callable[[], None]:
        """Return what is to be called now and then."""

        def tick() -> None:
            self.leave()
            self.show(progress.step)

        return tick

    def hands(self, order: Order, progress: Progress, tick: Callable[[], None]) -> Hands[Task]:
        """Return who replays."""
        if self.workers is not None:
            return OnWorkers(self.workers, order, self.hidden, progress.note, self.inform)

        def note(name: str, done: int, total: int) -> None:
            progress.note(name, done, total)
            tick()

        return ThisProcess(order, self.hidden, note, self.inform)


class ThisProcess:
    """Replays one recording after the other, here."""

    at_once = 1

    def __init__(
        self,
        order: Order,
        folder: Path | None,
        note: Note,
        inform: Callable[[str], object],
    ) -> None:
        """Build outputs in a hidden ``folder``; None: they go to a store.

        ``note`` is called with a recording, and how many of how many of its messages are done; it
        may leave by an exception. ``inform`` gets sentences.
        """
        self._order, self._folder, self._note, self._inform = order, folder, note, inform

    def submit(self, task: Task) -> Future[ReplayedRecording]:
        """Replay it now."""

        def progress(done: int, total: int) -> None:
            self._note(task.source, done, total)

        done: Future[ReplayedRecording] = Future()
        progress(0, 0)
        try:
            given = (task, self._order, self._folder, progress, self._inform)
            done.set_result(replay_recording(*given))
        except Exception as err:  # noqa: BLE001  raised anew where it is taken
            done.set_exception(err)
        return done

    def first_done(
        self, futures: Collection[Future[ReplayedRecording]]
    ) -> Collection[Future[ReplayedRecording]]:
        """See :class:`.Hands`."""
        return list(futures)

    def take(self, _task: Task, future: Future[ReplayedRecording]) -> ReplayedRecording:
        """See :class:`.Hands`."""
        return future.result()

    def end(self) -> None:
        """See :class:`.Hands`."""


class OnWorkers(SentWork['Task']):
    """Workers of this machine or of a cluster, each thread of which replays a recording.

    Each has no more than it is at: then few recordings are blamed for the death of a worker.
    """

    def __init__(
        self,
        workers: Workers,
        order: Order,
        folder: Path | None,
        note: Note,
        inform: Callable[[str], object],
    ) -> None:
        """See :class:`ThisProcess`; ``note`` may be called from a thread of Dask's."""
        super().__init__(workers, folder)
        make_ready(order.filter)  # before workers would compile the same at once
        self._note, self._inform = note, inform
        self._order = replace(order, parameters={**order.parameters, 'threads': 1})
        self._topic = f'replay-{uuid4().hex[:8]}'
        workers.client.subscribe_topic(self._topic, lambda event: note(*event[1]))

    @property
    def at_once(self) -> int:
        """How many recordings they take."""
        return max(1, self._workers.count)

    def submit(self, task: Task) -> Sent[Task]:
        """See :class:`.Hands`."""
        sent = super().submit(task)
        self._note(task.source, 0, 0)
        return sent

    def _send(self, task: Task, prefix: str) -> Any:
        given = (task, self._order, self._folder, prefix, self._topic)
        return self._workers.send(replay_on_worker, *given)

    def _is_innocent(self, sent: Sent[Task]) -> bool:
        """See :class:`.SentWork`; of a recording that goes to a store, one more is tried."""
        if self._folder is None:
            return self._workers.deaths(sent.future) > 0 and not sent.is_anew
        return super()._is_innocent(sent)

    def take(self, task: Task, sent: Sent[Task]) -> ReplayedRecording:
        """Return what a worker made of a recording, which has no name yet.

        Raises
        ------
        FilterError
            If it cannot be replayed, or several workers died of it.
        SchedulerError
            If the scheduler goes away, or the worker is of another version.

        """
        what = f'the recording {task.location.path}'
        found = self._result(sent, what)
        if not isinstance(found, ReplayedRecording):
            raise RecordingError(what, 'replayed by this version', type(found).__name__)
        check_code(found.worker, found.code, judging_code())
        for sentence in found.said:
            self._inform(sentence)
        return found


def replay_on_worker(
    task: Task, order: Order, folder: Path | None, prefix: str, topic: str
) -> ReplayedRecording | FilterError:
    """Replay a recording on a worker; say under ``topic`` how far it is.

    An error is returned: Dask would try again what it gets by an exception.
    """
    from distributed import get_worker  # noqa: PLC0415  an extra, and takes half a second

    worker, due = get_worker(), monotonic() + SECONDS
    said: list[str] = []

    def progress(done: int, total: int) -> None:
        nonlocal due
        if monotonic() < due:
            return
        due = monotonic() + SECONDS
        worker.log_event(topic, (task.source, done, total))
        if folder is not None and not folder.exists():
            raise RecordingError(f'{folder}', 'there until all are replayed', 'none')

    try:
        found = replay_recording(task, order, folder, progress, said.append, prefix)
    except FilterError as err:
        return err
    return replace(found, said=said, worker=name_of_worker(), code=judging_code())
