# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The last seconds of the clouds of one topic, thinned, for a page that asks for new ones."""

import threading
from collections import deque
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from lidar_outlier_filter.core.annotations import Floats, Rows, Words
from lidar_outlier_filter.core.engine.stream_cloud import StreamCloud
from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.report.chains import NEAR_SCORE
from lidar_outlier_filter.report.gather import FRAME_NS, SHORT
from lidar_outlier_filter.report.points import LIVE, fill, intensity_limits, message, pack, thin
from lidar_outlier_filter.report.sources import saved_columns

KEPT_SECONDS = 5.0  # of sensor time
MAX_IN_FRAME = 20_000  # points of a frame that are drawn
MAX_LIVE_FRAMES = 100  # also where times stand still
MAX_PENDING_CLOUDS, MAX_PENDING_POINTS = 1000, 2_000_000  # of a frame, before it is thinned
WHOLE = FRAME_NS * 9 // 10  # nanoseconds that a frame covers
REJECTED_BIT, NEAR_BIT = 1, 2  # in the last word of a point


@dataclass(frozen=True)
class LiveFrame:
    """Clouds that are drawn together.

    Attributes
    ----------
    number : from 0, of all frames so far
    first, last : times, nanoseconds
    total, rejected : of its valid points
    points : those that are drawn, marked ones first
    limits : intensities between which colours change

    """

    number: int
    first: int
    last: int
    total: int
    rejected: int
    points: Rows
    limits: tuple[float, float]

    @cached_property
    def packed(self) -> tuple[Words, Floats, Floats]:
        """Words of the points, origin and step of their box."""
        return pack(self.points, np.array([0, len(self.points)]), self.limits)

    def header(self) -> dict[str, Any]:
        """Return what the page needs to draw it."""
        _, (origin,), (step,) = self.packed
        return {
            'number': self.number,
            'start': self.first / SECOND,
            'end': self.last / SECOND,
            'count': len(self.points),
            'points': self.total,
            'rejected': self.rejected,
            'marked': int(np.count_nonzero(self.points['bits'])),
            'origin': origin.tolist(),
            'step': step.tolist(),
        }


class LiveClouds:
    """A ring of frames. One thread adds clouds, others ask for new frames."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._frames: deque[LiveFrame] = deque(maxlen=MAX_LIVE_FRAMES)
        self._count = 0
        self._pending: list[Rows] = []
        self._points = 0  # pending ones
        self._first = self._last = 0  # times of the pending clouds
        self._limits: tuple[float, float] | None = None
        self._rng = np.random.default_rng(0)

    def add(self, cloud: StreamCloud, view: Rows | None) -> None:
        """Take the points of a judged cloud that are shown; ``view`` has their intensities."""
        points, where = cloud.shown
        if len(points) == 0:
            return
        if self._pending and not 0 <= cloud.first - self._first < WHOLE:
            self._close()
        verdict = cloud.verdict.take(where)
        rows = np.zeros(len(verdict), LIVE)
        name = '' if view is None else saved_columns(view.dtype.names or ()).get('intensity', '')
        fill(rows, points, verdict, view[name][where] if view is not None and name else None)
        bits = np.where(rows['rejected'], REJECTED_BIT, 0)
        rows['bits'] = bits | np.where(rows['score'] > NEAR_SCORE, NEAR_BIT, 0)
        if not self._pending:
            self._first = self._last = cloud.first
        self._last = max(self._last, cloud.last)
        self._pending.append(rows)
        self._points += len(rows)
        is_sweep = cloud.last - cloud.first >= SHORT
        covers = self._last - self._first >= WHOLE
        full = len(self._pending) == MAX_PENDING_CLOUDS or self._points >= MAX_PENDING_POINTS
        if is_sweep or covers or full:
            self._close()

    def since(self, number: int) -> bytes:
        """Write a message with the frames after the one with a number."""
        with self._lock:
            there = list(self._frames)
        new = [frame for frame in there if frame.number > number]
        header = {
            'oldest': there[0].number if there else 0,
            'intensity': self._limits or (0.0, 0.0),
            'frames': [frame.header() for frame in new],
        }
        columns = {'intensity': [frame.points['intensity'] for frame in new]}
        return message(header, [frame.packed[0] for frame in new], columns)

    def _close(self) -> None:
        """Make a frame of the pending clouds, and forget old frames."""
        points = np.concatenate(self._pending)
        self._pending, self._points = [], 0
        if self._limits is None and np.isfinite(points['intensity']).any():
            self._limits = intensity_limits(points['intensity'])
        total, rejected = len(points), int(np.count_nonzero(points['rejected']))
        points['order'] = self._rng.integers(0, 2**32, total, np.uint32)
        kept = thin(points, MAX_IN_FRAME)
        kept = kept[np.argsort(kept['bits'] == 0, kind='stable')]
        limits = self._limits or (0.0, 0.0)
        frame = LiveFrame(self._count, self._first, self._last, total, rejected, kept, limits)
        self._count += 1
        with self._lock:
            if self._frames and frame.first < self._frames[-1].first:  # the clock was set back
                self._frames.clear()
            self._frames.append(frame)
            while frame.first - self._frames[0].first > KEPT_SECONDS * SECOND:
                self._frames.popleft()
