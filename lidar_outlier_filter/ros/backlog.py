# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The queue of clouds to be filtered, and its policy under overload. Knows no ROS."""

import threading
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Any

from lidar_outlier_filter.parameters.node import LoadParameters

Command = Callable[[], object]

BUSY = 0.5  # pressure from which on there is too much; until nothing waits any more
FULL = 0.75  # pressure at which even detectors along scan lines are too slow
MIN_LEAD, MAX_LEAD = 0.1, 0.5  # share of max_delay that is kept for the verdict
FORGET = 0.95  # of the longest time that a cloud took, from one cloud to the next


@dataclass
class Received:
    """A serialised cloud, when it was received (ns of the clock of max_delay), and its message."""

    data: bytes
    at: int
    msg: Any = None  # once it is read


class Inbox:
    """Between the thread that receives and the one that filters: bounded, in order.

    Commands are done between two clouds: at once, or in their turn among the clouds. Of changes
    only the newest is done, and where clouds wait, one of them between two changes.

    Attributes
    ----------
    clouds, size : the clouds that wait, and their bytes
    closed : whether nothing is expected any more

    """

    def __init__(self, load: LoadParameters) -> None:
        self.load = load
        self._changed = threading.Condition()
        self._items: deque[Received | Command] = deque()
        self._commands: deque[Command] = deque()
        self._change: Command | None = None
        self._is_clouds_turn = False  # a change was done while it waited
        self.clouds = self.size = 0
        self._woken = self.closed = False

    @property
    def fill(self) -> float:
        """Return how full it is: 1 is as full as it gets."""
        return max(self.clouds / self.load.clouds, self.size / (self.load.megabytes * 1e6))

    def put(self, item: Received) -> int:
        """Add a cloud; return how many were dropped for it, the oldest first.

        A single cloud always fits. After closing, the cloud itself is dropped.
        """
        dropped = 0
        with self._changed:
            if self.closed:
                return 1
            self._add(item)
            while self.clouds > 1 and self.fill > 1:
                # Commands stay.
                oldest = next(item for item in self._items if isinstance(item, Received))
                self._items.remove(oldest)
                self._count(oldest, -1)
                dropped += 1
            self._changed.notify()
        return dropped

    def order(self, command: Command, *, in_turn: bool = False) -> None:
        """Let the other thread run a command now, or after the pending clouds."""
        with self._changed:
            (self._items if in_turn else self._commands).append(command)
            self._changed.notify()

    def change(self, command: Command) -> None:
        """Let the other thread run a command before the next cloud, in place of one that waits.

        A command for each step of a slider would hold up the clouds behind it.
        """
        with self._changed:
            self._change = command
            self._changed.notify()

    def wake(self) -> None:
        """Let ``take`` return."""
        with self._changed:
            self._woken = True
            self._changed.notify()

    def close(self, last: Iterable[Received] = (), *, discard: bool = False) -> None:
        """Close: ``take`` returns the pending and the ``last`` clouds, without limit, then None.

        One lock covers all, so ``take`` cannot run between adding and closing.
        """
        with self._changed:
            for item in last:
                self._add(item)
            self.closed = True
            if discard:
                self._items.clear()
                self._commands.clear()
                self._change = None
                self.clouds = self.size = 0
            self._changed.notify()

    def reopen(self) -> None:
        """Take clouds again, once it is done."""
        with self._changed:
            self.closed = False

    @property
    def oldest(self) -> int | None:
        """When the cloud was received that waits longest; None where none waits."""
        with self._changed:
            return next((one.at for one in self._items if isinstance(one, Received)), None)

    @property
    def done(self) -> bool:
        """Whether it is closed and empty, read at one time."""
        with self._changed:
            return self.closed and not (self._items or self._commands or self._change)

    def take(self, seconds: float | None) -> Received | Command | None:
        """Wait, for ``seconds`` at most, and return what comes next; None for nothing."""
        with self._changed:
            self._changed.wait_for(self._is_due, seconds)
            if self._commands:
                return self._commands.popleft()
            if self._change is not None and not (self._is_clouds_turn and self._items):
                command, self._change = self._change, None
                self._is_clouds_turn = bool(self._items)
                return command
            if not self._items:
                # Only now: a woken thread polls when it is given nothing to do.
                self._woken = False
                return None
            item = self._items.popleft()
            self._is_clouds_turn = False
            if isinstance(item, Received):
                self._count(item, -1)
            return item

    def received_now(self, now: int) -> None:
        """Set the reception time of all pending clouds to now, after a change of the clock."""
        with self._changed:
            for item in self._items:
                if isinstance(item, Received):
                    item.at = now

    def _is_due(self) -> bool:
        waits = self._items or self._commands or self._change
        return bool(waits or self._woken or self.closed)

    def _add(self, item: Received) -> None:
        self._items.append(item)
        self._count(item, 1)

    def _count(self, item: Received, sign: int) -> None:
        self.clouds += sign
        self.size += sign * len(item.data)


class Treatment(Enum):
    """What is done with a cloud."""

    FILTER = 'filtered'
    DEGRADE = 'filtered along scan lines only'
    PASS = 'passed unfiltered'  # noqa: S105  no password
    DROP = 'dropped'


class Overload:
    """Chooses the treatment of the next cloud by the load policy and the backlog."""

    def __init__(self) -> None:
        self.treatment = Treatment.FILTER  # of the last cloud
        self._busy = False
        self._longest = 0.0  # seconds: the longest recent cloud, fading

    def lead(self, max_delay: float) -> float:
        """Return the seconds of ``max_delay`` that are reserved for judging."""
        return min(max(self._longest, MIN_LEAD * max_delay), MAX_LEAD * max_delay)

    def took(self, seconds: float) -> None:
        """Note how long a cloud took."""
        self._longest = max(seconds, FORGET * self._longest)

    def decide(self, policy: str, fill: float, age: float, max_delay: float) -> Treatment:
        """Choose the treatment of a cloud.

        The node is overloaded once the queue, or the waiting time, is half of its limit; it stays
        so until the queue is empty.

        Parameters
        ----------
        policy : ``load.policy``
        fill : of the queue behind the cloud, as a share of its limit
        age : seconds since reception
        max_delay : seconds

        """
        waited = age / (max_delay - self.lead(max_delay))
        pressure = max(fill, waited)
        self._busy = pressure >= BUSY or (self._busy and fill > 0)
        self.treatment = Treatment.FILTER
        if policy == 'drop_oldest':
            # The newest is late, too, but nothing is gained by dropping it.
            if waited >= 1 and fill > 0:
                self.treatment = Treatment.DROP
        elif self._busy:
            passes = policy == 'pass_through' or pressure >= FULL
            self.treatment = Treatment.PASS if passes else Treatment.DEGRADE
        return self.treatment
