# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What only a profile scanner's points have, in plain loops.

Where the scanner was, predictions by pairs, free groups.
"""

import math
from itertools import product
from statistics import mean, median
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from naive.scan_pattern import Point, Ring, nearest

LARGE, SMALLEST, MAX_FEATURE = 40, 6, 1000.0
Cell = tuple[int, int]  # of a return: its line, and its cell there


class Seat(NamedTuple):
    """Where the scanner of a line was: metres; how far returns are off, rad; how unsure, metres.

    And where its mirror points to at angles 0 and π/2.
    """

    position: list[float]
    off: float
    unsure: float
    beam: list[list[float]]


def seat(xyz: NDArray[np.float64], turned: list[float]) -> Seat:
    """Fit a scanner, whose mirror turned so far at each return, to the returns of a line (S, 3)."""
    centre = xyz.mean(axis=0)
    *_, axes = np.linalg.svd(xyz - centre)
    x, y = ((xyz - centre) @ axes[:2].T).T
    found = []
    for sense in (1, -1):
        sine = np.array([sense * math.sin(angle) for angle in turned])
        cosine = np.array([math.cos(angle) for angle in turned])
        rows = np.stack([x * sine - y * cosine, x * cosine + y * sine, -sine, cosine], axis=1)
        weight = np.ones(len(x))
        for _ in range(3):
            value, vector = np.linalg.eigh((rows * weight[:, None]).T @ (rows * weight[:, None]))
            a, b, c, d = vector[:, 0]
            length = math.hypot(a, b)
            east, north = (c * a - d * b) / length**2, (c * b + d * a) / length**2
            far = np.hypot(x - east, y - north)
            weight = 1 / np.maximum(far, 0.5)
        off = median(abs(rows @ vector[:, 0]) * weight) / length
        unsure = math.sqrt(value[0] / (len(x) * value[1])) / length
        position = centre + east * axes[0] + north * axes[1]
        cos, sin = a / length, b / length
        ahead = (x - east) * (cosine * cos - sine * sin) + (y - north) * (cosine * sin + sine * cos)
        if sum(ahead * weight) < 0:
            cos, sin = -cos, -sin
        beam = [cos * axes[0] + sin * axes[1], sense * (cos * axes[1] - sin * axes[0])]
        found.append(Seat(position.tolist(), float(off), unsure, [one.tolist() for one in beam]))
    return min(found, key=lambda one: one.off)


class Predictions(NamedTuple):
    """How much farther pairs predict a return, standard deviations: of its line, of others."""

    own: list[float]
    other: list[float]


def predictions(rings: list[Ring], number: int, k: int, sigma: float) -> Predictions:
    """Predict the range of a return from pairs of others that lie opposite each other."""
    ring = rings[number]
    me, found = ring.points[k], Predictions([], [])

    def clipped(inverse: float, square: float) -> float:
        # Of a plane, the inverse range is a sine.
        off = (me.range * inverse - 1 + square / 2) * me.range / sigma
        return max(min(off, MAX_FEATURE), -MAX_FEATURE)

    for m in range(1, 6):
        a, b = _at(ring, k - m, me, 10 * ring.step), _at(ring, k + m, me, 10 * ring.step)
        if a is not None and b is not None and b.phase > a.phase:
            part = (me.phase - a.phase) / (b.phase - a.phase)
            square = (me.phase - a.phase) * (b.phase - me.phase)
            found.own.append(clipped((1 - part) / a.range + part / b.range, square))
    for apart, m in product((1, 2), range(-3, 4)):
        if number < apart or number + apart >= len(rings):
            continue
        below, above = rings[number - apart], rings[number + apart]
        a = _at(below, nearest(below, me.phase) + m, me, 6 * ring.step)
        b = _at(above, nearest(above, me.phase) - m, me, 6 * ring.step)
        if a is not None and b is not None:
            inverse = (1 / a.range + 1 / b.range) / 2
            found.other.append(clipped(inverse, (m * ring.step) ** 2))
    return found


def _at(ring: Ring, k: int, me: Point, most: float) -> Point | None:
    """Return a return of a line that is not too far in angle."""
    if 0 <= k < len(ring.points) and abs(ring.points[k].phase - me.phase) <= most:
        return ring.points[k]
    return None


def of_pairs(found: Predictions) -> dict[str, float]:
    """Return the features of a return that its pairs give."""
    every = [*found.own, *found.other]
    return {
        'middle': median(every) if every else 0.0,
        'agree': mean(abs(off) < 3.5 for off in every) if every else -1.0,
    }


class Reach(NamedTuple):
    """Lines, and up to which distance each of their returns is joined with others, metres."""

    rings: list[Ring]
    most: list[list[float]]

    def is_close(self, of: Cell, other: Cell) -> bool:
        """Return whether another return is within reach of one."""
        one, two = (self.rings[n].points[k].xyz for n, k in (of, other))
        return math.dist(one, two) <= self.most[of[0]][of[1]]

    def segments(self) -> list[list[Cell]]:
        """List the returns of each segment."""
        found: list[list[Cell]] = []
        for number, ring in enumerate(self.rings):
            for k in range(len(ring.points)):
                if k == 0 or not self.is_close((number, k), (number, k - 1)):
                    found.append([])
                found[-1].append((number, k))
        return found

    def beside(self, number: int, k: int) -> list[Cell]:
        """List the returns of other lines that are within reach of one, up to three away."""
        phase, found = self.rings[number].points[k].phase, []
        for other in (number - 2, number - 1, number + 1, number + 2):
            if 0 <= other < len(self.rings):
                j, count = nearest(self.rings[other], phase), len(self.rings[other].points)
                cells = [(other, m) for m in range(max(j - 3, 0), min(j + 4, count))]
                found += [cell for cell in cells if self.is_close((number, k), cell)]
        return found


def groups(rings: list[Ring], apart: list[float], reach: float) -> list[list[Cell]]:
    """List the free groups: the returns of each."""
    most = [
        [reach * (p.range * r.gap + a) for p in r.points] for r, a in zip(rings, apart, strict=True)
    ]
    near = Reach(rings, most)
    segments = near.segments()
    segment_of = {cell: s for s, segment in enumerate(segments) for cell in segment}
    large = {s for s, segment in enumerate(segments) if len(segment) > LARGE}
    close: list[set[int]] = [set() for _ in segments]
    for cell, s in segment_of.items():
        if s not in large:
            for other in near.beside(*cell):
                close[s].add(segment_of[other])
                close[segment_of[other]].add(s)
    found, seen = [], set(large)
    for s in range(len(segments)):
        group, pending = set(), [s]
        while pending:
            one = pending.pop()
            group.add(one)
            pending += [] if one in large else close[one] - group
        members = sorted(cell for one in group for cell in segments[one])
        if s not in seen and not group & large and len(members) >= SMALLEST:
            found.append(members)
        seen |= group
    return found


def of_group(rings: list[Ring], members: list[Cell]) -> dict[str, float]:
    """Describe a group whose returns lie along x, which need not be turned first."""
    xyz = [rings[n].points[k].xyz for n, k in members]
    x = [p[0] for p in xyz]
    of_line = [[rings[n].points[k].xyz[0] for n, k in members if n == m] for m, _ in members]
    spread = _spread(x)
    return {
        'group': len(members),
        'group_width': max(_spread([p[1] for p in xyz]), _spread([p[2] for p in xyz])) / spread,
        'group_advance': _spread([mean(line) for line in of_line]) / spread,
        'group_length': math.sqrt(12) * spread,
    }


def _spread(values: list[float]) -> float:
    middle = mean(values)
    return math.sqrt(mean((value - middle) ** 2 for value in values))
