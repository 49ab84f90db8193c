# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The times of the messages of a topic: their rate, gaps and jumps."""

import math
from array import array
from collections.abc import Iterable

import numpy as np

from lidar_outlier_filter.core.annotations import Ints
from lidar_outlier_filter.core.points.points import SECOND

MAX_TIME_NS = 2**63 - 1  # ns
GAP_MEDIANS = 2.0  # median distances: messages are missing in a longer one


class MessageTimes:
    """The times of the messages of a topic, ns, in the order in which they were recorded."""

    def __init__(self, times: Iterable[int] = ()) -> None:
        """Start with some times; more may be added."""
        self._times = array('q', times)

    def add(self, time: int) -> None:
        """Count a message."""
        self._times.append(min(time, MAX_TIME_NS))

    @property
    def count(self) -> int:
        """Count the messages."""
        return len(self._times)

    @property
    def jumps(self) -> int:
        """Count the times that are earlier than the one before."""
        return int(np.count_nonzero(self._distances() < 0))

    @property
    def longest(self) -> int:
        """The longest distance of two messages, ns."""
        return int(self._distances().max(initial=0))

    @property
    def usual(self) -> float:
        """The median distance of two messages, s; nan of less than two."""
        distances = self._distances()
        middle = (len(distances) - 1) // 2
        if middle < 0:
            return math.nan
        return max(0, int(np.partition(distances, middle)[middle])) / SECOND

    @property
    def rate(self) -> float:
        """The usual number of messages per second; nan if they come at once."""
        usual = self.usual
        return 1 / usual if usual > 0 else math.nan

    @property
    def gaps(self) -> int:
        """Count the gaps."""
        return len(self.gaps_found())

    def gaps_found(self) -> list[tuple[int, int]]:
        """List the time before each gap, and its length, ns."""
        usual, distances = self.usual, self._distances()
        if not usual > 0:
            return []
        found = np.flatnonzero(distances > GAP_MEDIANS * usual * SECOND)
        return [(self._times[i], int(distances[i])) for i in found]

    def _distances(self) -> Ints:
        times: Ints = np.array(self._times, np.int64)
        return times[1:] - times[:-1]
