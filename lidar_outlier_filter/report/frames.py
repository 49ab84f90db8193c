# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Frames: points that are drawn together, and that the time slider steps through."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.points.points import SECOND

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.report.gather import Gathered
    from lidar_outlier_filter.report.keeping import Kept

STRETCH = SECOND // 10  # nanoseconds: of clouds that are shorter, those within this are one frame
SHORT = STRETCH // 4
MOST_FRAMES = 1000
APART = 0.3  # of the size of a frame: frames whose middles are farther apart lie beside each other
PART = 100_000  # points of a file that are drawn together


@dataclass(frozen=True)
class Frames:
    """How the points are cut, and in which order they are drawn.

    Attributes
    ----------
    order : (N,) int64
        The points, frame by frame. In each first those with reasons, then others that any step
        rejects, then the rest in random order: any first part of it is an even sample.
    first : (F + 1,) int64
        Where each frame begins in that order.
    explained, marked : (F,) int64
        How many of a frame have reasons, and how many have reasons or are rejected by any step.
    clouds : for each frame the numbers of its clouds; empty for files
    start : (F,) int64
        Its earliest time, nanoseconds.
    together : whether the frames lie beside each other, as those of a drive in a frame that stands
        still; not so are the sweeps of a sensor in its own frame

    """

    order: NDArray[np.int64]
    first: NDArray[np.int64]
    explained: NDArray[np.int64]
    marked: NDArray[np.int64]
    clouds: tuple[NDArray[np.int64], ...]
    start: NDArray[np.int64]
    together: bool

    def __len__(self) -> int:
        """Count the frames."""
        return len(self.explained)


def cut(gathered: Gathered) -> Frames:
    """Cut the kept points into frames."""
    kept = gathered.kept
    if gathered.has_frames:
        number, clouds = _of_clouds(kept, np.array(sorted(gathered.tally.clouds), np.int64))
    else:
        number, clouds = _of_file(kept), ()
    rank = np.where(kept.reason >= 0, 0, np.where((kept.bits != 0) | kept.rejected, 1, 2))
    order = np.lexsort((kept.order, rank, number))
    count = int(number.max()) + 1 if len(number) else 0
    first = np.searchsorted(number[order], np.arange(count + 1))
    explained = np.bincount(number[rank == 0], minlength=count)
    marked = np.bincount(number[rank <= 1], minlength=count)
    start = np.full(count, np.iinfo(np.int64).max)
    np.minimum.at(start, number, kept.t)
    together = not gathered.has_frames or gathered.found.moved or _apart(kept, number)
    return Frames(order, first, explained, marked, clouds, start, together)


def _apart(kept: Kept, number: NDArray[np.int64]) -> bool:
    """Return whether the first and the last frame lie beside each other."""
    if len(number) == 0:
        return True
    ends = [kept.xyz[number == end, :2] for end in (0, number.max())]
    middle = [np.median(xy, axis=0) for xy in ends]
    size = float(np.hypot(*np.ptp(np.percentile(ends[0], [10, 90], axis=0), axis=0)))
    return bool(np.hypot(*(middle[1] - middle[0])) > APART * size)


def _of_clouds(
    kept: Kept, known: NDArray[np.int64]
) -> tuple[NDArray[np.int64], tuple[NDArray[np.int64], ...]]:
    """Give a number to the frames of a recording's points; list the clouds of each frame."""
    if len(kept) == 0:
        return np.empty(0, np.int64), ()
    there, begin = np.unique(kept.cloud, return_index=True)
    first, last = np.minimum.reduceat(kept.t, begin), np.maximum.reduceat(kept.t, begin)
    frame = np.arange(len(there))
    if np.median(last - first) < SHORT:
        frame = np.unique(first // STRETCH, return_inverse=True)[1]
    frame = frame // -(-(int(frame.max()) + 1) // MOST_FRAMES)
    frame = np.unique(frame, return_inverse=True)[1]
    # A cloud of which no point is kept belongs to the frame before it.
    of_known = frame[np.maximum(np.searchsorted(there, known, side='right') - 1, 0)]
    count = int(frame.max()) + 1
    clouds = tuple(known[of_known == number] for number in range(count))
    return frame[np.searchsorted(there, kept.cloud)], clouds


def _of_file(kept: Kept) -> NDArray[np.int64]:
    """Cut a file into parts: in order of time, or tile by tile where there is none."""
    if len(kept) == 0:
        return np.empty(0, np.int64)
    parts = min(-(-len(kept) // PART), MOST_FRAMES)
    if kept.t.min() < kept.t.max():
        key = np.argsort(kept.t, kind='stable')
    else:
        xy = kept.xyz[:, :2] - kept.xyz[:, :2].min(axis=0)
        tile = np.floor(xy / max(float(xy.max()), 1e-9) * np.sqrt(parts))
        key = np.lexsort((tile[:, 0], tile[:, 1]))
    number = np.empty(len(kept), np.int64)
    number[key] = np.arange(len(kept)) * parts // len(kept)
    return number
