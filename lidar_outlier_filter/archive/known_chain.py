# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Chains that stand in for that of a replay: one notes its verdicts, one has them already.

A verdict depends on the points of its block alone. So it is found by their digest: what was judged
elsewhere is used exactly where the same points are to be judged, whatever led to them.
"""

from __future__ import annotations

from bisect import bisect_right
from typing import TYPE_CHECKING

from lidar_outlier_filter.archive.verdict_bytes import digest, pack, unpack
from lidar_outlier_filter.core.judging.chain import Chain
from lidar_outlier_filter.core.verdict import Verdict

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from lidar_outlier_filter.core.points.points import Points
    from lidar_outlier_filter.parameters.filter import FilterParameters
    from lidar_outlier_filter.recordings.bags import Topic


class NotingChain(Chain):
    """A chain that keeps each verdict, as bytes, under the digest of the points.

    Attributes
    ----------
    awake : bool
        Whether it judges; else all points are untested, and nothing is kept.
    verdicts : dict

    """

    def __init__(self, parameters: FilterParameters) -> None:
        """Begin with no verdict, and asleep."""
        super().__init__(parameters)
        self.awake = False
        self.verdicts: dict[bytes, bytes] = {}

    def judge(self, points: Points) -> Verdict:
        """Judge, and keep the verdict."""
        if not self.awake:
            return Verdict.untested(len(points))
        self.passes = 0
        verdict = super().judge(points)
        packed = pack(verdict, self.passes, scores=self.parameters.scores)
        self.verdicts[digest(points)] = packed
        return verdict


class KnowingChain(Chain):
    """A chain for one recording whose pieces are judged elsewhere.

    Attributes
    ----------
    judged, judged_here : int
        Blocks that came, and those of them that no piece had the verdict of.

    """

    def __init__(
        self,
        parameters: FilterParameters,
        starts: Sequence[int],
        verdicts_of: Callable[[int], Mapping[bytes, bytes]],
    ) -> None:
        """Take the pieces of a recording.

        Parameters
        ----------
        parameters : of the filter
        starts : bag times, ns, at which all pieces but the first begin
        verdicts_of : waits for a piece; is called with each number, from 0, in turn

        """
        super().__init__(parameters)
        self._starts, self._verdicts_of = starts, verdicts_of
        self._asked = self._number = -1
        self._verdicts: Mapping[bytes, bytes] = {}
        self.judged = self.judged_here = 0

    def begin(self, _topic: Topic | None, time: int) -> None:
        """Wait for the piece of the message to come at a bag time: what it completes is there.

        Not in :meth:`judge`, where an error would cost a block and no more.
        """
        self._asked = bisect_right(self._starts, time)
        while self._number < self._asked:
            self._verdicts = self._verdicts_of(self._number + 1)
            self._number += 1

    def judge(self, points: Points) -> Verdict:
        """Take the verdict from the piece, or judge where the piece has judged other points."""
        self.judged += 1
        known = self._verdicts if self._asked == self._number else {}
        packed = known.get(digest(points))
        if packed is None:
            self.judged_here += 1
            return super().judge(points)
        verdict, passes = unpack(packed)
        self.passes = max(self.passes, passes)
        return verdict
