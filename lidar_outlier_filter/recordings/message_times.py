# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The times of messages, however many: their rate, gaps and jumps, in little memory."""

from __future__ import annotations

import math
from collections import Counter

from lidar_outlier_filter.core.points.points import SECOND

GAP = 2.0  # usual distances of two messages, from which on some are missing between them
_BINS = 2000  # of the distances, for each factor of e


class MessageTimes:
    """The times of the messages of a topic, ns, as they come.

    Attributes
    ----------
    count : messages so far
    jumps : times that lie before the one before
    longest : the longest distance of two messages, ns

    """

    def __init__(self) -> None:
        """Begin without a message."""
        self.count = self.jumps = self.longest = 0
        self._last = 0
        self._distances: Counter[int] = Counter()  # by the number of the bin; -1: none at all

    def add(self, time: int) -> None:
        """Count a message."""
        if self.count:
            distance = time - self._last
            self.jumps += distance < 0
            self.longest = max(self.longest, distance)
            self._distances[round(_BINS * math.log(distance)) if distance > 0 else -1] += 1
        self._last = time
        self.count += 1

    @property
    def usual(self) -> float:
        """The median distance of two messages, s, to 0.03 %; nan of less than two."""
        left = (self._distances.total() + 1) // 2
        for number, count in sorted(self._distances.items()):
            left -= count
            if left <= 0:
                return _distance(number)
        return math.nan

    @property
    def rate(self) -> float:
        """How many messages come in a second, usually; nan where they come at once."""
        usual = self.usual
        return 1 / usual if usual > 0 else math.nan

    @property
    def gaps(self) -> int:
        """Count the distances that are longer than ``GAP`` usual ones."""
        least = GAP * self.usual
        return sum(n for number, n in self._distances.items() if _distance(number) > least > 0)


def _distance(number: int) -> float:
    return math.exp(number / _BINS) / SECOND if number >= 0 else 0.0
