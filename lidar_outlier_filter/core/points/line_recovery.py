# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Scan lines as they are: a claimed number is believed only if it behaves like one.

A field, a row or a message claims to be a scan line. Rings of a spinning sensor are measured at
once; the turns of a profile scanner's mirror, one after the other. Numbers that start again in each
message become running numbers. Numbers of packets, heads or echoes, and messages, are replaced by
the turns of the mirror, where time and geometry show them.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats, Ints
from lidar_outlier_filter.core.points.mirror import (
    MIN_TURN_RETURNS,
    STRETCH_NS,
    Mirror,
    count_beams,
    find_mirror,
    is_path,
)
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.points.shared_times import (
    MIN_SHOTS,
    Clock,
    TimeSpreader,
    measure_clock,
)
from lidar_outlier_filter.core.points.turns import FacetCounter, TurnCounter

ENOUGH_POINTS = 2048  # that show whether one beam or several measured them
MAX_RING_RUN = 16.0  # points of one ring in succession: of more, lines are measured one by one
MIN_AT_ONCE = 2.0  # lines that are measured at once, on average, from which on a sensor spins
MAX_TURNS_OFF = 0.2  # relative: lines per turn may differ by so much from a whole number
MAX_FACETS = 12  # lines per turn of a mirror with facets
JUMP = 5.0  # times the usual step: at the end of a facet the beam jumps
REVERSAL_SHOTS = 8  # from the end of a swing, where the beam is near again as long before it
MAX_REVERSAL = 0.5  # distance of two such shots ÷ the way from the end to one of them
MIN_TICKS = 64  # of a turn: with so many, shared times do no harm
MIN_KNOWN_TICKS = 8  # of a turn: with fewer, times do not tell the angles of shots
MAX_HEADS = 3  # scanners whose shots alternate; of more beams a sensor spins


class Claim(NamedTuple):
    """What claims to be a scan line: its ``source`` and, in words, its ``name``."""

    source: str
    name: str


OWN_CLOCK = Clock(0.0, 0, 1)


class Decision(NamedTuple):
    """How points get their scan lines.

    Attributes
    ----------
    kind : 'given': as claimed; 'runs': a new line at each change of number; 'turns': of the mirror;
        'heads': each scanner for itself
    mirror : where time and geometry show how it turns
    text : what to say of it, once; empty: nothing
    contradicts : whether a claim is not believed, which is worth a warning
    heads : number and decision of each of several scanners
    clock : how many shots share a time; these are spread in the order of the points

    """

    kind: str
    mirror: Mirror | None = None
    text: str = ''
    contradicts: bool = False
    heads: tuple[tuple[int, 'Decision'], ...] = ()
    clock: Clock = OWN_CLOCK


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
    if points.head is not None:
        points = points.take(points.head == points.head[0])
    some = points.take(slice(0, ENOUGH_POINTS))
    if np.ptp(some.t) == 0:
        return GIVEN
    beams = count_beams(some.xyz[np.argsort(some.t, kind='stable')])
    if 1 < beams <= MAX_HEADS and not numbered:
        text = f'{beams} scanners take turns, and no field such as head says which: no scan lines'
        return GIVEN._replace(text=text, contradicts=True)
    return None if beams == 1 else GIVEN


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
    if claim.source != 'message' and is_spinning(points):
        return GIVEN
    if points.head is not None and np.ptp(points.head) > 0:
        return _decide_heads(points, points.head, claim, period)
    clock = measure_clock(points.t) if (np.diff(points.t) >= 0).all() else OWN_CLOCK
    if clock.shots >= MIN_SHOTS and is_path(points.xyz):
        return _decide_shared(points, clock, claim, period)
    return _decide_one(points, claim, period)


def _decide_shared(points: Points, clock: Clock, claim: Claim, period: float) -> Decision:
    """Decide for points whose shared times are spread in their order."""
    spread = replace(points, t=TimeSpreader(clock).spread(points.t))
    found = _decide_one(spread, claim, period)
    if found.mirror is not None and found.mirror.period > MIN_TICKS * clock.tick:
        return found  # a turn has many times of its own
    share = f'{100 * clock.share:.0f} % of the points share the time of the one before'
    text = f'{share}: they are spread in their order; {found.text}'.removesuffix('; ')
    if found.mirror is not None and found.mirror.period < MIN_KNOWN_TICKS * clock.tick:
        unknown = f'a time is that of up to {clock.shots} shots, whose angles it does not tell'
        text = f'{text}; {unknown}: the scan pattern is sought by their order'
        return found._replace(clock=clock, text=text, contradicts=True)
    return found._replace(clock=clock, text=text)


