# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The weighed features as textbook loops: the fast detector's slow twin.

Nothing of the package is imported here, so that no mistake can be shared.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import dist, exp, inf, isnan, log, nan, sqrt
from statistics import median
from typing import NamedTuple

import numpy as np

Point = Sequence[float]
FEATURES = ('spacing', 'step', 'lonely', 'amid', 'along', 'surface', 'alone', 'company')
BOUNDS = {
    'spacing': (1.0, exp(3.0)),
    'step': (1.0, exp(2.0)),
    'lonely': (1.0, exp(1.2)),
    'amid': (exp(-1.2), 1.0),
    'along': (exp(0.7), exp(2.8)),
    'alone': (1.0, 9.0),
}


@dataclass(frozen=True)
class Scan:
    """Points, the time and the line of each, and its distance from the sensor."""

    xyz: Sequence[Point]
    t: Sequence[int]
    line: Sequence[int]
    range_m: Sequence[float]

    def take(self, which: Sequence[int]) -> 'Scan':
        """Choose points."""
        return Scan(
            [self.xyz[i] for i in which],
            [self.t[i] for i in which],
            [self.line[i] for i in which],
            [self.range_m[i] for i in which],
        )


def nearest(xyz: Sequence[Point], i: int, k: int) -> list[int]:
    """List the k nearest others; of equally far ones those that come first."""
    others = [j for j in range(len(xyz)) if j != i]
    return sorted(others, key=lambda j: (squared(xyz[i], xyz[j]), j))[:k]


def squared(a: Point, b: Point) -> float:
    """Squared distance, in the order of operations of the search."""
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    return (x * x + y * y) + z * z


def mean_distance(xyz: Sequence[Point], i: int, others: Sequence[int]) -> float:
    """Mean distance to some others."""
    return sum(dist(xyz[i], xyz[j]) for j in others) / len(others)


def surface(xyz: Sequence[Point], i: int, others: Sequence[int]) -> tuple[float, float, float]:
    """Distance of a point from the surface of others, its scale, and how much it is amidst them."""
    near = np.array([np.subtract(xyz[j], xyz[i]) for j in others])
    weight = np.ones(len(others))
    normal, middle, scale, amidst = np.zeros(3), np.zeros(3), 0.0, 0.0
    for fit in range(2):
        middle = np.average(near, axis=0, weights=weight)
        centred = near - middle
        value, vector = np.linalg.eigh((centred * weight[:, None]).T @ centred / weight.sum())
        normal = vector[:, 0]
        if value[1] <= 1e-6 * value[2]:
            across = middle - (middle @ vector[:, 2]) * vector[:, 2]
            length = float(np.linalg.norm(across))
            normal = across / length if length > 0 else np.array([0.0, 0.0, 1.0])
        if fit == 0:
            spread = value[1] + value[2]
            along = max(middle @ middle - (middle @ normal) ** 2, 0.0)
            aside = sqrt(along / spread) if spread > 0 else 0.0
            amidst = min(max(1.5 * (1 - aside), 0.0), 1.0)
        residual = np.abs(centred @ normal)
        scale = 1.4826 * float(np.median(residual)) + 1e-4
        weight = 1 / (1 + (residual / (3 * scale)) ** 2) ** 2
    off = abs(float(middle @ normal))
    return off, scale, amidst


def segments(scan: Scan, gap_factor: float) -> list[list[list[int]]]:
    """Sort points into lines by time, and lines into segments, which end before gaps."""
    result = []
    for line in sorted(set(scan.line)):
        members = sorted(
            (i for i in range(len(scan.line)) if scan.line[i] == line), key=scan.t.__getitem__
        )
        steps = [scan.t[b] - scan.t[a] for a, b in pairwise(members)]
        longest = gap_factor * median([step for step in steps if step > 0] or [0])
        parts = [[members[0]]]
        for i, step in zip(members[1:], steps, strict=True):
            if step <= longest:
                parts[-1].append(i)
            else:
                parts.append([i])
        result.append(parts)
    return result


def difference(scan: Scan, i: int, j: int, k: int) -> float:
    """Distance from the way through two others, over the noise that their places add."""
    if scan.t[j] == scan.t[k]:
        return inf
    part = (scan.t[i] - scan.t[j]) / (scan.t[k] - scan.t[j])
    predicted = [(1 - part) * a + part * b for a, b in zip(scan.xyz[j], scan.xyz[k], strict=True)]
    return dist(scan.xyz[i], predicted) / sqrt(1 + (1 - part) ** 2 + part**2)


