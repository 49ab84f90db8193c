# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Who works on recordings or files: threads of this process, or workers, each on a whole one.

Who works reads, judges and writes. The command gives names, and notes what became of each.
"""

from __future__ import annotations

from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from itertools import count
from time import monotonic
from typing import TYPE_CHECKING, Any, Generic
from uuid import uuid4

from lidar_outlier_filter.archive.fingerprints import judging_code
from lidar_outlier_filter.archive.order import Made, One
from lidar_outlier_filter.archive.worker_start import name_of_worker
from lidar_outlier_filter.archive.workers import check_code
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.pipeline.compiling import make_ready

if TYPE_CHECKING:
    from collections.abc import Callable, Collection
    from concurrent.futures import Future
    from pathlib import Path

    from lidar_outlier_filter.archive.order import Order
    from lidar_outlier_filter.archive.step import Progress, Step
    from lidar_outlier_filter.archive.work import Hands
    from lidar_outlier_filter.archive.workers import Workers

    Note = Callable[[str, int, int, float | None], object]

SECONDS = 0.5  # between two messages of a worker on how far it is
LOOK = 0.2  # seconds between two looks at whether to go on


@dataclass(frozen=True)
class ByWhom:
    """By whom the work is done, where outputs are built, and what is called meanwhile.

    Attributes
    ----------
    workers : of this machine or of a cluster; None: threads of this process
    hidden : folder for what has no name yet, which the workers reach; None: there is none
    show : is called with how far it is
    leave : may leave by an exception
    inform : gets sentences
    threads : how many

    """

    workers: Workers | None
    hidden: Path | None
    show: Callable[[Step], object] = bool
    leave: Callable[[], object] = lambda: None
    inform: Callable[[str], object] = str
    threads: int = 1

    def tick(self, progress: Progress) -> Callable[[], None]:
        """Return what is to be called now and then."""

        def tick() -> None:
            self.leave()
            self.show(progress.step)

        return tick

    def hands(self, order: Order[One], progress: Progress) -> Hands[One]:
        """Return who works."""
        if self.workers is not None:
            return OnWorkers(self.workers, order, self.hidden, progress.note, self.inform)

        def note(name: str, done: int, total: int, share: float | None) -> None:
            self.leave()
            progress.note(name, done, total, share)

        return Threads(self.threads, order, self.hidden, note, self.inform)


class Threads(Generic[One]):
    """Threads of this process; the kernels of each use all cores."""

    def __init__(
        self,
        number: int,
        order: Order[One],
        folder: Path | None,
        note: Note,
        inform: Callable[[str], object],
    ) -> None:
        """Start so many, which build outputs in a hidden ``folder``, if there is one.

        ``note`` is called with a name, and how many of how many messages or points are done; it
        may leave by an exception. ``inform`` gets sentences.
        """
        self.at_once = number
        self._order, self._folder, self._note, self._inform = order, folder, note, inform
        self._pool = ThreadPoolExecutor(number)

    def submit(self, task: One) -> Future[Made]:
        """See :class:`.Hands`."""
        self._note(task.source, 0, 0, None)
        return self._pool.submit(self._make, task)

    def _make(self, task: One) -> Made:
        def note(done: int, total: int, share: float | None) -> None:
            self._note(task.source, done, total, share)

        return self._order.make(task, self._folder, note, self._inform)

    def first_done(self, futures: Collection[Future[Made]]) -> Collection[Future[Made]]:
        """See :class:`.Hands`."""
        return wait(futures, LOOK, FIRST_COMPLETED).done

    def take(self, _task: One, future: Future[Made]) -> Made:
        """See :class:`.Hands`."""
        return future.result()

    def end(self) -> None:
        """Leave what has not begun, and wait for the rest."""
        self._pool.shutdown(cancel_futures=True)


@dataclass(eq=False)
class Sent(Generic[One]):
    """What was sent to a worker; the folders of all attempts at it begin alike."""

    task: One
    prefix: str
    future: Any
    is_anew: bool = False


class OnWorkers(Generic[One]):
    """Workers of this machine or of a cluster, each thread of which works on a whole one."""

    def __init__(
        self,
        workers: Workers,
        order: Order[One],
        folder: Path | None,
        note: Note,
        inform: Callable[[str], object],
    ) -> None:
        """Take workers that reach all, and ``folder``, by the same paths as this process.

        Each attempt has a folder of its own in there; None: attempts leave nothing here. ``note``
        may be called from a thread of Dask's.
        """
        make_ready(order.filter)  # before workers would compile the same at once
        self._workers, self._order = workers, order.on_one_thread()
        self._folder = None if folder is None else folder.absolute()
        self._note, self._inform = note, inform
        self._numbers = count()
        self._sent: set[Sent[One]] = set()
        self._topic = f'{order.verb}-{uuid4().hex[:8]}'
        workers.client.subscribe_topic(self._topic, lambda event: note(*event[1]))

    @property
    def at_once(self) -> int:
        """How many they take."""
        return max(1, self._workers.ahead if self._order.waits else self._workers.count)

    def submit(self, task: One) -> Sent[One]:
        """See :class:`.Hands`."""
        prefix = f'{next(self._numbers)}-'
        sent = Sent(task, prefix, self._send(task, prefix))
        self._sent.add(sent)
        self._note(task.source, 0, 0, None)
        return sent

    def _send(self, task: One, prefix: str) -> Any:
        given = (task.absolute(), self._order, self._folder, prefix, self._topic)
        return self._workers.send(make_on_worker, *given)

    def first_done(self, futures: Collection[Sent[One]]) -> Collection[Sent[One]]:
        """See :class:`.Hands`.

        Dask blames a worker's death on all that it had, also on what had only begun, or waited.
        Such work is sent again.
        """
        self._workers.first_done([sent.future for sent in futures])
        for sent in futures:
            if sent.future.done() and self._is_innocent(sent):
                sent.future, sent.is_anew = self._send(sent.task, sent.prefix), True
        return [sent for sent in futures if sent.future.done()]

    def _is_innocent(self, sent: Sent[One]) -> bool:
        """Return whether more deaths are blamed on it than there were attempts at it.

        Where attempts leave nothing here, one more is made.
        """
        deaths = self._workers.deaths(sent.future)
        if self._folder is None:
            return deaths > 0 and not sent.is_anew
        return deaths > len(list(self._folder.glob(f'{sent.prefix}*')))

    def take(self, task: One, sent: Sent[One]) -> Made:
        """Return what a worker made, which has no name yet.

        Raises
        ------
        FilterError
            If it was refused, or several workers died of it.
        SchedulerError
            If the scheduler goes away, or the worker is of another version.

        """
        order, what = self._order, f'the {self._order.what} {task.location.path}'
        self._sent.discard(sent)
        found = self._workers.result(sent.future, what)
        if isinstance(found, FilterError):
            raise found
        if not isinstance(found, Made):
            raise order.error(what, f'{order.verb} by this version', type(found).__name__)
        check_code(found.worker, found.code, judging_code(order.judge))
        for sentence in found.said:
            self._inform(sentence)
        return found

    def end(self) -> None:
        """See :class:`.Hands`."""
        for sent in self._sent:
            self._workers.give_up(sent.future)


def make_on_worker(
    task: One, order: Order[One], folder: Path | None, prefix: str, topic: str
) -> Made | FilterError:
    """Work on one on a worker; say under ``topic`` how far it is.

    An error is returned: Dask would try again what it gets by an exception.
    """
    from distributed import get_worker  # noqa: PLC0415  an extra, and takes half a second

    worker, due = get_worker(), monotonic() + SECONDS
    said: list[str] = []

    def note(done: int, total: int, share: float | None) -> None:
        nonlocal due
        if monotonic() < due:
            return
        due = monotonic() + SECONDS
        worker.log_event(topic, (task.source, done, total, share))
        if folder is not None and not folder.exists():
            raise order.error(f'{folder}', f'there until all are {order.verb}', 'none')

    try:
        made = order.make(task, folder, note, said.append, prefix)
    except FilterError as err:
        return err
    return replace(made, said=said, worker=name_of_worker(), code=judging_code(order.judge))
