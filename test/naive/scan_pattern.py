# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The scan pattern of a spinning sensor and its features in plain loops, one point at a time."""

import itertools
import math
from statistics import median
from typing import NamedTuple

import numpy as np

NOISE, SAME, SAME_M, MAX_FEATURE = 0.02, 1.5, 0.06, 1000.0


class Point(NamedTuple):
    """A return: its number as given, position, range, and how far the head has turned, rad."""

    number: int
    xyz: tuple[float, float, float]
    range: float
    phase: float


class Ring(NamedTuple):
    """The returns of a ring in order of their phase, and the angles between beams, rad.

    ``turn`` is how far the head turns while the beam moves by 1 rad, ``uneven`` the angle to the
    farther ring beside ÷ that to the nearer.
    """

    points: list[Point]
    sine: float
    step: float
    gap: float
    turn: float = 1.0
    uneven: float = 1.0


def rings_of(
    xyz: list[tuple[float, float, float]], t: list[int], line: list[int], rate: float
) -> list[Ring]:
    """Sort returns by ring, from below, and phase; ``rate`` is how fast the head turns, rad/ns."""
    sign = 1.0 if rate > 0 else -1.0
    order = sorted(range(len(t)), key=lambda i: (line[i], t[i]))
    base, start = sign * math.atan2(xyz[order[0]][1], xyz[order[0]][0]), t[order[0]]
    of_line: dict[int, list[Point]] = {}
    for i in order:
        expected = base + abs(rate) * (t[i] - start)
        azimuth = sign * math.atan2(xyz[i][1], xyz[i][0])
        turns = round((expected - azimuth) / (2 * math.pi))
        point = Point(i, xyz[i], math.dist(xyz[i], (0, 0, 0)), azimuth + 2 * math.pi * turns)
        of_line.setdefault(line[i], []).append(point)
    found = []
    for every in of_line.values():
        every.sort(key=lambda p: (p.phase, p.range, p.xyz))
        points = [p for k, p in enumerate(every) if k == 0 or p[1:] != every[k - 1][1:]]
        sine = median(p.xyz[2] / p.range for p in points)
        steps = [b.phase - a.phase for a, b in itertools.pairwise(points)]
        step = median(s for s in steps if s > 0) * math.sqrt(1 - sine**2)
        found.append(Ring(points, sine, step, math.inf, 1 / math.sqrt(1 - sine**2)))
    found.sort(key=lambda ring: ring.sine)
    gaps = [
        (b.sine - a.sine) / math.sqrt(1 - ((a.sine + b.sine) / 2) ** 2)
        for a, b in itertools.pairwise(found)
    ]
    both = [gaps[max(n - 1, 0) : n + 1] for n in range(len(found))]
    return [
        ring._replace(
            gap=min(near, default=1.0),
            uneven=min(max(near) / min(near), 10.0) if len(near) == 2 else 10.0,
        )
        for ring, near in zip(found, both, strict=True)
    ]


def nearest(ring: Ring, phase: float) -> int:
    """Return the index of the return nearest in phase; of two as near, the one before."""
    return min(range(len(ring.points)), key=lambda j: (abs(ring.points[j].phase - phase), j))


def window(rings: list[Ring], number: int, k: int) -> tuple[list[Point], list[Point]]:
    """List the returns around a point in its ring, and those in the rings beside it."""
    ring = rings[number]
    me = ring.points[k]
    own = [
        ring.points[k + m]
        for m in (-5, -4, -3, -2, -1, 1, 2, 3, 4, 5)
        if 0 <= k + m < len(ring.points)
        and abs(ring.points[k + m].phase - me.phase) <= 10 * ring.step * ring.turn
    ]
    other = []
    for beside in (number - 2, number - 1, number + 1, number + 2):
        if 0 <= beside < len(rings):
            points = rings[beside].points
            j = nearest(rings[beside], me.phase)
            other += [
                points[j + m]
                for m in range(-3, 4)
                if 0 <= j + m < len(points)
                and abs(points[j + m].phase - me.phase) <= 6 * max(ring.step, ring.gap) * ring.turn
            ]
    return own, other