def follow(scan: Scan, parts: Sequence[Sequence[Sequence[int]]]) -> tuple[list[float], list[float]]:
    """Distance to the nearer neighbour in the segment, and the least of three differences."""
    step, along = [inf] * len(scan.t), [inf] * len(scan.t)
    for segment in (segment for line in parts for segment in line):
        for m, i in enumerate(segment):
            front = list(segment[max(m - 2, 0) : m])[::-1]
            behind = list(segment[m + 1 : m + 3])
            beside = front[:1] + behind[:1]
            step[i] = min((dist(scan.xyz[i], scan.xyz[j]) for j in beside), default=inf)
            pairs = [pair for pair in (front, behind, beside) if len(pair) == 2]
            along[i] = min((difference(scan, i, *pair) for pair in pairs), default=inf)
    return step, along


def usual(parts: Sequence[Sequence[Sequence[int]]], values: Sequence[float]) -> list[float]:
    """Median of the finite values of the others up to eight places away in the line."""
    result = list(values)
    for line in parts:
        members = [i for segment in line for i in segment]
        for m, i in enumerate(members):
            others = members[max(m - 8, 0) : m] + members[m + 1 : m + 9]
            finite = [values[j] for j in others if values[j] < inf]
            if finite:
                result[i] = median(finite)
    return result


def typical(values: Sequence[float]) -> float:
    """Median of the finite values, but at least 2 mm."""
    finite = [value for value in values if value < inf]
    return max(0.002, median(finite)) if finite else 0.002


class Typical(NamedTuple):
    """What is typical of all points: spacing ÷ range, and the least two scales."""

    part: float
    along: float
    surface: float


def ratios(
    scan: Scan, gap_factor: float, *, spinning: bool, first: Typical | None = None
) -> tuple[list[dict[str, float]], list[float], Typical]:
    """List what each feature looks at, of each point, the spacing expected, and what is typical.

    After the ``first`` pass what was typical in it counts.
    """
    n = range(len(scan.xyz))
    near = [nearest(scan.xyz, i, 20) for i in n]
    d3, d5, d20 = ([mean_distance(scan.xyz, i, near[i][:k]) for i in n] for k in (3, 5, 20))
    elsewhere = [[j for j in near[i] if scan.line[j] != scan.line[i]] for i in n]
    other = [
        dist(scan.xyz[i], scan.xyz[elsewhere[i][0]])
        if elsewhere[i]
        else 1.2 * dist(scan.xyz[i], scan.xyz[near[i][-1]])
        for i in n
    ]
    parts = segments(scan, gap_factor)
    step, along = follow(scan, parts)
    steps, fives, others = (usual(parts, values) for values in (step, d5, other))
    fits = [surface(scan.xyz, i, near[i]) for i in n]
    usually = first or Typical(
        median(d3[i] / max(scan.range_m[i], 0.001) for i in n),
        typical(along),
        typical([scale for _, scale, _ in fits]),
    )
    sigma, sigma_along = usually.surface, usually.along
    if spinning:
        spacing = [usually.part * scan.range_m[i] for i in n]
    else:
        spacing = [max(steps[i] if steps[i] < inf else 0.0, others[i]) for i in n]
    spacing = [max(one, 0.001) for one in spacing]
    result = []
    for i in n:
        off, scale, amidst = fits[i]
        own = scale + 0.3 * sigma
        sigmas = min(off / sigma, 2 * off / own, 8.0) - 2
        beside = sum(scan.line[j] != scan.line[i] for j in near[i][:8])
        five = median(d5[j] for j in near[i])
        result.append(
            {
                'spacing': d3[i] / spacing[i],
                'step': step[i] / max(steps[i], 0.001) if steps[i] < inf else 0.0,
                'lonely': d5[i] / max(fives[i], 0.001),
                'amid': five / d20[i] if d20[i] > 0 else nan,
                'along': along[i] / sigma_along,
                'surface': max(sigmas, -1.0) * min(1.3 * sigma / own, 1.0) * amidst,
                'alone': 9 / (1 + beside),
            }
        )
    return result, spacing, usually


def statistic(ratio: Mapping[str, float], weights: Mapping[str, float]) -> float:
    """Weighted sum of the logarithms, within their bounds, and of what the other two say; or 0."""
    total = weights['surface'] * ratio['surface']
    total += weights['company'] * ratio.get('company', 0.0)
    for name, (least, most) in BOUNDS.items():
        held = min(max(ratio[name], least), most) if ratio[name] > least else least
        total += weights[name] * log(held / least)
    return max(total, 0.0)


def straightness(scan: Scan, spacing: Sequence[float], gap_factor: float) -> list[float]:
    """0.35 × length ÷ width of the slanted group that a point is in; NaN in none.

    Joined up to 4 and up to 1.5 expected spacings, the greater of both.
    """
    wide, narrow = (_straightness_of(scan, spacing, gap_factor, reach) for reach in (4.0, 1.5))
    return [
        max(a, b) if not isnan(a) and not isnan(b) else (b if isnan(a) else a)
        for a, b in zip(wide, narrow, strict=True)
    ]


