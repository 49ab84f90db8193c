# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The input of a detector: points, their scan lines, and their shared neighbourhood."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Allocate
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.core.points import scan_lines
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.points.scan_lines import Lines, ShotReturns
from lidar_outlier_filter.core.points.shared_times import MIN_SHOTS, measure_clock, spread_times
from lidar_outlier_filter.parameters.filter import FilterParameters

Known = TypeVar('Known')
POINTS_AT_ONCE = 1 << 15  # that a thread takes at once, or a line: some milliseconds


class DetectorInput:
    """The points that a detector judges.

    Attributes
    ----------
    points : N valid points
    threads : maximum number of threads; 0: all cores
    gap_factor : where line segments end, see :func:`~.scan_lines.find_lines`
    whole : whether they are a whole cloud, not part of a stream
    allocate : returns large arrays, in memory or in files
    kept : what detectors keep from one block of a stream to the next

    """

    def __init__(
        self,
        points: Points,
        parameters: FilterParameters,
        neighbours: int = 1,
        neighbourhood: Neighbourhood | None = None,
        *,
        whole: bool = False,
        allocate: Allocate = np.empty,
        kept: dict[Hashable, Any] | None = None,
    ) -> None:
        """Take points; ``neighbours`` is the most that a detector will ask for, at least 1."""
        self.points = points
        self.threads = parameters.threads
        self.gap_factor = parameters.gap_factor
        self.whole, self.allocate = whole, allocate
        self.kept: dict[Hashable, Any] = {} if kept is None else kept
        self._parameters, self._neighbours = parameters, neighbours
        self._neighbourhood = neighbourhood
        self._known: dict[Hashable, Any] = {}

    @property
    def neighbourhood(self) -> Neighbourhood:
        """The neighbours of the points, made when a detector first asks for them."""
        if self._neighbourhood is None:
            self._neighbourhood = Neighbourhood(
                self.points.xyz, self._neighbours, self.threads, self.allocate
            )
        return self._neighbourhood

    def cached(self, name: Hashable, find: Callable[[], Known]) -> Known:
        """Compute a property of the points once and keep it; callers must not change it.

        The name must identify everything it depends on besides the points.
        """
        if name not in self._known:
            self._known[name] = find()
        known: Known = self._known[name]
        return known

    def without(self, rejected: NDArray[np.bool_]) -> DetectorInput:
        """Return what is left; what is known of its neighbourhood is kept."""
        known = self._neighbourhood
        known = None if known is None else known.without(rejected)
        left = self.points.take(np.flatnonzero(~rejected), self.allocate)
        return DetectorInput(
            left,
            self._parameters,
            self._neighbours,
            known,
            whole=self.whole,
            allocate=self.allocate,
            kept=self.kept,
        )

    def along_lines(self, detect: Callable[[Points, Lines], Scores]) -> Scores:
        """Give scan lines, some at a time, to a detector that judges each line by itself.

        It sees one return of each shot: first all first ones; then, in the lines that have such,
        each later return in the place of the first, to be judged in its turn. What lies where
        another return of its shot lies gets its score.

        Parameters
        ----------
        detect : of points that are sorted by line and time, and of their lines

        """
        order = scan_lines.order_by_line(self.points)
        # A profile scanner's points come in this order: a copy less.
        unchanged = bool((order[:-1] < order[1:]).all())
        ordered = self.points if unchanged else self.points.take(order)
        clock = measure_clock(ordered.t)
        if clock.shots >= MIN_SHOTS:
            ordered = replace(ordered, t=spread_times(ordered.t, clock))
        returns = scan_lines.find_returns(ordered)
        if returns is None:
            found = self._by_lines(ordered, detect)
        else:
            found = self._by_returns(ordered, returns, detect)
        if unchanged:
            return found
        score = np.empty(len(order))
        score[order] = found.score
        return Scores(score, passes=found.passes)

    def _by_returns(
        self, ordered: Points, returns: ShotReturns, detect: Callable[[Points, Lines], Scores]
    ) -> Scores:
        """Judge first returns, then later ones in their places."""
        number, shot, original = returns
        index = np.arange(len(ordered))
        firsts, score, passes = np.flatnonzero(shot == index), np.empty(len(ordered)), 0
        for n in range(int(number.max()) + 1):
            asked = np.flatnonzero((number == n) & (original == index))
            series = firsts[np.isin(ordered.line[firsts], ordered.line[asked])]
            place = np.searchsorted(series, shot[asked])
            series[place] = asked
            found = self._by_lines(ordered.take(series), detect)
            score[asked], passes = found.score[place], max(passes, found.passes)
        return Scores(score[original], passes=passes)

    def _by_lines(self, ordered: Points, detect: Callable[[Points, Lines], Scores]) -> Scores:
        """Judge points that are sorted by line and time, some lines at a time."""
        first, score = scan_lines.line_starts(ordered.line), np.empty(len(ordered))

        def work(begin: int, end: int) -> int:
            part = slice(first[begin], first[end])
            some = ordered.take(part)
            found = detect(some, scan_lines.find_lines(some, self.gap_factor))
            score[part] = found.score
            return found.passes

        count = len(first) - 1
        chunk = max(1, -(-count * POINTS_AT_ONCE // max(len(ordered), 1)))
        return Scores(score, passes=max(pool.run(work, count, chunk, self.threads), default=0))
