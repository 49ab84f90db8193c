# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The last seconds of the clouds of one topic, thinned, for a page that asks for what is new."""

from __future__ import annotations

import json
import threading
from collections import deque
from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.report.frames import SHORT, STRETCH
from lidar_outlier_filter.report.pack import (
    LINES,
    Fields,
    box,
    brightness,
    numbers,
    reason_numbers,
    scores,
    span,
)
from lidar_outlier_filter.report.reasons import NEAR
from lidar_outlier_filter.report.sources import intensity_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Words
    from lidar_outlier_filter.core.engine.stream_cloud import StreamCloud

KEPT_SECONDS = 5.0  # of sensor time
MOST_IN_FRAME = 20_000  # points that are drawn of a frame
MOST_FRAMES = 100  # also of clouds whose times stand still
MOST_PENDING = 1000  # clouds of a frame
MOST_POINTS = 2_000_000  # of a frame, before it is thinned: times may stand still
WHOLE = STRETCH * 9 // 10  # nanoseconds: what covers as much is a frame
REJECTED_BIT, NEAR_BIT = 1, 2  # of a point's last word
ALIGNMENT = 16  # bytes: the points begin at a multiple


@dataclass(frozen=True)
class LivePoints:
    """N points: position in metres, score, detectors, whether rejected, why, intensity, line."""

    xyz: NDArray[np.float64]
    score: NDArray[np.float32]
    detectors: NDArray[np.uint16]
    rejected: NDArray[np.bool_]
    reason: NDArray[np.uint8]
    intensity: NDArray[np.float32]
    line: NDArray[np.int64]

    def take(self, index: NDArray[np.intp]) -> LivePoints:
        """Choose points by index."""
        return LivePoints(*(getattr(self, one.name)[index] for one in fields(LivePoints)))


@dataclass(frozen=True)
class LiveFrame:
    """Clouds that are drawn together.

    Attributes
    ----------
    number : from 0, of all frames so far
    first, last : time of its points, nanoseconds
    total : its valid points
    points : those that are kept: rejected ones first, then those near the threshold, then others
    marked : how many of these are rejected or near the threshold
    rejected : of all its points
    span : intensities between which colours change

    """

    number: int
    first: int
    last: int
    total: int
    rejected: int
    points: LivePoints
    marked: int
    span: tuple[float, float]

    @cached_property
    def packed(self) -> tuple[Words, NDArray[np.float64], NDArray[np.float64]]:
        """Words of the points, and the origin and the step of their box."""
        points = self.points
        origin, step = box(points.xyz)
        near = points.score > NEAR
        bits = np.where(points.rejected, REJECTED_BIT, 0) | np.where(near, NEAR_BIT, 0)
        ranks = np.unique(points.line, return_inverse=True)[1] % LINES
        packed = Fields(
            position=np.rint((points.xyz - origin) / step).astype(np.uint64),
            score=scores(points.score),
            brightness=brightness(points.intensity, self.span),
            reason=reason_numbers()[points.reason],
            detector=numbers(points.detectors),
            truth=np.zeros(len(bits), np.uint32),
            bits=bits.astype(np.uint32),
            rank=ranks.astype(np.uint32),
        )
        return packed.words(), origin, step

    def header(self) -> dict[str, Any]:
        """Say what the page needs to draw it."""
        _, origin, step = self.packed
        return {
            'number': self.number,
            'start': self.first / SECOND,
            'end': self.last / SECOND,
            'count': len(self.points.score),
            'points': self.total,
            'rejected': self.rejected,
            'marked': self.marked,
            'explained': 0,
            'origin': origin.tolist(),
            'step': step.tolist(),
        }


class LiveClouds:
    """A ring of frames. One thread adds clouds, others ask for what is new."""

    def __init__(self) -> None:
        """Begin with none."""
        self._lock = threading.Lock()
        self._frames: deque[LiveFrame] = deque(maxlen=MOST_FRAMES)
        self._count = 0
        self._pending: list[LivePoints] = []
        self._points = 0  # of the pending ones
        self._first = self._last = 0  # time of these
        self._span: tuple[float, float] | None = None
        self._rng = np.random.default_rng(0)

    def add(self, cloud: StreamCloud, view: NDArray[np.void] | None) -> None:
        """Take the points of a judged cloud that are shown; ``view`` has their intensities."""
        points, where = cloud.shown
        if len(points) == 0:
            return
        if self._pending and not 0 <= cloud.first - self._first < WHOLE:
            self._close()
        verdict = cloud.verdict.take(where)
        intensity = None if view is None else intensity_of(view, where)
        if intensity is None:
            intensity = np.full(len(verdict), np.nan, np.float32)
        if not self._pending:
            self._first = self._last = cloud.first
        self._last = max(self._last, cloud.last)
        self._pending.append(
            LivePoints(
                points.xyz,
                verdict.score,
                verdict.detectors,
                verdict.rejected,
                verdict.reason,
                intensity,
                points.line,
            )
        )
        is_sweep = cloud.last - cloud.first >= SHORT
        covers = self._last - self._first >= WHOLE
        self._points += len(verdict)
        is_full = len(self._pending) == MOST_PENDING or self._points >= MOST_POINTS
        if is_sweep or covers or is_full:
            self._close()

    def since(self, number: int) -> bytes:
        """Give the frames after the one with a number: length of the header, header, points."""
        with self._lock:
            there = list(self._frames)
        new = [frame for frame in there if frame.number > number]
        header = json.dumps(
            {
                'oldest': there[0].number if there else 0,
                'intensity': (self._span or (0.0, 0.0)),
                'frames': [frame.header() for frame in new],
            },
            allow_nan=False,
        ).encode()
        header += b' ' * (-(len(header) + 4) % ALIGNMENT)
        points = [frame.packed[0].astype('<u4').tobytes() for frame in new]
        return b''.join([len(header).to_bytes(4, 'little'), header, *points])

    def _close(self) -> None:
        """Make a frame of what is pending, and forget what is too old."""
        columns = [
            np.concatenate([getattr(part, one.name) for part in self._pending])
            for one in fields(LivePoints)
        ]
        points = LivePoints(*columns)
        self._pending, self._points = [], 0
        if self._span is None and np.isfinite(points.intensity).any():
            self._span = span(points.intensity)
        total, rejected = len(points.score), int(np.count_nonzero(points.rejected))
        near = points.score > NEAR
        rank = np.where(points.rejected, 0, np.where(near, 1, 2)).astype(np.uint64)
        key = (rank << np.uint64(32)) | self._rng.integers(0, 2**32, total, np.uint64)
        if total > MOST_IN_FRAME:
            chosen = np.argpartition(key, MOST_IN_FRAME)[:MOST_IN_FRAME]
            points, key = points.take(chosen), key[chosen]
        points = points.take(np.argsort(key))
        marked = int(np.count_nonzero(key >> np.uint64(32) < np.uint64(2)))
        frame = LiveFrame(
            self._count,
            self._first,
            self._last,
            total,
            rejected,
            points,
            marked,
            self._span or (0.0, 0.0),
        )
        self._count += 1
        with self._lock:
            if self._frames and frame.first < self._frames[-1].first:  # the clock was set back
                self._frames.clear()
            self._frames.append(frame)
            while frame.first - self._frames[0].first > KEPT_SECONDS * SECOND:
                self._frames.popleft()
