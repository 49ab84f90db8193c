# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The stream: push points, get finished verdicts, whatever the points were cut into.

Sensor time is cut into blocks that are aligned absolutely: block n covers [n·block, (n + 1)·block).
A block is judged, together with its halo on either side, once nothing more can arrive for them. So
a verdict depends on the points alone and not on the messages that brought them.

A sensor that sends one sweep per message may have the message as its block instead: it is judged at
once, with the halo before it only. There the message is part of the question: cut otherwise, the
same points are other blocks. Under ``blocks: auto`` the first clouds choose: ``BlockChoice``.

An error that a detector raises costs its block only: the clouds with points in it have no
verdict, and the next block is judged.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Generic

import numpy as np

from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.engine.stream_cloud import BEGINNING, END, AnyCloud, between
from lidar_outlier_filter.core.points.points import SECOND, concatenate
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.errors import CloudError, JudgingError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from lidar_outlier_filter.core.engine.stream_cloud import StreamCloud
    from lidar_outlier_filter.core.points.points import Points
    from lidar_outlier_filter.parameters.filter import FilterParameters

    _Members = list[tuple[StreamCloud, slice | NDArray[np.intp]]]

MOST_BLOCKS = 10_000  # in one cloud: wild times must not stall the stream
FIRST = 3  # messages that decide under `auto`; the very first sweep may be cut short
SWEEP = 1 / 4  # of `block`: a message that spans less brings scan lines, or has no times


