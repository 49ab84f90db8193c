# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A stream whose points are moved to a fixed frame: messages wait for their poses first."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.core.blocks import BEGINNING, END
from lidar_outlier_filter.core.points import SECOND
from lidar_outlier_filter.core.poses import Cover
from lidar_outlier_filter.errors import CloudError

if TYPE_CHECKING:
    from collections.abc import Callable

    from lidar_outlier_filter.core.blocks import Stream
    from lidar_outlier_filter.core.points import Points
    from lidar_outlier_filter.core.verdict import Verdict
    from lidar_outlier_filter.parameters.filter import FilterParameters
    from lidar_outlier_filter.stream.motion import PoseSource

    Finished = list[tuple[Any, Verdict]]


@dataclass(frozen=True)
class _WaitingCloud:
    """A message that waits for poses, and the times of its points; ``last`` < ``first`` of none."""

    points: Points
    tag: Any
    frame: str
    first: int
    last: int


class MovingStream:
    """In front of a stream: points in, and on they go, moved, once there are poses for all of them.

    A message waits, and all behind it, until its last pose is there; or until points have come that
    are later by more than ``max_delay``, or it has to hurry: then its points go on as they are,
    in their own frame, and are judged apart from those that were moved.
    """

    def __init__(
        self,
        stream: Stream,
        motion: PoseSource,
        parameters: FilterParameters,
        refuse: Callable[[CloudError], object],
    ) -> None:
        """Return ``refuse`` of messages that the stream refuses when their turn has come."""
        self.unmoved = 0  # messages that went on without poses
        self._stream = stream
        self._motion = motion
        self._refuse = refuse
        self._most = parameters.max_points
        self.wait_at_most(parameters.max_delay)
        self._jump = round(parameters.time_jump * SECOND)
        self._queue: deque[_WaitingCloud] = deque()
        self._held = 0  # points in the queue
        self._newest = BEGINNING
        self._answered: Finished = []  # by a cloud that was refused

    @property
    def waiting(self) -> int:
        """Count the messages without an answer."""
        return len(self._queue) + self._stream.waiting

    @property
    def oldest(self) -> Any:
        """The tag of the message that has waited longest; None where none waits."""
        return self._stream.oldest or (self._queue[0].tag if self._queue else None)

    def wait_at_most(self, seconds: float) -> None:
        """Let messages wait for their poses no longer than this."""
        self._patience = round(seconds * SECOND)

    def push(self, points: Points, tag: Any, frame: str) -> Finished:
        """Take the points of the next message; return the messages that are finished by it.

        ``frame`` is that of its coordinates.

        Raises
        ------
        CloudError
            If the time that it spans cannot be true. Or if more points would be held than
            ``max_points``: time goes on all the same; :meth:`advance` has what that finished.

        """
        t = points.t[points.valid]
        first, last = (int(t.min()), int(t.max())) if len(t) else (END, BEGINNING)
        self._stream.refuse_span(first, last)
        finished: Finished = []
        if last < self._newest - self._jump and len(t):
            self._refuse_too_many(len(points))
            # A clock that was set back: the poses of before will not come any more.
            finished = self.reset()
        self._newest = max(self._newest, last)
        finished += self.advance()
        if not self._queue and self._stream.held + len(points) > self._most:
            self._stream.make_room(first, last)
        try:
            self._refuse_too_many(self._held + self._stream.held + len(points))
        except CloudError:
            self._answered = finished
            raise
        self._queue.append(_WaitingCloud(points, tag, frame, first, last))
        self._held += len(points)
        return finished + self.advance()

    def _refuse_too_many(self, total: int) -> None:
        if total > self._most:
            must_be = f'at most max_points = {self._most}'
            raise CloudError('the number of points held', must_be, total)

    def advance(self) -> Finished:
        """Let go on what has its poses by now, in order."""
        finished = self._take_answered() + self._stream.advance()
        while self._queue:
            head = self._queue[0]
            cover = Cover.YES
            if head.first <= head.last:
                cover = self._motion.cover(head.first, head.last, head.frame)
            if cover is Cover.NOT_YET and head.last >= self._newest - self._patience:
                break
            finished += self._let_go(moved=cover is Cover.YES)
        return finished

    def hurry(self) -> Finished:
        """Answer all that is pending with what is there, and go on."""
        finished = self._let_go_all()
        return finished + self._stream.hurry()

    def hurry_oldest(self) -> Finished:
        """Answer what has waited longest; others may still wait for their poses."""
        finished = self._take_answered()
        if not self._stream.waiting and self._queue:
            finished += self._let_go(moved=False) + self.advance()
        return finished + self._stream.hurry()

    def flush(self) -> Finished:
        """Answer all that is pending with what is there, and begin anew."""
        return self._end() + self._stream.flush()

    def reset(self) -> Finished:
        """Do as :meth:`flush`, because a clock was set back; count it."""
        return self._end() + self._stream.reset()

    def _end(self) -> Finished:
        """Let go of all that waits, and forget the poses."""
        finished = self._let_go_all()
        self._newest = BEGINNING
        self._motion.begin_anew()
        return finished

    def _take_answered(self) -> Finished:
        answered, self._answered = self._answered, []
        return answered

    def _let_go_all(self) -> Finished:
        finished = self.advance()
        while self._queue:
            finished += self._let_go(moved=False)
        return finished

    def _let_go(self, *, moved: bool) -> Finished:
        """Let the first message go on."""
        message = self._queue.popleft()
        self._held -= len(message.points)
        points = self._motion.move(message.points, message.frame) if moved else None
        self.unmoved += points is None
        try:
            if points is None:
                return self._stream.push(message.points, message.tag, f'own: {message.frame}')
            return self._stream.push(points, message.tag)
        except CloudError as err:
            self._refuse(err)
            return []