def pane(rings: list[Ring], number: int, k: int, ups: list[float]) -> list[float]:
    """Return the features of what may have mirrored a point: zeros if nothing.

    ``ups`` are the angles to the rings two and one below, and one and two above.
    """
    ring, me, near, there = rings[number], rings[number].points[k], [], 0
    for off, up in zip((0, -2, -1, 1, 2), (0.0, -ups[0], -ups[1], *ups[2:]), strict=True):
        if 0 <= number + off < len(rings):
            points, there = rings[number + off].points, there + 17
            j = k if off == 0 else nearest(rings[number + off], me.phase)
            some = points[max(j - 8, 0) : j + 9]
            near += [(p, up) for p in some if p.range < 0.98 * me.range - 0.15]
    returns = []
    for p, up in near:
        along = (p.phase - me.phase) / ring.turn
        if abs(along) <= 12.8 * ring.step:
            part = 1 - (along**2 + up**2) / 2, along, up
            returns.append(p.range * np.array(part))
    third, nothing = len(returns) // 3, [0.0] * 7
    if len(near) < there / 2 or len(returns) < 6:
        return nothing
    for n in range(8):
        a, b, c = (returns[n * third // 8 + m * third] for m in range(3))
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal) * math.copysign(1, normal @ a)
        far, cosine = normal @ a, normal[0]
        behind = me.range * cosine - far
        on = [x for x in returns if abs(x @ normal - far) < 0.03 + 0.004 * np.linalg.norm(x)]
        if cosine > 0.15 and behind > 0.2 and len(on) >= 0.7 * len(returns):
            hit = far / cosine
            hole = min(np.linalg.norm(x - (hit, 0, 0)) for x in on)
            hole /= hit * math.sqrt(ring.step * ring.gap) + 0.02
            uneven = math.sqrt(sum((x @ normal - far) ** 2 for x in on) / len(on))
            found = [len(near) / there, len(on) / len(returns), uneven, abs(normal[2])]
            return [*found, behind, cosine, hole] if hole <= 2 else nothing
    return nothing


def features(
    rings: list[Ring], number: int, k: int, apart: float = NOISE, level: float = SAME_M
) -> dict[str, float]:
    """Return those features of a point that need no prediction.

    ``apart`` is added to what the rings are apart, ``level`` to what is at the same range, metres.
    """
    ring = rings[number]
    me = ring.points[k]
    own, other = window(rings, number, k)
    unit = me.range * ring.gap + apart
    same = SAME * unit + level
    far = sorted(math.dist(me.xyz, p.xyz) for p in own + other) + [1e6] * 5
    farthest = max([me.range, *(p.range for p in own + other)])
    return {
        'beside': min([*(math.dist(me.xyz, p.xyz) / unit for p in other), MAX_FEATURE]),
        'near3': min(sum(far[:3]) / 3 / unit, MAX_FEATURE),
        'near5': min(sum(far[:5]) / 5 / unit, MAX_FEATURE),
        'before_own': sum(p.range - me.range < -same for p in own) / max(len(own), 1),
        'behind_own': sum(p.range - me.range > same for p in own) / max(len(own), 1),
        'before_other': sum(p.range - me.range < -same for p in other) / max(len(other), 1),
        'behind_other': sum(p.range - me.range > same for p in other) / max(len(other), 1),
        'level_own': sum(abs(p.range - me.range) <= same for p in own) / 10,
        'level_other': sum(abs(p.range - me.range) <= same for p in other) / 28,
        'there_own': len(own) / 10,
        'there_other': len(other) / 28,
        'range': me.range,
        'range_ratio_glare': me.range**2 / farthest,
        'depth': me.range / farthest,
        'dense': sum(d <= 2 * unit for d in far) / 38,
        'sparse': sum(d <= 6 * unit for d in far) / 38,
        'uneven': ring.uneven,
    }


def brightness(cells: list[tuple[float, float] | None]) -> list[float]:
    """Return intensity ÷ median at the range, of ranges and intensities; -1 for what is not known.

    Every fourth cell shows what is usual between two edges, at least 30 of them.
    """
    edges = [size * 2.0**k for k in range(-1, 8) for size in (1.0, 1.5)]
    found: dict[int, list[float]] = {}
    between = [0 if one is None else sum(one[0] > edge for edge in edges) for one in cells]
    for k, one in enumerate(cells):
        if one is not None and k % 4 == 0 and one[1] >= 0:
            found.setdefault(between[k], []).append(one[1])
    usual = {b: median(values) for b, values in found.items() if len(values) >= 30}
    return [
        min(one[1] / usual[b], 8.0)
        if one is not None and one[1] >= 0 and usual.get(b, 0.0) > 0
        else -1.0
        for one, b in zip(cells, between, strict=True)
    ]


def ranks(cells: list[tuple[float, float] | None]) -> list[float]:
    """Return the rank of intensity × range² in 64 steps; -1 for what is not known."""
    power = [None if one is None or not one[1] >= 0 else one[1] * one[0] ** 2 for one in cells]
    some = sorted(value for value in power[::4] if value is not None)
    limits = [some[k * len(some) // 64] for k in range(1, 64)] if len(some) >= 30 else []
    return [
        -1.0 if value is None or not limits else sum(limit < value for limit in limits) / 64
        for value in power
    ]


def tree(feature: list[int], limit: list[float], value: list[float], point: list[float]) -> float:
    """Return what a tree of three questions says of a point."""
    node = 0
    for _ in range(3):
        node = 2 * node + (2 if point[feature[node]] > limit[node] else 1)
    return value[node - 7]


def additions(
    feature: list[int], limit: list[float], value: list[float], point: list[float]
) -> dict[int, float]:
    """Return what each feature that a tree asks about adds to the mean of all its values."""
    node, possible = 0, value
    added: dict[int, float] = {}
    for _ in range(3):
        right = point[feature[node]] > limit[node]
        half = len(possible) // 2
        left = possible[half:] if right else possible[:half]
        change = sum(left) / len(left) - sum(possible) / len(possible)
        added[feature[node]] = added.get(feature[node], 0.0) + change
        node, possible = 2 * node + (2 if right else 1), left
    return added


def valley(log_odds: list[float], threshold: float, drop: float) -> float:
    """Return the tried log-odds that the fewest points are near; the threshold if few exceed it."""
    if sum(value > threshold for value in log_odds) < max(0.005 * len(log_odds), 50):
        return threshold
    tried = [threshold - 0.1 * k for k in range(round(drop / 0.1) + 1)]
    return min(tried, key=lambda at: sum(at - 0.5 <= value < at + 0.5 for value in log_odds))
