# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A stream whose points are moved to a fixed frame: clouds wait for their poses first."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import TYPE_CHECKING, Generic

from lidar_outlier_filter.core.engine.stream_cloud import BEGINNING, AnyCloud
from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.errors import CloudError

if TYPE_CHECKING:
    from collections.abc import Callable

    from lidar_outlier_filter.core.engine.blocks import Stream
    from lidar_outlier_filter.parameters.filter import FilterParameters
    from lidar_outlier_filter.pipeline.motion import PoseSource


class MovingStream(Generic[AnyCloud]):
    """In front of a stream: clouds in, and on they go, moved, once their poses are there.

    A cloud waits, and all behind it, until its last pose is there; or until points have come that
    are later by more than ``max_delay``, or it has to hurry. Points without poses, also those
    within a gap, go on as they are, in their own frame, and are judged apart from those that were
    moved: each for itself, so that it does not matter which points come in one message.
    """

    def __init__(
        self,
        stream: Stream[AnyCloud],
        motion: PoseSource,
        parameters: FilterParameters,
        refuse: Callable[[CloudError], object],
    ) -> None:
        """Call ``refuse`` with the error of a cloud that the stream refuses in its turn."""
        self.unmoved = 0  # clouds with points that went on without poses
        self._stream = stream
        self._motion = motion
        self._refuse = refuse
        self._most = parameters.max_points
        self.wait_at_most(parameters.max_delay)
        self._jump = round(parameters.time_jump * SECOND)
        self._queue: deque[AnyCloud] = deque()
        self._held = 0  # points in the queue
        self._newest = BEGINNING
        self._answered: list[AnyCloud] = []  # by a cloud that was refused

    @property
    def waiting(self) -> int:
        """Count the clouds without an answer."""
        return len(self._queue) + self._stream.waiting

    @property
    def oldest(self) -> AnyCloud | None:
        """The cloud that has waited longest; None where none waits."""
        return self._stream.oldest or (self._queue[0] if self._queue else None)

    def wait_at_most(self, seconds: float) -> None:
        """Let clouds wait for their poses no longer than this."""
        self._patience = round(seconds * SECOND)

    def push(self, cloud: AnyCloud) -> list[AnyCloud]:
        """Take the next cloud; return the clouds that are finished by it.

        Its ``frame`` is that of its coordinates. In the end it is empty for the one that stands
        still, and starts with ``own:`` for others.

        Raises
        ------
        CloudError
            If the time that it spans cannot be true. Or if more points would be held than
            ``max_points``: time goes on all the same; :meth:`advance` has what that finished.

        """
        self._stream.refuse_span(cloud.first, cloud.last)
        finished: list[AnyCloud] = []
        if cloud.last < self._newest - self._jump and len(cloud.points):
            self._refuse_too_many(cloud.count)
            # A clock that was set back: the poses of before will not come any more.
            finished = self.reset()
        self._newest = max(self._newest, cloud.last)
        finished += self.advance()
        if not self._queue and self._stream.held + cloud.count > self._most:
            self._stream.make_space(cloud.first, cloud.last)
        try:
            self._refuse_too_many(self._held + self._stream.held + cloud.count)
        except CloudError:
            self._answered = finished
            raise
        self._queue.append(cloud)
        self._held += cloud.count
        return finished + self.advance()

    def _refuse_too_many(self, total: int) -> None:
        if total > self._most:
            must_be = f'at most max_points = {self._most}'
            raise CloudError('the number of points held', must_be, total)

    def advance(self) -> list[AnyCloud]:
        """Let go on what has its poses by now, in order."""
        finished = self._take_answered() + self._stream.advance()
        while self._queue:
            head = self._queue[0]
            has_all = head.last < head.first or self._motion.reaches(head.last, head.frame)
            if not has_all and head.last >= self._newest - self._patience:
                break
            finished += self._let_go()
        return finished

    def hurry(self) -> list[AnyCloud]:
        """Answer all that is pending with what is there, and go on."""
        finished = self._let_go_all()
        return finished + self._stream.hurry()

    def hurry_oldest(self) -> list[AnyCloud]:
        """Answer what has waited longest; others may still wait for their poses."""
        finished = self._take_answered()
        if not self._stream.waiting and self._queue:
            finished += self._let_go() + self.advance()
        return finished + self._stream.hurry()

    def flush(self) -> list[AnyCloud]:
        """Answer all that is pending with what is there, and begin anew."""
        return self._end() + self._stream.flush()

    def reset(self) -> list[AnyCloud]:
        """Do as :meth:`flush`, because a clock was set back; count it."""
        return self._end() + self._stream.reset()

    def _end(self) -> list[AnyCloud]:
        """Let go of all that waits, and forget the poses."""
        finished = self._let_go_all()
        self._newest = BEGINNING
        self._motion.begin_anew()
        return finished

    def _take_answered(self) -> list[AnyCloud]:
        answered, self._answered = self._answered, []
        return answered

    def _let_go_all(self) -> list[AnyCloud]:
        finished = self.advance()
        while self._queue:
            finished += self._let_go()
        return finished

    def _let_go(self) -> list[AnyCloud]:
        """Let the first cloud go on, moved by what there is."""
        cloud = self._queue.popleft()
        self._held -= cloud.count
        cloud.points, moved = self._motion.move(cloud.points, cloud.frame)
        if moved.all():
            cloud.frame = ''
        else:
            self.unmoved += 1
            cloud.frame = f'own: {cloud.frame}'
            if moved.any():
                cloud.points = replace(cloud.points, fixed=moved)
        try:
            return self._stream.push(cloud)
        except CloudError as err:
            self._refuse(err)
            return []
