# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings replayed one after the other, their pieces judged by workers ahead of the writer.

The bytes of an output are those of a replay in one process: the same code writes it, and takes a
verdict from a piece only where the piece has judged the same points. While one recording is
written, pieces of those that follow are under way.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.archive.known_chain import KnowingChain
from lidar_outlier_filter.archive.locations import staged
from lidar_outlier_filter.archive.pieces import Piece, cut, starts
from lidar_outlier_filter.archive.whole_recordings import WholeRecordings
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.recordings.replay import ReplayReport, replay
from lidar_outlier_filter.stream.compiling import make_ready

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from lidar_outlier_filter.archive.locations import Location
    from lidar_outlier_filter.archive.order import Order
    from lidar_outlier_filter.archive.pieces import JudgedPiece
    from lidar_outlier_filter.archive.task import Task
    from lidar_outlier_filter.archive.workers import Workers
    from lidar_outlier_filter.recordings.bags import Topic


class Engine:
    """Replays recordings, with workers or in this process.

    Attributes
    ----------
    judged, judged_here : blocks so far, and those of them that no worker had the verdict of

    """

    def __init__(  # noqa: PLR0913  what a run is made of
        self,
        tasks: Sequence[Task],
        order: Order,
        workers: Workers | None,
        tick: Callable[[], object] = lambda: None,
        inform: Callable[[str], object] = str,
        folder: Path | None = None,
    ) -> None:
        """Take recordings in the order in which they are replayed.

        ``tick`` is called often, and may leave by an exception. ``inform`` gets sentences. With a
        hidden ``folder`` of the outputs' file system, workers of this machine write into it.
        """
        self._order, self._tick, self._inform = order, tick, inform
        self._parameters = order.filter
        self._cut: dict[str, list[Piece]] = {}
        self._queue = None
        self._last = tasks[-1].location if tasks else None
        self._workers = workers
        self.judged = self.judged_here = 0
        self._whole: WholeRecordings | None = None
        if workers is not None:
            make_ready(self._parameters)  # before workers would compile the same at once
            if folder is not None:
                self._whole = WholeRecordings(tasks, order, workers, folder)
            cut_up = (task for task in tasks if self._whole is None or task not in self._whole)
            following = (self._pieces(task.location) for task in cut_up)
            self._queue = PieceQueue(following, workers, tick)

    def _pieces(self, location: Location) -> list[Piece]:
        """Cut a recording; one that cannot be read has no pieces: who writes it says why."""
        name = str(location.path)
        if name not in self._cut:
            order, count = self._order, 0
            if self._workers is not None and location is self._last:
                count = max(1, self._workers.count)
            how = (order.topics, order.parameters, order.length, order.largest)
            try:
                pieces = cut(location, *how, workers=count)
            except FilterError:
                pieces = []
            self._cut[name] = pieces
        return self._cut[name]

    def replay(
        self,
        task: Task,
        output: Path,
        progress: Callable[[int, int], object],
        begin: Callable[[Topic | None, int], object] = lambda _topic, _time: None,
    ) -> tuple[ReplayReport, str]:
        """Replay one recording; return what became of it, and who judged it.

        Raises
        ------
        RecordingError
            If it cannot be read, or has changed meanwhile, or the output cannot be written.

        """
        if self._whole is not None and task in self._whole:
            return self._take_whole(self._whole, task, output, progress, begin)
        order, names = self._order, {'this process'}
        pieces = [] if self._queue is None else self._pieces(task.location)
        chain = None
        if pieces:
            chain, names = self._chain(pieces)

        def note(topic: Topic | None, time: int) -> None:
            begin(topic, time)
            if chain is not None:
                chain.begin(topic, time)

        def step(done: int, total: int) -> None:
            self._tick()
            progress(done, total)

        try:
            with staged(task.location) as path:
                report = replay(
                    path,
                    output,
                    parameters=order.parameters,
                    resume=order.resume,
                    **order.options,
                    progress=step,
                    inform=self._inform,
                    chain=chain,
                    begin=note,
                )
            task.location.check_unchanged()
        finally:
            if self._queue is not None:
                self._queue.give_up(self._cut.pop(str(task.location.path), ()))
        if chain is not None:
            self.judged += chain.judged
            self.judged_here += chain.judged_here
        return report, ', '.join(sorted(names))

    def _take_whole(
        self,
        whole: WholeRecordings,
        task: Task,
        output: Path,
        progress: Callable[[int, int], object],
        begin: Callable[[Topic | None, int], object],
    ) -> tuple[ReplayReport, str]:
        """Wait for a worker that replays a recording as a whole."""

        def tick() -> None:
            self._tick()
            if whole.all_sent and self._queue is not None:
                self._queue.send()  # for workers that have no other recording

        found = whole.take(task, output, tick, progress)
        task.location.check_unchanged()
        for sentence in found.said:
            self._inform(sentence)
        for topic, times in found.times.items():
            for time in times:
                begin(topic, time)
        return found.report, found.worker

    def _chain(self, pieces: list[Piece]) -> tuple[KnowingChain, set[str]]:
        """Make the chain that has the verdicts of pieces, and a set for the names of the judges."""
        names: set[str] = set()
        queue = self._queue

        def verdicts_of(number: int) -> Mapping[bytes, bytes]:
            if queue is None:
                return {}
            judged = queue.take(pieces[number])
            names.add(judged.worker)
            return judged.verdicts

        return KnowingChain(self._parameters, starts(pieces), verdicts_of), names


class PieceQueue:
    """Keeps the workers busy, and no more: pieces are sent as those before are taken."""

    def __init__(
        self,
        recordings: Iterator[Sequence[Piece]],
        workers: Workers,
        tick: Callable[[], object],
    ) -> None:
        """Take recordings, each as its pieces, in the order in which they will be asked for.

        ``tick`` is called while a piece is waited for, and may leave by an exception.
        """
        self._recordings, self._workers, self._tick = recordings, workers, tick
        self._unsent: deque[Piece] = deque()
        self._sent: dict[Piece, Any] = {}

    def take(self, piece: Piece) -> JudgedPiece:
        """Wait for a piece; those behind it are sent meanwhile."""
        self.send()
        future = self._sent[piece]
        judged = self._workers.wait(future, piece, self._tick)
        del self._sent[piece]
        self.send()
        return judged

    def give_up(self, pieces: Sequence[Piece]) -> None:
        """Forget what is left of a recording."""
        for piece in pieces:
            if piece in self._sent:
                self._workers.give_up(self._sent.pop(piece))
        left = set(map(id, pieces))
        self._unsent = deque(piece for piece in self._unsent if id(piece) not in left)

    def send(self) -> None:
        """Send pieces, as many as the workers shall have."""
        ahead = self._workers.ahead
        while len(self._sent) < ahead:
            while not self._unsent:
                following = next(self._recordings, None)
                if following is None:
                    return
                self._unsent.extend(following)
            piece = self._unsent.popleft()
            self._sent[piece] = self._workers.submit(piece)
