# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The points of a report: all are counted, and as many are kept as can be drawn."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.report.reasons import ADDED, NEAR

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from lidar_outlier_filter.report.reasons import Reason
    from lidar_outlier_filter.report.sources import ReportCloud

MOST_REASONS = 20_000
REJECTED, NEARLY, OTHER = range(3)  # what is kept first
UNKNOWN = -1  # the truth of points without one, and the row of points without a reason


@dataclass(frozen=True)
class Kept:
    """N points.

    Attributes
    ----------
    cloud, index : (N,) int32
        The number of the cloud, and the index among its valid points.
    xyz : (N, 3) float64, metres
    t : (N,) int64, nanoseconds
    line : (N,) int64
    range : (N,) float32, metres
    intensity : (N,) float32; NaN where there is none
    score : (N,) float32
    detectors : (N,) uint16
    rejected : (N,) bool
    code : (N,) int32, the truth; ``UNKNOWN`` without
    bits : (N,) uint32
        The steps of all sliders that reject the point.
    strongest : (N,) uint8
        Number of the strongest reason of a rejected point, of :func:`.reasons`; 0 without.
    reason : (N,) int32, row of the reasons; ``UNKNOWN`` without
    order : (N,) uint32
        Random: any first part of the points in this order is an even sample.

    """

    cloud: NDArray[np.int32]
    index: NDArray[np.int32]
    xyz: NDArray[np.float64]
    t: NDArray[np.int64]
    line: NDArray[np.int64]
    range: NDArray[np.float32]
    intensity: NDArray[np.float32]
    score: NDArray[np.float32]
    detectors: NDArray[np.uint16]
    rejected: NDArray[np.bool_]
    code: NDArray[np.int32]
    bits: NDArray[np.uint32]
    strongest: NDArray[np.uint8]
    reason: NDArray[np.int32]
    order: NDArray[np.uint32]

    def __len__(self) -> int:
        """Count the points."""
        return len(self.t)

    def take(self, index: NDArray[np.intp]) -> Kept:
        """Choose points by index."""
        return Kept(*(getattr(self, field.name)[index] for field in fields(Kept)))


def concatenate(parts: list[Kept]) -> Kept:
    """Join points in the order given."""
    return Kept(
        *(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Kept))
    )


class Keeper:
    """Keeps at most so many points: the rejected first, then those nearly rejected, then others.

    Attributes
    ----------
    added : how many points came

    """

    def __init__(self, most: int) -> None:
        """Keep at most so many."""
        self.added = 0
        self.reasons: list[Reason] = []
        self._most = most
        self._parts: list[Kept] = []
        self._held = 0
        self._rng = np.random.default_rng(0)

    def add(self, cloud: ReportCloud, reasons: Mapping[int, Reason]) -> None:
        """Take the points of a judged cloud; what steps reject is not known yet."""
        count = len(cloud.points)
        row = np.full(count, UNKNOWN, np.int32)
        for index, reason in reasons.items():
            row[index] = len(self.reasons)
            self.reasons.append(reason)
        nothing = np.full(count, np.nan, np.float32)
        self._parts.append(
            Kept(
                np.full(count, cloud.number, np.int32),
                np.arange(count, dtype=np.int32),
                cloud.points.xyz,
                cloud.points.t,
                cloud.points.line,
                cloud.points.range.astype(np.float32),
                nothing if cloud.intensity is None else cloud.intensity,
                cloud.verdict.score,
                cloud.verdict.detectors,
                cloud.verdict.rejected,
                np.full(count, UNKNOWN, np.int32)
                if cloud.code is None
                else cloud.code.astype(np.int32),
                np.zeros(count, np.uint32),
                cloud.verdict.reason,
                row,
                self._rng.integers(0, 2**32, count, np.uint32),
            )
        )
        self.added += count
        self._held += count
        if self._held > self._most * 5 // 4 or len(self.reasons) > 2 * MOST_REASONS:
            self._thin()

    def finish(self) -> Kept:
        """Give the points that are kept, in the order of their clouds and indices."""
        self._thin()
        (kept,) = self._parts
        return kept.take(np.lexsort((kept.index, kept.cloud)))

    def _thin(self) -> None:
        """Leave no more than are to be kept."""
        whole = concatenate(self._parts) if self._parts else _nothing()
        if len(whole) > self._most:
            nearly = np.where(whole.score > NEAR, NEARLY, OTHER)
            rank = np.where(whole.rejected, REJECTED, nearly).astype(np.uint64)
            key = (rank << np.uint64(32)) | whole.order
            whole = whole.take(np.argpartition(key, self._most)[: self._most])
        self._thin_reasons(whole)
        self._parts, self._held = [whole], len(whole)

    def _thin_reasons(self, whole: Kept) -> None:
        """Leave no more reasons than are to be kept: of rejected points first, then evenly."""
        there = np.flatnonzero(whole.reason >= 0)
        order = there[np.lexsort((whole.order[there], ~whole.rejected[there]))][:MOST_REASONS]
        self.reasons = [self.reasons[row] for row in whole.reason[order].tolist()]
        whole.reason[:] = UNKNOWN
        whole.reason[order] = np.arange(len(order))


def _nothing() -> Kept:
    ints, floats = np.empty(0, np.int32), np.empty(0, np.float32)
    times, words = np.empty(0, np.int64), np.empty(0, np.uint32)
    return Kept(
        ints,
        ints,
        np.empty((0, 3)),
        times,
        times,
        floats,
        floats,
        floats,
        np.empty(0, np.uint16),
        np.empty(0, np.bool_),
        ints,
        words,
        np.empty(0, np.uint8),
        ints,
        words,
    )


def table(reasons: list[Reason]) -> tuple[NDArray[np.uint16], NDArray[np.float32]]:
    """Lay out reasons: (R, ADDED) features, and what they add."""
    features = np.zeros((len(reasons), ADDED), np.uint16)
    added = np.zeros((len(reasons), ADDED), np.float32)
    for row, reason in enumerate(reasons):
        features[row], added[row] = reason.features, reason.added
    return features, added
