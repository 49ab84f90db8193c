# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Scan lines as they are: a claimed number is believed only if it behaves like one.

A field, a row or a message claims to be a scan line. Rings of a spinning sensor are measured at
once; the turns of a profile scanner's mirror, one after the other. Numbers that start again in each
message become running numbers. Numbers of packets, heads or echoes, and messages, are replaced by
the turns of the mirror, where time and geometry show them.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats, Ints
from lidar_outlier_filter.core.points.mirror import (
    MIN_TURN_RETURNS,
    Mirror,
    find_mirror,
    is_path,
)
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.points.turns import TurnCounter

STRETCH_NS = 200_000_000  # of sensor time that decides
ENOUGH_POINTS = 2048  # that show whether one beam or several measured them
MAX_RING_RUN = 16.0  # points of one ring in succession: of more, lines are measured one by one
MIN_AT_ONCE = 2.0  # lines that are measured at once, on average, from which on a sensor spins
MAX_TURNS_OFF = 0.2  # relative: lines per turn may differ by so much from a whole number
MAX_FACETS = 12  # lines per turn of a mirror with facets
JUMP = 5.0  # times the usual step: at the end of a facet the beam jumps
REVERSAL_SHOTS = 8  # from the end of a swing, where the beam is near again as long before it
MAX_REVERSAL = 0.5  # distance of two such shots ÷ the way from the end to one of them
MAX_PHASE_SPREAD = 0.05  # of a turn: lines by the scan angle begin at one angle of the mirror


class Claim(NamedTuple):
    """What claims to be a scan line: its ``source`` and, in words, its ``name``."""

    source: str
    name: str


class Decision(NamedTuple):
    """How points get their scan lines.

    Attributes
    ----------
    kind : 'given': as claimed; 'runs': a new line at each change of number; 'turns': of the mirror
    mirror : where time and geometry show how it turns
    text : what to say of it, once; empty: nothing
    contradicts : whether a claim is not believed, which is worth a warning

    """

    kind: str
    mirror: Mirror | None = None
    text: str = ''
    contradicts: bool = False


GIVEN = Decision('given')


def decide_at_once(points: Points, *, numbered: bool) -> Decision | None:
    """Decide by the first points of a stream, valid ones; None: more are needed.

    Rings of a spinning sensor, ``numbered`` by a field or by rows, show at once; and so do points
    without numbers that one beam cannot have measured one after the other.
    """
    count = len(points)
    if numbered and is_spinning(points):
        return GIVEN
    if count < ENOUGH_POINTS:
        return None
    some = points.take(slice(0, ENOUGH_POINTS))
    if np.ptp(some.t) == 0 or not is_path(some.xyz[np.argsort(some.t, kind='stable')]):
        return GIVEN
    return None


def is_spinning(points: Points) -> bool:
    """Return whether lines are rings that are measured at once, by points in any order."""
    order = np.argsort(points.t, kind='stable')
    line, t = points.line[order], points.t[order]
    span = int(t[-1] - t[0]) if len(t) else 0
    if span == 0 or len(line) / (1 + np.count_nonzero(np.diff(line))) > MAX_RING_RUN:
        return False
    inner = np.argsort(line, kind='stable')
    begins = np.flatnonzero(np.append(True, np.diff(line[inner]) != 0))
    ends = np.append(begins[1:], len(line)) - 1
    return bool((t[inner[ends]] - t[inner[begins]]).sum() > MIN_AT_ONCE * span)


def decide(points: Points, claim: Claim, period: float = 0.0) -> Decision:
    """Decide by all points of a stretch.

    Parameters
    ----------
    points : valid ones, in the order of arrival, in the map's frame or in the sensor's
    claim : what ``points.line`` are
    period : of the mirror, nanoseconds, where it is known; 0: it is sought

    """
    order = np.argsort(points.t, kind='stable')
    t, xyz, line = points.t[order], points.xyz[order], points.line[order]
    numbered = claim.source != 'message'
    if numbered and is_spinning(points):
        return GIVEN
    mirror = find_mirror(t, xyz, period)
    changes = np.flatnonzero(np.diff(line)) + 1
    counts = numbered and len(changes) > 0
    if mirror is None:
        if counts and len(line) >= MIN_TURN_RETURNS * len(changes) and _restarts(line, changes):
            return Decision('runs', text=f'{claim.name} starts again: each change is a scan line')
        text = '' if counts else _no_turns(claim)
        return GIVEN._replace(text=text, contradicts=bool(text))
    rate = f'{mirror.rate:.2f} turns/s, from time and geometry'
    if counts and _are_turns(t, xyz, changes, mirror, claim):
        text = f'scan lines: {claim.name}; {rate}'
        if _restarts(line, changes):
            text = f'{claim.name} starts again: each change is a scan line; {rate}'
        return Decision('runs', mirror, text)
    text = f'scan lines: {rate}'
    if numbered:
        text = f'{claim.name} does not number the turns of the mirror, and is not used; {text}'
    return Decision('turns', mirror, text, contradicts=numbered)