def _decide_one(points: Points, claim: Claim, period: float) -> Decision:
    """Decide for the points of one scanner, each with a time of its own."""
    order = np.argsort(points.t, kind='stable')
    t, xyz, line = points.t[order], points.xyz[order], points.line[order]
    numbered = claim.source != 'message'
    mirror = find_mirror(t, xyz, period)
    changes = np.flatnonzero(np.diff(line)) + 1
    counts = numbered and len(changes) > 0
    if mirror is None:
        if counts and len(line) >= MIN_TURN_RETURNS * len(changes) and _restarts(line, changes):
            return Decision('runs', text=f'{claim.name} starts again: each change is a scan line')
        text = '' if counts else _no_turns(claim)
        return GIVEN._replace(text=text, contradicts=bool(text))
    rate = mirror.text
    if counts and _are_turns(t, xyz, changes, mirror):
        text = f'scan lines: {claim.name}; {rate}'
        if _restarts(line, changes):
            text = f'{claim.name} starts again: each change is a scan line; {rate}'
        return Decision('runs', mirror, text)
    text = f'scan lines: {rate}'
    if numbered:
        text = f'{claim.name} does not number the turns of the mirror, and is not used; {text}'
    return Decision('turns', mirror, text, contradicts=numbered)


def _decide_heads(points: Points, heads: Ints, claim: Claim, period: float) -> Decision:
    """Decide for each of several scanners; lines stay as they are where one shows none."""
    found = []
    for head in np.unique(heads).tolist():
        some = points.take(np.flatnonzero(heads == head))
        found.append((head, decide(replace(some, head=None), claim, period)))
    first = next((one for _, one in found if one.kind == 'given'), None)
    if first is not None:
        return first
    text = '; '.join(
        f'scanner {head}: {one.text.removeprefix("scan lines: ")}' for head, one in found
    )
    contradicts = any(one.contradicts for _, one in found)
    return Decision('heads', None, f'scan lines: {text}', contradicts, tuple(found))


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


def _are_turns(t: Ints, xyz: Floats, changes: Ints, mirror: Mirror) -> bool:
    """Return whether numbers change once in a turn, or at the ends of facets or swings."""
    lines = len(changes) / (float(t[changes[-1]] - t[0]) / mirror.period)
    each = max(round(lines), 1)
    if each > MAX_FACETS or abs(lines - each) > MAX_TURNS_OFF * each:
        return False
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

    def __init__(
        self, decision: Decision, say: Callable[[Decision], object] = lambda _: None
    ) -> None:
        """Begin with the first line; ``say`` is called where the mirror does not go on so."""
        self.decision = decision
        self._say = say
        mirror = decision.mirror if decision.kind == 'turns' else None
        self._turns: TurnCounter | FacetCounter | None = None
        if mirror is not None:
            has_facets = mirror.jump > 0.0
            self._turns = FacetCounter(mirror) if has_facets else TurnCounter(mirror, self._change)
        self._heads = {head: LineNumbers(one, say) for head, one in decision.heads}
        self._run, self._last = 0, 0  # lines so far, and the last number given
        self._begun = False
        self._spreader = TimeSpreader(decision.clock)

    def number(self, points: Points) -> Points:
        """Return points with their lines; they follow those of the call before."""
        if not len(points):
            return points
        if self.decision.kind == 'given':
            return points if points.head is None else replace(points, head=None)
        # Times stay as they are: blocks, and methods that know all of a tick, spread them anew.
        own = replace(points, t=self._spreader.spread(points.t))
        return replace(points, line=self.lines(own), head=None)

    def lines(self, points: Points) -> Ints:
        """Return the line of each point (N,)."""
        if self._heads and points.head is not None:
            line = np.full(len(points), -1)
            for rank, (head, numbers) in enumerate(self._heads.items()):
                mine = np.flatnonzero(points.head == head)
                if len(mine):
                    # Of several scanners, lines take turns.
                    line[mine] = numbers.lines(points.take(mine)) * len(self._heads) + rank
            return line
        if self._turns is not None:
            return self._turns.number(points.t, points.xyz)
        return self._count_runs(points)

    def _change(self, mirror: Mirror | None) -> None:
        """Say that turns did not resemble each other any more."""
        how = 'they go on as before' if mirror is None else mirror.text
        text = f'scan lines did not resemble each other any more: {how}'
        self.decision = self.decision._replace(
            mirror=mirror or self.decision.mirror, text=text, contradicts=True
        )
        self._say(self.decision)

    def _count_runs(self, points: Points) -> Ints:
        order: Ints | slice = slice(None)
        if not (points.t[1:] >= points.t[:-1]).all():
            order = np.argsort(points.t, kind='stable')
        given = points.line[order]
        begins = self._begun and given[0] != self._last
        changed: Bools = np.append(begins, np.diff(given) != 0)
        line = np.empty(len(given), np.int64)
        line[order] = self._run + np.cumsum(changed)
        self._run, self._last, self._begun = int(line.max()), int(given[-1]), True
        return line


def settle_lines(points: Points, claim: Claim, period: float = 0.0) -> tuple[Points, Decision]:
    """Give a whole cloud its scan lines: N points in any order, missing returns among them.

    The first stretch of its time decides, as in a stream.
    """
    where = np.flatnonzero(points.valid)
    some = points.take(where)
    if not len(some) or np.ptp(some.t) == 0:
        return points, GIVEN
    end = int(some.t.min()) + STRETCH_NS
    decision = decide(some.take(some.t < end), claim, period)
    said = [decision.text]
    line = points.line.copy()
    line[where] = LineNumbers(decision, lambda new: said.append(new.text)).number(some).line
    decision = decision._replace(
        text='; '.join(said), contradicts=decision.contradicts or len(said) > 1
    )
    return replace(points, line=line, head=None), decision
