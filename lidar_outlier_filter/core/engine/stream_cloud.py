# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A cloud on its way through the blocks, from push to verdict."""

from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Ints
from lidar_outlier_filter.core.points.points import Points, concatenate
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.errors import JudgingError

BEGINNING = -(2**62)  # before any time, nanoseconds
END = 2**62


@dataclass(eq=False)
class StreamCloud:
    """The points of one cloud, which wait for their verdict or are the halo of others.

    Subclasses add what their caller needs when the cloud is finished.

    Attributes
    ----------
    points : Points
        All points are given; the valid ones are kept.
    frame : str
        Frame of the coordinates; empty for the fixed frame, which ``points.fixed`` are in, too.
        Points of different frames are never judged together.
    where : (M,) int64
        Indices of the valid points in the cloud.
    verdict : Verdict
        Of all N points of the cloud; invalid points are untested.
    vehicle : Points or None
        Points on the own vehicle, if there is a mask.
    error : JudgingError or None
        Error that a detector raised in a block with points of the cloud. All points are untested
        then.
    first, last : int
        Earliest and latest time, nanoseconds; ``last`` < ``first`` of a cloud without valid points.
    is_sorted : bool
        Whether the valid points are sorted by time.

    """

    points: Points
    frame: str = ''
    where: NDArray[np.intp] = field(init=False)
    verdict: Verdict = field(init=False)
    vehicle: Points | None = field(init=False, default=None)
    error: JudgingError | None = field(init=False, default=None)
    first: int = field(init=False)
    last: int = field(init=False)
    is_sorted: bool = field(init=False)

    def __post_init__(self) -> None:
        """Select the valid points, and note the interval of time that they cover."""
        self.verdict = Verdict.beforehand(self.points)
        if self.points.masked is not None:
            self.vehicle = self.points.take(self.points.masked)
            self.points = replace(self.points, masked=None, shadow=None)
        self.where = np.flatnonzero(self.points.valid)
        if len(self.where) != len(self.points):
            self.points = self.points.take(self.where)
        t = self.points.t
        self.first, self.last = (int(t.min()), int(t.max())) if len(t) else (END, BEGINNING - 1)
        self.is_sorted = bool((t[1:] >= t[:-1]).all())

    @property
    def count(self) -> int:
        """Number of points, missing returns included."""
        return len(self.verdict)

    @property
    def absent(self) -> int:
        """Number of missing returns."""
        vehicle = 0 if self.vehicle is None else len(self.vehicle)
        return self.count - len(self.where) - vehicle

    @property
    def shown(self) -> tuple[Points, NDArray[np.intp]]:
        """Points to draw, and their indices: valid points, and points on the own vehicle.

        The latter are left out of a cloud that was moved.
        """
        if self.vehicle is None or self.points.own is not None:
            return self.points, self.where
        where = np.concatenate([self.where, np.flatnonzero(self.verdict.masked)])
        return concatenate([self.points, replace(self.vehicle, masked=None, shadow=None)]), where

    def between(self, begin: int, end: int) -> slice | NDArray[np.intp]:
        """Find the valid points with begin <= t < end."""
        if begin <= self.first and self.last < end:
            return slice(None)
        return between(self.points.t, begin, end, is_sorted=self.is_sorted)

    def in_frames(
        self, index: slice | NDArray[np.intp]
    ) -> list[tuple[str, Points, NDArray[np.intp]]]:
        """Select valid points; return frame, points and their positions in the selection."""
        points = self.points.take(index)
        indices = np.arange(len(points))
        if points.fixed is None:
            return [(self.frame, points, indices)]
        fixed, points = points.fixed, replace(points, fixed=None)
        there, own = indices[fixed], indices[~fixed]
        parts = ('', points.take(there), there), (self.frame, points.take(own).in_own_frame, own)
        return [part for part in parts if len(part[2])]

    def finish(self) -> None:
        """Discard the verdict of a cloud that was judged in part."""
        if self.error is not None:
            self.verdict = Verdict.untested(self.count)


AnyCloud = TypeVar('AnyCloud', bound=StreamCloud)


def between(t: Ints, begin: int, end: int, *, is_sorted: bool) -> slice | NDArray[np.intp]:
    """Find the times with begin <= t < end."""
    if is_sorted:
        # Views, not copies: most sensors send their points in order.
        return slice(*np.searchsorted(t, (begin, end)).tolist())
    return np.flatnonzero((t >= begin) & (t < end))
