# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The times of messages, however many: their rate, gaps and jumps, in little memory."""

from __future__ import annotations

import math
from collections import Counter
from itertools import pairwise
from typing import TYPE_CHECKING

from lidar_outlier_filter.core.points.points import SECOND

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

GAP = 2.0  # usual distances of two messages, from which on some are missing between them
_BINS = 1400  # of the distances, for each factor of 2: twice a distance is so many bins on


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
            self._distances[_bin(distance)] += 1
        self._last = time
        self.count += 1

    @property
    def usual(self) -> float:
        """The median distance of two messages, s, to 0.03 %; nan of less than two."""
        number = self._usual_bin()
        if number is None:
            return math.nan
        return 2 ** (number / _BINS) / SECOND if number >= 0 else 0.0

    @property
    def rate(self) -> float:
        """How many messages come in a second, usually; nan where they come at once."""
        usual = self.usual
        return 1 / usual if usual > 0 else math.nan

    @property
    def gaps(self) -> int:
        """Count the distances that are longer than ``GAP`` usual ones."""
        longest = self._longest_bin()
        return sum(count for number, count in self._distances.items() if number > longest)

    def gaps_in(self, times: Sequence[int]) -> list[tuple[int, int]]:
        """Return the gaps of times that were counted: that of the last before, and how long, ns."""
        longest = self._longest_bin()
        apart = ((before, after - before) for before, after in pairwise(times))
        return [(before, distance) for before, distance in apart if _bin(distance) > longest]

    def _usual_bin(self) -> int | None:
        """Return the bin of the median distance; None of less than two messages."""
        left = (self._distances.total() + 1) // 2
        for number, count in sorted(self._distances.items()):
            left -= count
            if left <= 0:
                return number
        return None

    def _longest_bin(self) -> float:
        """Return the last bin of no gap; there is none where messages come at once."""
        usual = self._usual_bin()
        return math.inf if usual is None or usual < 0 else usual + _BINS * math.log2(GAP)


def _bin(distance: int) -> int:
    return round(_BINS * math.log2(distance)) if distance > 0 else -1


def count_times(times: Iterable[int]) -> MessageTimes:
    """Count the times of a topic's messages, ns, in their order."""
    found = MessageTimes()
    for time in times:
        found.add(time)
    return found
