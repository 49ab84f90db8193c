# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Scan lines of a stream: decided once, on a fixed stretch of sensor time, and kept.

Clouds wait until the stretch is complete. So what is decided does not depend on how the stream is
cut. Rings of a spinning sensor show in the first cloud: there nothing waits.
"""

from collections.abc import Callable
from typing import Generic

from lidar_outlier_filter.core.engine.stream_cloud import BEGINNING, END, AnyCloud
from lidar_outlier_filter.core.points.line_recovery import (
    GIVEN,
    Claim,
    Decision,
    LineNumbers,
    decide,
    decide_at_once,
)
from lidar_outlier_filter.core.points.mirror import STRETCH_NS
from lidar_outlier_filter.core.points.points import SECOND, concatenate
from lidar_outlier_filter.parameters.filter import FilterParameters

MAX_HELD_POINTS = 4_000_000  # where times do not advance, so many points decide
MAX_PAUSE_NS = 2 * SECOND  # after a longer pause the mirror may be anywhere: decided anew


def line_period(parameters: FilterParameters) -> float:
    """Return how long a turn of the mirror takes, ns, where ``line_rate`` says so; else 0."""
    return SECOND / parameters.line_rate if parameters.line_rate > 0 else 0.0


class StreamLines(Generic[AnyCloud]):
    """Gives the points of clouds their scan lines, in the order of the clouds.

    Attributes
    ----------
    held : list of clouds
        Oldest first; they wait for the decision.
    points : int
        Their points, missing returns included.
    decision : Decision or None
        None before it is made.

    """

    def __init__(self, parameters: FilterParameters, say: Callable[[Decision], object]) -> None:
        """Read line_rate, time_jump and max_points; ``say`` is called with each decision."""
        self._period = line_period(parameters)
        self._jump = round(parameters.time_jump * SECOND)
        self._most = min(MAX_HELD_POINTS, parameters.max_points)
        self._say = say
        self.held: list[AnyCloud] = []
        self.points = 0
        self.reset()

    def reset(self) -> None:
        """Decide anew: the clock was set back, or the stream ended. Nothing waits."""
        self.decision: Decision | None = None
        self._claim: Claim | None = None
        self._numbers = LineNumbers(GIVEN)
        self._first, self._newest = END, BEGINNING
        self._looked_at = 0  # points of those held when they were last looked at

    def push(self, cloud: AnyCloud, claim: Claim | None) -> list[AnyCloud]:
        """Add the next cloud; return those whose lines are known.

        ``claim`` is None where its lines are used as they are, or are not needed.
        """
        released: list[AnyCloud] = []
        if len(cloud.points):
            if claim != self._claim or self._is_interrupted(cloud):
                released = self.release()
                self.reset()
                self._claim = claim
            if claim is None:
                self.decision = GIVEN
            self._newest = max(self._newest, cloud.last)
        elif not self.held:
            return [cloud]
        if self.decision is not None:
            return [*released, self._numbered(cloud)]
        if self.points + cloud.count > self._most:
            return [*released, *self.release(), self._numbered(cloud)]
        self.held.append(cloud)
        self.points += cloud.count
        self._first = min(self._first, cloud.first)
        if self._is_known():
            released += self._release()
        return released

    def _is_interrupted(self, cloud: AnyCloud) -> bool:
        """Return whether a cloud does not continue what came before: set back, or much later."""
        if self._newest == BEGINNING:
            return False
        return cloud.last < self._newest - self._jump or cloud.first > self._newest + MAX_PAUSE_NS

    def release(self) -> list[AnyCloud]:
        """Return all that wait, decided by what has arrived."""
        if self.held and self.decision is None and self._claim is not None:
            self._decide()
        return self._release()

    def _is_known(self) -> bool:
        """Return whether the lines are known now, having decided if there is enough."""
        if self._newest >= self._first + STRETCH_NS:
            self._decide()
        elif self.points >= 2 * self._looked_at and self._claim is not None:
            self._looked_at = self.points
            some = concatenate([cloud.points for cloud in self.held if len(cloud.points)])
            numbered = self._claim.source != 'message'
            self.decision = decide_at_once(some, numbered=numbered)
            if self.decision is not None and self.decision.text:
                self._say(self.decision)
        return self.decision is not None

    def _decide(self) -> None:
        end = self._first + STRETCH_NS
        some = [cloud.points.take(cloud.between(self._first, end)) for cloud in self.held]
        some = [points for points in some if len(points)]
        if some and self._claim is not None:
            decision = decide(concatenate(some), self._claim, self._period)
            self.decision, self._numbers = decision, LineNumbers(decision, self._say)
            self._say(decision)

    def _release(self) -> list[AnyCloud]:
        released = [self._numbered(cloud) for cloud in self.held]
        self.held, self.points = [], 0
        return released

    def _numbered(self, cloud: AnyCloud) -> AnyCloud:
        cloud.points = self._numbers.number(cloud.points)
        return cloud