class Stream(Generic[AnyCloud]):
    """Clouds in, and out again with their verdicts, in order.

    ``chain`` may be replaced between two calls: the next block is judged by the new one.
    """

    def __init__(self, parameters: FilterParameters) -> None:
        """Take blocks, block, halo, lateness, time_jump, max_points and chain of the parameters."""
        self.chain = Chain(parameters)
        self.choice = BlockChoice(parameters)
        self._block = round(parameters.block * SECOND)
        self._halo = round(parameters.halo * SECOND)
        self._lateness = round(parameters.lateness * SECOND)
        self._jump = round(parameters.time_jump * SECOND)
        self._most = parameters.max_points
        self.resets = 0
        self.fail: Callable[[JudgingError], object] = str  # is called with each block that it costs
        self._clear()

    def _clear(self) -> None:
        self.choice.begin_anew()
        self._seen: deque[AnyCloud] = deque()  # with points that blocks to come need
        self._waiting: deque[AnyCloud] = deque()  # without an answer yet
        self._answered: list[AnyCloud] = []  # and not returned yet
        self._held = 0  # points in _seen
        self._unanswered = 0  # points in _waiting, missing returns too
        self._newest = BEGINNING  # latest time of any point
        self._pending = END  # earliest time of a point without a verdict
        self._judged = BEGINNING  # every point before this has its verdict
        self._closed = BEGINNING  # no point before this can be taken any more

    @property
    def waiting(self) -> int:
        """Count the clouds without an answer."""
        return len(self._waiting) + len(self._answered)

    @property
    def oldest(self) -> AnyCloud | None:
        """The cloud that has waited longest; None where none waits."""
        waiting = self._answered or self._waiting
        return waiting[0] if waiting else None

    @property
    def held(self) -> int:
        """Count the points held: those that are needed, or those that wait, whichever are more."""
        return max(self._held, self._unanswered)

    def push(self, cloud: AnyCloud) -> list[AnyCloud]:
        """Take the next cloud; return the clouds that are finished by it.

        Clouds of different frames keep their order and their blocks, but their points are not
        judged together.

        Returns
        -------
        list of clouds
            In the order they were pushed, with a verdict, or an error instead of one.

        Raises
        ------
        CloudError
            If a point is older than what was judged already: the stream is as it was before. Or if
            more points would be held than ``max_points``: time goes on all the same, so that what
            is held is judged and forgotten in its time; :meth:`advance` has what that finished.

        """
        set_back = len(cloud.points) > 0 and cloud.last < self._newest - self._jump
        self.refuse_span(cloud.first, cloud.last)
        self._refuse_late(cloud, anew=set_back)
        self._refuse_too_many(cloud, anew=set_back)
        # A clock that was set back: what was before has nothing to do with what comes.
        finished = self.reset() if set_back else []
        if self.choice.becomes_message(cloud.first, cloud.last):
            # Nothing will complete the blocks of those before it.
            finished += self.hurry()
        if len(cloud.points):
            self._seen.append(cloud)
        self._waiting.append(cloud)
        self._held += len(cloud.points)
        self._unanswered += cloud.count
        self._newest = max(self._newest, cloud.last)
        self._pending = min(self._pending, self._first_pending(cloud))
        if self.choice.by_message:
            self._judge_message(cloud)
        else:
            self._judge_until(self._newest - self._lateness)
        return finished + self._finished()

    def advance(self) -> list[AnyCloud]:
        """Return the clouds that were finished by one that was refused."""
        return self._finished()

    def make_space(self, first: int, last: int) -> None:
        """Let time go on, as a cloud of these times would: nanoseconds; it may be refused yet.

        What it completes, and has no part in, is judged and forgotten.
        """
        self._newest = max(self._newest, last)
        if not self.choice.by_message:
            self._close(min(first, self._newest - self._lateness))
        elif first < END:
            self._forget(first - self._halo)

    def flush(self) -> list[AnyCloud]:
        """Judge all that is pending with what is there, and begin anew."""
        finished = self.hurry()
        self._clear()
        return finished

    def reset(self) -> list[AnyCloud]:
        """Do as :meth:`flush`, because a clock was set back; count it."""
        self.resets += 1
        return self.flush()

    def hurry(self) -> list[AnyCloud]:
        """Judge all that is pending with what is there, and go on: what comes sees it as halo."""
        self._judge_until(END)
        return self._finished()

    def refuse_span(self, first: int, last: int) -> None:
        """Refuse a cloud whose times, nanoseconds, cannot be true."""
        most = MOST_BLOCKS * self._block
        if last - first > most:
            got = f'{(last - first) / SECOND:g} s'
            raise CloudError('the time that a cloud spans', f'at most {most / SECOND:g} s', got)

    def _refuse_late(self, cloud: StreamCloud, *, anew: bool) -> None:
        if not anew and cloud.first < self._closed and not self.choice.by_message:
            late = (self._closed - cloud.first) / SECOND
            got = f'a point {late:.6f} s older than that'
            raise CloudError('the time of a cloud', 'at or after what is judged already', got)

    def _refuse_too_many(self, cloud: StreamCloud, *, anew: bool) -> None:
        total = cloud.count
        if not anew:
            if self._total_with(cloud) > self._most:
                self.make_space(cloud.first, cloud.last)
            total = self._total_with(cloud)
        if total > self._most:
            raise CloudError(
                'the number of points held', f'at most max_points = {self._most}', total
            )

    def _total_with(self, cloud: StreamCloud) -> int:
        """Count the points that would be held with a cloud."""
        return max(self._held + len(cloud.points), self._unanswered + cloud.count)

    def _close(self, complete: int) -> None:
        """Judge every block that is complete with its halo, and take no point of it any more.

        Also where nothing is pending: what is held is held for blocks that may come.
        """
        self._judge_until(complete)
        end = (complete - self._halo) // self._block * self._block
        if end > self._judged:
            self._judged, self._closed = end, end + self._halo
            self._forget()
        self._settle()

    def _judge_until(self, complete: int) -> None:
        """Judge every block that is complete with its halo; END: every block, complete or not."""
        while self._pending != END:
            begin = self._pending - self._pending % self._block
            end = begin + self._block
            if end + self._halo > complete:
                return
            self._judge(begin, end)
            if complete == END:
                # What comes later in this block is still welcome, and what comes at this very time,
                # untested, too: sensors send points of one time in two clouds.
                self._judged = min(end, self._newest + 1)
                self._closed = min(end, self._newest)
            else:
                self._judged, self._closed = end, end + self._halo
            self._look_for_pending()
            self._forget()

    def _judge(self, begin: int, end: int) -> None:
        """Judge the pending points of one block with its halo."""
        members = self._members(begin - self._halo, end + self._halo)
        if all(cloud.known for cloud, _ in members if begin <= cloud.last and cloud.first < end):
            return
        verdict = self._judge_together(members)
        begin = max(begin, self._judged)
        offset = 0
        for cloud, index in members:
            t = cloud.points.t[index]
            mine = between(t, begin, end, is_sorted=cloud.is_sorted)
            if not isinstance(verdict, JudgingError):
                result = verdict.take(slice(offset, offset + len(t))).take(mine)
                cloud.verdict.put(cloud.where[index][mine], result)
            elif len(t[mine]):
                cloud.error = verdict
            offset += len(t)

    def _judge_message(self, cloud: AnyCloud) -> None:
        """Judge a cloud with the halo before it, and with what lies in its own time, at once."""
        if cloud.first < END and not cloud.known:
            # The cloud is the last of those seen, but others may have later points.
            members = self._members(cloud.first - self._halo, cloud.last + 1)
            verdict = self._judge_together(members)
            if isinstance(verdict, JudgingError):
                cloud.error = verdict
            else:
                result = verdict.take(slice(len(verdict) - len(cloud.points), None))
                cloud.verdict.put(cloud.where, result)
        self._judged = END
        self._pending = END
        self._forget(self._newest - self._halo)

    def _members(self, first: int, last: int) -> _Members:
        """Find all points with first <= t < last, cloud by cloud."""
        near = [cloud for cloud in self._seen if first <= cloud.last and cloud.first < last]
        return [(cloud, cloud.between(first, last)) for cloud in near]

    def _judge_together(self, members: _Members) -> Verdict | JudgingError:
        """Judge points; the verdict is in the order of their clouds."""
        try:
            parts: list[tuple[str, Points, NDArray[np.intp]]] = []
            count = 0
            for cloud, index in members:
                split = cloud.in_frames(index)
                parts += [(frame, points, count + indices) for frame, points, indices in split]
                count += sum(len(points) for _, points, _ in split)
            if len(parts) == len(members) and len({frame for frame, _, _ in parts}) == 1:
                return self.chain.judge(concatenate([points for _, points, _ in parts]))
            return self._judge_apart(parts, count)
        except Exception as err:  # noqa: BLE001  whatever it is, the next block is judged
            error = JudgingError(err)
            self.fail(error)
            return error

    def _judge_apart(
        self, parts: list[tuple[str, Points, NDArray[np.intp]]], count: int
    ) -> Verdict:
        """Judge the points of each frame by themselves; each part has its indices of the count."""
        verdict = Verdict.untested(count)
        for frame in sorted({frame for frame, _, _ in parts}):
            mine = [(points, indices) for other, points, indices in parts if other == frame]
            result = self.chain.judge(concatenate([points for points, _ in mine]))
            verdict.put(np.concatenate([indices for _, indices in mine]), result)
        return verdict

    def _look_for_pending(self) -> None:
        firsts = (self._first_pending(cloud) for cloud in self._waiting)
        self._pending = min(firsts, default=END)

    def _first_pending(self, cloud: AnyCloud) -> int:
        """Return the earliest time of a point of the cloud without a verdict; END for none."""
        if cloud.first >= self._judged:
            return cloud.first
        if cloud.last < self._judged:
            return END
        t = cloud.points.t
        return int(t[t >= self._judged].min())

    def _forget(self, needed: int | None = None) -> None:
        """Let go of clouds that end before the halo of the block to come."""
        if needed is None:
            needed = self._judged - self._judged % self._block - self._halo
        self._seen = deque(cloud for cloud in self._seen if cloud.last >= needed)
        self._held = sum(len(cloud.points) for cloud in self._seen)

    def _finished(self) -> list[AnyCloud]:
        """Take the clouds whose points are all judged."""
        self._settle()
        finished, self._answered = self._answered, []
        return finished

    def _settle(self) -> None:
        """Answer the clouds from the head of the queue whose points are all judged."""
        while self._waiting and self._waiting[0].last < self._judged:
            cloud = self._waiting.popleft()
            self._unanswered -= cloud.count
            cloud.finish()
            self._answered.append(cloud)


