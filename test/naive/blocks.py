# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A stream of clouds that is cut into blocks, with plain loops over all its points.

Times are integers; a missing return has None. The verdict of a point is the list of the times that
it was judged with, or None.
"""

from __future__ import annotations

from collections.abc import Sequence

BEGINNING, END = -(2**62), 2**62
AUTO_MESSAGES = 3


class Cloud:
    """Its name, its times, and what each point was judged with."""

    def __init__(self, tag: object, times: Sequence[int | None]) -> None:
        """Begin without any verdict."""
        self.tag, self.times = tag, list(times)
        self.valid = [t for t in times if t is not None]
        self.first = min(self.valid, default=END)
        self.last = max(self.valid, default=BEGINNING - 1)
        self.verdict: list[list[int] | None] = [None] * len(self.times)


class Blocks:
    """Pushes clouds; ``results`` has those that are finished."""

    def __init__(  # noqa: PLR0913  the parameters of the stream
        self, kind: str, block: int, halo: int, lateness: int, jump: int, max_points: int
    ) -> None:
        """Take the parameters, times as those of points."""
        self.kind, self.block, self.halo = kind, block, halo
        self.lateness, self.jump, self.max_points = lateness, jump, max_points
        self.resets = 0
        self.results: list[Cloud] = []
        self.clear()

    def clear(self) -> None:
        """Forget all."""
        self.by_message = self.kind == 'message'
        self.undecided = AUTO_MESSAGES if self.kind == 'auto' else 0
        self.seen: list[Cloud] = []
        self.pending: list[Cloud] = []
        self.newest = self.judged = self.closed = BEGINNING

    def held(self, more: Cloud | None = None) -> int:
        """Count the points that are kept, with one more cloud."""
        clouds = [] if more is None else [more]
        seen = sum(len(cloud.valid) for cloud in [*self.seen, *clouds])
        return max(seen, sum(len(cloud.times) for cloud in [*self.pending, *clouds]))

    def push(self, tag: object, times: Sequence[int | None]) -> str:
        """Push a cloud; return why it is refused, '' where it is not."""
        cloud = Cloud(tag, times)
        if cloud.valid and cloud.last < self.newest - self.jump:
            if len(cloud.times) > self.max_points:
                return 'held'
            self.resets += 1
            self.flush()
        elif not self.by_message and cloud.first < self.closed:
            return 'late'
        elif self.held(cloud) > self.max_points:
            self.make_room(cloud)
            if self.held(cloud) > self.max_points:
                return 'held'
        if self.undecided and cloud.valid:
            self.undecided -= 1
            if cloud.last - cloud.first >= self.block / 4:
                self.by_message, self.undecided = True, 0
                self.judge(END)
        if cloud.valid:
            self.seen.append(cloud)
        self.pending.append(cloud)
        self.newest = max(self.newest, cloud.last)
        if self.by_message:
            self.judge_message(cloud)
        else:
            self.judge(self.newest - self.lateness)
        self.finish()
        return ''

    def make_room(self, cloud: Cloud) -> None:
        """Let time go on as the cloud would let it."""
        self.newest = max(self.newest, cloud.last)
        if self.by_message:
            if cloud.valid:
                self.forget(cloud.first - self.halo)
            return
        complete = min(cloud.first, self.newest - self.lateness)
        self.judge(complete)
        end = (complete - self.halo) // self.block * self.block
        if end > self.judged:
            self.judged, self.closed = end, end + self.halo
            self.forget(end - self.halo)
        self.finish()

    def judge(self, complete: int) -> None:
        """Judge all blocks whose halo ends by then."""
        while True:
            points = [t for cloud in self.pending for t in cloud.valid if t >= self.judged]
            begin = min(points, default=END) // self.block * self.block
            end = begin + self.block
            if not points or (end + self.halo > complete and complete != END):
                return
            near = self.between(begin - self.halo, end + self.halo)
            for cloud in self.pending:
                for number, t in enumerate(cloud.times):
                    if t is not None and max(begin, self.judged) <= t < end:
                        cloud.verdict[number] = near
            self.judged, self.closed = end, end + self.halo
            if complete == END:
                self.judged, self.closed = min(end, self.newest + 1), min(end, self.newest)
            self.forget(self.judged // self.block * self.block - self.halo)

    def judge_message(self, cloud: Cloud) -> None:
        """Judge a cloud with what lies in its time and in the halo before it."""
        near = self.between(cloud.first - self.halo, cloud.last + 1)
        cloud.verdict = [None if t is None else near for t in cloud.times]
        self.judged = END
        self.forget(self.newest - self.halo)

    def between(self, begin: int, end: int) -> list[int]:
        """Return all times from begin to before end."""
        return [t for cloud in self.seen for t in cloud.valid if begin <= t < end]

    def forget(self, needed: int) -> None:
        """Forget clouds that ended before."""
        self.seen = [cloud for cloud in self.seen if cloud.last >= needed]

    def finish(self) -> None:
        """Publish clouds in order."""
        while self.pending and self.pending[0].last < self.judged:
            self.results.append(self.pending.pop(0))

    def flush_pending(self) -> None:
        """Publish all, and go on."""
        self.judge(END)
        self.finish()

    def flush(self) -> None:
        """Publish and forget all."""
        self.flush_pending()
        self.clear()