def _no_turns(claim: Claim) -> str:
    """Say that lines depend on the cut."""
    if claim.source == 'message':
        return (
            'no line field, and time and geometry show no turns of a mirror: each message is a '
            'scan line (line_source), so verdicts depend on the cut into messages'
        )
    return f'{claim.name} is constant, and time and geometry show no turns of a mirror'


def _restarts(line: Ints, changes: Ints) -> bool:
    """Return whether a number comes again after others."""
    return len(np.unique(line)) < len(changes) + 1


def _are_turns(t: Ints, xyz: Floats, changes: Ints, mirror: Mirror, claim: Claim) -> bool:
    """Return whether numbers change once in a turn, or at the ends of facets or swings."""
    lines = len(changes) / (float(t[changes[-1]] - t[0]) / mirror.period)
    each = max(round(lines), 1)
    if each > MAX_FACETS or abs(lines - each) > MAX_TURNS_OFF * each:
        return False
    if claim.source == 'angle':
        turned = np.exp(2j * np.pi * (t[changes] - mirror.begin) / mirror.period)
        return bool(each == 1 and 1.0 - abs(turned.mean()) < MAX_PHASE_SPREAD)
    return each == 1 or _jumps(t, xyz, changes) or _reverses(xyz, changes)


def _jumps(t: Ints, xyz: Floats, changes: Ints) -> bool:
    """Return whether the beam jumps, or pauses, where the number changes."""
    step = np.sqrt((np.diff(xyz, axis=0) ** 2).sum(axis=1))
    pause = np.diff(t)
    return bool(
        np.median(step[changes - 1]) > JUMP * np.median(step)
        or np.median(pause[changes - 1]) > JUMP * max(float(np.median(pause)), 1.0)
    )


def _reverses(xyz: Floats, changes: Ints) -> bool:
    """Return whether the beam comes back where the number changes."""
    inner = changes[(changes > REVERSAL_SHOTS) & (changes < len(xyz) - REVERSAL_SHOTS)]
    if not len(inner):
        return False
    ahead = xyz[inner + REVERSAL_SHOTS - 1]
    back, way = (
        np.median(np.sqrt(((ahead - xyz[other]) ** 2).sum(axis=1)))
        for other in (inner - REVERSAL_SHOTS, inner)
    )
    return bool(back < MAX_REVERSAL * way)


class LineNumbers:
    """Numbers scan lines as decided; the same points cut in any way get the same lines."""

    def __init__(self, decision: Decision) -> None:
        """Begin with the first line."""
        self.decision = decision
        self._turns = None if decision.kind != 'turns' else TurnCounter(_known(decision.mirror))
        self._run, self._last = 0, None

    def number(self, points: Points) -> Points:
        """Return points with their lines; they follow those of the call before."""
        if self.decision.kind == 'given' or not len(points):
            return points
        if self._turns is not None:
            return replace(points, line=self._turns.number(points.t))
        order = slice(None)
        if not (points.t[1:] >= points.t[:-1]).all():
            order = np.argsort(points.t, kind='stable')
        given = points.line[order]
        changed: Bools = np.append(
            self._last is not None and given[0] != self._last, np.diff(given) != 0
        )
        line = np.empty(len(given), np.int64)
        line[order] = self._run + np.cumsum(changed)
        self._run, self._last = int(self._run + changed.sum()), int(given[-1])
        return replace(points, line=line)


def _known(mirror: Mirror | None) -> Mirror:
    assert mirror is not None
    return mirror


def settle_lines(points: Points, claim: Claim, period: float = 0.0) -> tuple[Points, Decision]:
    """Give a whole cloud its scan lines: N points in any order, missing returns among them.

    The first stretch of its time decides, as in a stream.
    """
    where = np.flatnonzero(points.valid)
    some = points.take(where)
    if not len(some) or np.ptp(some.t) == 0:
        return points, GIVEN
    end = int(some.t.min()) + STRETCH_NS
    first = some.take(some.t < end)
    decision = decide(first, claim, period)
    line = points.line.copy()
    line[where] = LineNumbers(decision).number(some).line
    return replace(points, line=line), decision