class BlockChoice:
    """Chooses what `blocks` names; under `auto` by the first messages of a stream alone.

    So live and replay choose the same.

    Attributes
    ----------
    by_message : bool
        Whether each message is a block. Stretches of time are the blocks until that is decided.
    inform : callable
        Is called with a sentence that says what `auto` has chosen.

    """

    def __init__(self, parameters: FilterParameters) -> None:
        """Take blocks and block."""
        self._blocks = parameters.blocks
        self._least = round(SWEEP * parameters.block * SECOND)
        self.inform: Callable[[str], object] = str
        self.begin_anew()

    def begin_anew(self) -> None:
        """Choose anew: what comes is another stream."""
        self.by_message = self._blocks == 'message'
        self._left = FIRST if self._blocks == 'auto' else 0

    def becomes_message(self, first: int, last: int) -> bool:
        """Look at the times of the next message, ns; return whether from it on messages are blocks.

        A message without points, whose ``last`` is before ``first``, decides nothing.
        """
        if not self._left or last < first:
            return False
        self._left -= 1
        span = f'a message spans {(last - first) / SECOND:.3g} s'
        if last - first >= self._least:
            self.by_message, self._left = True, 0
            self.inform(f'blocks: each message is judged at once, because {span}')
        elif not self._left:
            self.inform(f'blocks: messages wait for stretches of sensor time, because {span}')
        return self.by_message
