# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Blocks: clouds are cut by sensor time, so that verdicts do not depend on message boundaries.

Block n covers [n·block, (n + 1)·block), aligned absolutely. It is judged, together with its halo on
either side, once no more point can arrive for it.

For sensors that send one sweep per message, each message can be a block instead: it is judged at
once, with the halo before it. Its verdict then depends on how the sensor cuts its messages. Under
``blocks: auto`` the first messages decide which of the two applies.

A detector that raises an error costs one block: clouds with points in that block get an error
instead of a verdict, and the next block is judged.
"""

from collections import deque
from collections.abc import Callable
from typing import Generic

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.engine.stream_cloud import (
    BEGINNING,
    END,
    AnyCloud,
    StreamCloud,
    between,
)
from lidar_outlier_filter.core.points.points import SECOND, Points, concatenate
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.errors import CloudError, JudgingError
from lidar_outlier_filter.parameters.filter import FilterParameters

_Members = list[tuple[StreamCloud, slice | NDArray[np.intp]]]

MAX_BLOCKS_PER_CLOUD = 10_000  # absurd times must not stall the stream
AUTO_MESSAGES = 3  # messages that decide under `auto`: the very first sweep may be cut short
MIN_SWEEP = 1 / 4  # of `block`: a shorter message carries scan lines, or has no times


class Blocks(Generic[AnyCloud]):
    """Judges clouds block by block; each comes back in order, with its verdict.

    Attributes
    ----------
    chain : Chain
        May be replaced between two calls: the next block is judged by the new one.
    pending : deque of clouds
        Clouds without a verdict, oldest first.
    by_message : bool
        Whether each message is a block.
    resets : int
        How often the clock was set back.
    inform : callable
        Called with a sentence that says what ``blocks: auto`` has chosen.
    fail : callable
        Called with the error of each block that a detector failed on.

    """

    def __init__(self, parameters: FilterParameters) -> None:
        self.chain = Chain(parameters)
        self.resets = 0
        self.inform: Callable[[str], object] = str
        self.fail: Callable[[JudgingError], object] = str
        self._kind = parameters.blocks
        self._block = round(parameters.block * SECOND)
        self._halo = round(parameters.halo * SECOND)
        self._lateness = round(parameters.lateness * SECOND)
        self._jump = round(parameters.time_jump * SECOND)
        self._max_points = parameters.max_points
        self._clear()

    def _clear(self) -> None:
        self.by_message = self._kind == 'message'
        self._undecided = AUTO_MESSAGES if self._kind == 'auto' else 0
        self.pending: deque[AnyCloud] = deque()
        self._finished: list[AnyCloud] = []  # judged, and not returned yet
        self._seen: deque[AnyCloud] = deque()  # with points that later blocks need
        self._seen_points = self._pending_points = 0  # without missing returns, and with them
        self._newest = BEGINNING  # latest time of any point
        self._first_pending = END  # earliest time of a point without a verdict
        self._judged = BEGINNING  # every point before this has its verdict
        self._closed = BEGINNING  # points before this are refused

    def push(self, cloud: AnyCloud) -> list[AnyCloud]:
        """Add the next cloud; return the clouds that are finished by it.

        Clouds of different frames keep their order and their blocks, but their points are not
        judged together.

        Raises
        ------
        CloudError
            If a point is older than a judged block; nothing changes. Or if more than ``max_points``
            points would be held; time still advances, the blocks that are due are judged, and
            ``take_finished`` returns their clouds.

        """
        is_reset = self.is_set_back(cloud, self._newest)
        self.refuse_span(cloud)
        if is_reset:
            self.refuse_more_than_fit(cloud.count)
            self.resets += 1
            finished = self.flush()
        else:
            if cloud.first < self._closed and not self.by_message:
                late = (self._closed - cloud.first) / SECOND
                got = f'a point {late:.6f} s older than that'
                raise CloudError('the time of a cloud', 'at or after what is judged already', got)
            self.make_room(cloud)
            finished = []
        if self._becomes_message(cloud):
            # Messages before it are incomplete blocks, which nothing will complete.
            self._judge_until(END)
        self._add(cloud)
        if self.by_message:
            self._judge_message(cloud)
        else:
            self._judge_until(self._newest - self._lateness)
        return finished + self.take_finished()

    def take_finished(self) -> list[AnyCloud]:
        """Return the clouds that were finished since the last call, oldest first."""
        while self.pending and self.pending[0].last < self._judged:
            cloud = self.pending.popleft()
            self._pending_points -= cloud.count
            cloud.finish()
            self._finished.append(cloud)
        finished, self._finished = self._finished, []
        return finished

    def flush_pending(self) -> list[AnyCloud]:
        """Judge all pending points with what has arrived; later clouds see them as their halo."""
        self._judge_until(END)
        return self.take_finished()

    def flush(self) -> list[AnyCloud]:
        """Judge all pending points, then forget all points: the end of a stream."""
        finished = self.flush_pending()
        self._clear()
        return finished

    def is_set_back(self, cloud: StreamCloud, newest: int) -> bool:
        """Return whether the clock of a cloud was set back after ``newest``, nanoseconds."""
        return len(cloud.points) > 0 and cloud.last < newest - self._jump

    def refuse_span(self, cloud: StreamCloud) -> None:
        """Refuse a cloud whose points span an absurd time."""
        limit = MAX_BLOCKS_PER_CLOUD * self._block
        if cloud.last - cloud.first > limit:
            got = f'{(cloud.last - cloud.first) / SECOND:g} s'
            raise CloudError('the time that a cloud spans', f'at most {limit / SECOND:g} s', got)

    def refuse_more_than_fit(self, total: int) -> None:
        """Refuse a cloud that would exceed the limit of points in memory."""
        if total > self._max_points:
            must_be = f'at most max_points = {self._max_points}'
            raise CloudError('the number of points held', must_be, total)

    def make_room(self, cloud: StreamCloud, waiting: int = 0) -> None:
        """Refuse a cloud that does not fit beside ``waiting`` other points.

        If it does not fit and nothing else is waiting, the earlier blocks that it completes are
        judged and released first.
        """
        if waiting == 0 and self._points_with(cloud) > self._max_points:
            self._advance_time(cloud)
        self.refuse_more_than_fit(self._points_with(cloud) + waiting)

    def _points_with(self, cloud: StreamCloud) -> int:
        """Count the points that would be held with a cloud."""
        return max(self._seen_points + len(cloud.points), self._pending_points + cloud.count)

    def _advance_time(self, cloud: StreamCloud) -> None:
        self._newest = max(self._newest, cloud.last)
        if self.by_message:
            if cloud.first < END:
                self._forget(cloud.first - self._halo)
            return
        complete = min(cloud.first, self._newest - self._lateness)
        self._judge_until(complete)
        # Also where nothing is pending: what is held is held for blocks that may come.
        end = (complete - self._halo) // self._block * self._block
        if end > self._judged:
            self._judged, self._closed = end, end + self._halo
            self._forget()
        self._finished = self.take_finished()

    def _becomes_message(self, cloud: StreamCloud) -> bool:
        """Decide ``blocks: auto``; return whether each message is a block from this one on."""
        if not self._undecided or not len(cloud.points):
            return False
        self._undecided -= 1
        length = cloud.last - cloud.first
        span = f'a message spans {length / SECOND:.3g} s'
        if length >= round(MIN_SWEEP * self._block):
            self.by_message, self._undecided = True, 0
            self.inform(f'blocks: each message is one block, because {span}')
        elif not self._undecided:
            self.inform(f'blocks: messages are judged in blocks of time, because {span}')
        return self.by_message

    def _add(self, cloud: AnyCloud) -> None:
        if len(cloud.points):
            self._seen.append(cloud)
        self.pending.append(cloud)
        self._seen_points += len(cloud.points)
        self._pending_points += cloud.count
        self._newest = max(self._newest, cloud.last)
        self._first_pending = min(self._first_pending, self._first_pending_in(cloud))

    def _judge_until(self, complete: int) -> None:
        """Judge every block that is complete with its halo; END: every block, complete or not."""
        while self._first_pending != END:
            begin = self._first_pending - self._first_pending % self._block
            end = begin + self._block
            if end + self._halo > complete:
                return
            self._judge_block(begin, end)
            if complete == END:
                # Later points of this block are still accepted, and so are points of this very
                # time: sensors send points of one time in two messages.
                self._judged = min(end, self._newest + 1)
                self._closed = min(end, self._newest)
            else:
                self._judged, self._closed = end, end + self._halo
            firsts = (self._first_pending_in(cloud) for cloud in self.pending)
            self._first_pending = min(firsts, default=END)
            self._forget()

    def _judge_block(self, begin: int, end: int) -> None:
        """Judge the pending points of one block with its halo."""
        members = self._members(begin - self._halo, end + self._halo)
        verdict = self._judge_members(members)
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
        """Judge a cloud at once, with the halo before it and other points of its time."""
        if cloud.first < END:
            # The cloud is the last one, but others may have later points.
            verdict = self._judge_members(self._members(cloud.first - self._halo, cloud.last + 1))
            if isinstance(verdict, JudgingError):
                cloud.error = verdict
            else:
                result = verdict.take(slice(len(verdict) - len(cloud.points), None))
                cloud.verdict.put(cloud.where, result)
        self._judged = self._first_pending = END
        self._forget(self._newest - self._halo)

    def _members(self, first: int, last: int) -> _Members:
        """Find all points with first <= t < last, cloud by cloud."""
        near = [cloud for cloud in self._seen if first <= cloud.last and cloud.first < last]
        return [(cloud, cloud.between(first, last)) for cloud in near]

    def _judge_members(self, members: _Members) -> Verdict | JudgingError:
        """Run the chain on the points of each frame; the verdict is in the order of the clouds."""
        try:
            by_frame: dict[str, list[tuple[Points, NDArray[np.intp]]]] = {}
            count = 0
            for cloud, index in members:
                for frame, points, where in (split := cloud.in_frames(index)):
                    by_frame.setdefault(frame, []).append((points, count + where))
                count += sum(len(points) for _, points, _ in split)
            if len(by_frame) == 1:
                (parts,) = by_frame.values()
                return self.chain.judge(concatenate([points for points, _ in parts]))
            verdict = Verdict.untested(count)
            for _, parts in sorted(by_frame.items()):
                result = self.chain.judge(concatenate([points for points, _ in parts]))
                verdict.put(np.concatenate([where for _, where in parts]), result)
        except Exception as err:  # noqa: BLE001  whatever it is, the next block is judged
            error = JudgingError(err)
            self.fail(error)
            return error
        return verdict

    def _first_pending_in(self, cloud: AnyCloud) -> int:
        """Return the earliest time of a cloud's points without a verdict; END if there are none."""
        if cloud.first >= self._judged:
            return cloud.first
        if cloud.last < self._judged:
            return END
        t = cloud.points.t
        return int(t[t >= self._judged].min())

    def _forget(self, needed: int | None = None) -> None:
        """Forget clouds that end before the halo of the next block."""
        if needed is None:
            needed = self._judged - self._judged % self._block - self._halo
        self._seen = deque(cloud for cloud in self._seen if cloud.last >= needed)
        self._seen_points = sum(len(cloud.points) for cloud in self._seen)