def _straightness_of(
    scan: Scan, spacing: Sequence[float], gap_factor: float, spacings: float
) -> list[float]:
    n = len(scan.xyz)
    near = [set(nearest(scan.xyz, i, 12)) for i in range(n)]
    for line in segments(scan, gap_factor):
        for segment in line:
            for a, b in pairwise(segment):
                near[a].add(b)
    group = list(range(n))
    for i in range(n):
        for j in near[i]:
            reach = spacings * min(spacing[i], spacing[j])
            if squared(scan.xyz[i], scan.xyz[j]) <= reach * reach and group[i] != group[j]:
                old, new = group[i], group[j]
                group = [new if one == old else one for one in group]
    result = [nan] * n
    for number in set(group):
        members = [i for i in range(n) if group[i] == number]
        if 24 <= len(members) <= 3000:
            value = _straightness([scan.xyz[i] for i in members], [scan.line[i] for i in members])
            for i in members:
                result[i] = value
    return result


def _straightness(xyz: Sequence[Point], line: Sequence[int]) -> float:
    points = np.array(xyz)
    centred = points - points.mean(axis=0)
    value, vector = np.linalg.eigh(centred.T @ centred / len(points))
    length, width = sqrt(max(value[2], 0.0)), sqrt(max(value[1], 0.0))
    if len(line) < 1.5 * len(set(line)):
        return nan
    if not 0.1 < abs(vector[2, 2]) < 0.92:
        return nan
    if sqrt(12) * length > 8 or sqrt(12) * width > 0.25:
        return nan
    along = centred @ vector[:, 2]
    means = [
        np.mean([a for a, other in zip(along, line, strict=True) if other == one])
        for one in sorted(set(line))
    ]
    if len(means) > 3 and np.std(means) < 0.95 * length:
        return nan
    return 0.35 * length / max(width, 1e-9)


def spins(scan: Scan) -> bool:
    """Whether more than two lines are measured at once, on average."""
    times: dict[int, list[int]] = {}
    for line, t in zip(scan.line, scan.t, strict=True):
        times.setdefault(line, []).append(t)
    spans = sum(max(one) - min(one) for one in times.values())
    return spans > 2 * (max(scan.t) - min(scan.t))


def bereaved(xyz: Sequence[Point], names: Sequence[int], score: Sequence[float]) -> dict[int, int]:
    """How many of the 20 nearest of each point, by its name, score above 1."""
    return {
        name: sum(score[names[j]] > 1 for j in nearest(xyz, i, 20)) for i, name in enumerate(names)
    }


def detect(
    scan: Scan,
    weights: Mapping[bool, Mapping[str, float]],
    gap_factor: float = 1.5,
    sensor: str = 'auto',
    part: float = 1.0,
) -> list[float]:
    """Score by statistic over threshold, pass after pass without the rejected.

    ``weights`` are those of a spinning sensor under True, and of a profile scanner under False;
    with ``threshold``, ``passes`` and ``slanted``. All that is compared with a threshold is
    compared with ``part`` times as much.
    """
    score = [nan] * len(scan.t)
    where = list(range(len(scan.t)))
    if not where:
        return score
    spinning = spins(scan) if sensor == 'auto' else sensor == 'spinning'
    how = weights[spinning]
    if len(where) <= 20:
        return score
    said, spacing, usually = ratios(scan, gap_factor, spinning=spinning)
    for i, one in enumerate(said):
        score[i] = statistic(one, how) / (part * how['threshold'])
    lost = [0] * len(score)
    for _ in range(int(how['passes']) - 1):
        kept = [i for i in where if score[i] <= 1]
        if len(kept) == len(where) or len(kept) <= 20:
            break
        before = scan.take(where)
        newly = bereaved(before.xyz, where, score)
        bereft = {i for i, count in newly.items() if count > 0}
        lost = [count + newly.get(i, 0) for i, count in enumerate(lost)]
        said, now, _ = ratios(scan.take(kept), gap_factor, spinning=spinning, first=usually)
        # Only points that lost a neighbour are received again; the others' spacing stays, too.
        spacing = [
            new if i in bereft else old
            for i, new, old in zip(
                kept,
                now,
                (spacing[where.index(i)] for i in kept),
                strict=True,
            )
        ]
        where = kept
        for i, one in zip(where, said, strict=True):
            if i in bereft:
                one['company'] = min(lost[i] / 20, 1.0) - 1 / 3
                score[i] = statistic(one, how) / (part * how['threshold'])
    if how['slanted']:
        # Those of the last pass are groups no more.
        groups = straightness(scan.take(where), spacing, gap_factor)
        for i, group in zip(where, groups, strict=True):
            score[i] = score[i] if isnan(group) else max(score[i], group / part)
    return score
