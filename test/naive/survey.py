# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The features of clouds without scan lines in plain loops, one point at a time."""

import math
from statistics import median

import numpy as np

from naive.neighbours import nearest, squared

K, MAX_NEIGHBOURS, SOME = 8, 60, 20
MIN_SCALE_M, EVEN, SMOOTH, FAR, NARROW = 1e-6, 0.02, 0.01, 1e6, 1e-6

Position = tuple[float, float, float]


def lists(xyz: list[Position], k: int) -> list[list[int]]:
    """List the nearest others of each point, the nearest first, then the first given."""
    return [nearest(xyz, p, k)[0] for p in range(len(xyz))]


def first_of_each(xyz: list[Position]) -> list[int]:
    """Return the first point at the place of each."""
    return [xyz.index(place) for place in xyz]


def near_features(xyz: list[Position], typical: float, *, is_sweep: bool) -> list[list[float]]:
    """Return the 25 features of each point that the first trees see."""
    near = lists(xyz, K)
    radius = [math.dist(xyz[p], xyz[near[p][-1]]) for p in range(len(xyz))]
    return [
        [
            *_near(xyz, near, radius, p),
            min(radius[p] / typical, FAR),
            component_size(near, p),
            *deep,
            math.hypot(*xyz[p]) * is_sweep,
            radius[p] / max(math.hypot(*xyz[p]), 0.1) * is_sweep,
        ]
        for p, deep in enumerate(depths(xyz, typical))
    ]


def depths(xyz: list[Position], typical: float) -> list[tuple[float, float]]:
    """Return how far each point is below the floor of its wide column, and ÷ how steep that is."""
    side, found = 2.0 * typical, []
    for (low, high), (_, _, z) in zip(_floors(xyz, xyz, side), xyz, strict=True):
        deep, steep = (low - z) / side, (low - z) / (high - low + side)
        found.append((min(max(deep, -FAR), FAR), min(max(steep, -FAR), FAR)))
    return found


def heights(xyz: list[Position], some: list[Position], side: float) -> list[float]:
    """Return how high points are above the floor of some of them, in columns of a side."""
    floors = _floors(xyz, some, side)
    return [z - low for (_, _, z), (low, _) in zip(xyz, floors, strict=True)]


def _floors(xyz: list[Position], some: list[Position], side: float) -> list[tuple[float, float]]:
    """Return the quartiles of the lowest points of the columns around each point."""
    lowest: dict[tuple[int, int], float] = {}
    left, front = min(x for x, _, _ in some), min(y for _, y, _ in some)

    def column(point: Position) -> tuple[int, int]:
        return int(max(point[0] - left, 0.0) / side), int(max(point[1] - front, 0.0) / side)

    for point in some:
        lowest[column(point)] = min(point[2], lowest.get(column(point), point[2]))
    wide = sorted({(a // 5, b // 5) for a, b in lowest})
    found = []
    for i, j in map(column, xyz):
        # Where there are none of these points, the next wide column counts.
        first = next((one for one in wide if one >= (i // 5, j // 5)), wide[-1])
        around = sorted(
            low
            for (a, b), low in lowest.items()
            if abs(a // 5 - first[0]) <= 1 and abs(b // 5 - first[1]) <= 1
        )
        last = len(around) - 1
        found.append((around[last // 4], around[3 * last // 4]))
    return found


def component_size(near: list[list[int]], p: int) -> int:
    """Return how many points steps to neighbours lead to, with the point itself; 61 at most."""
    reached, last = {p}, -1
    while len(reached) != last:
        last = len(reached)
        reached |= {o for one in reached for o in near[one]}
    return min(len(reached), MAX_NEIGHBOURS + 1)


def _near(xyz: list[Position], near: list[list[int]], radius: list[float], p: int) -> list[float]:
    others = near[p]
    distance = [math.dist(xyz[p], xyz[o]) for o in others]
    radii = [radius[o] for o in others]
    s = median(radii) + MIN_SCALE_M
    jump, jump_at = 1.0, 0
    for m in range(1, K):
        if distance[m] / (distance[m - 1] + MIN_SCALE_M) > jump:
            jump, jump_at = distance[m] / (distance[m - 1] + MIN_SCALE_M), m
    listed = sum(d <= r for d, r in zip(distance, radii, strict=True))
    reached = {*others, *(two for one in others for two in near[one])} - {p}
    off, flat, thin, upright, aside = plane(xyz, others, p)
    heights = _below(xyz, others, s, p)
    found = [
        *(distance[0] / s, sum(distance[:3]) / (3 * s), distance[-1] / s),
        *(distance[-1] / (min(radii) + MIN_SCALE_M), max(radii) / s, jump, jump_at, listed),
        *(len(reached), off / s, flat / s, off / (flat + SMOOTH * s), thin, aside, upright),
        *heights,
    ]
    return [min(max(value, -FAR), FAR) for value in found]


def _below(xyz: list[Position], others: list[int], s: float, p: int) -> list[float]:
    """Say how far a point is below and above others, and how these are spread there."""
    z = sorted(xyz[o][2] - xyz[p][2] for o in others)
    quarter = len(z) // 4
    return [
        *(z[0] / s, -z[-1] / s, z[0] / (z[quarter] - z[0] + EVEN * s)),
        -z[-1] / (z[-1] - z[-1 - quarter] + EVEN * s),
    ]


def plane(
    xyz: list[Position], others: list[int], p: int
) -> tuple[float, float, float, float, float]:
    """Return how far a point is off the plane of others, these are, and three things about it.

    How thin it is, how upright its normal, and how far its middle is from the point.
    """
    away = np.array([[a - b for a, b in zip(xyz[o], xyz[p], strict=True)] for o in others])
    mean = away.mean(axis=0)
    moment = (away - mean).T @ (away - mean) / len(others)
    value, vector = np.linalg.eigh(moment)
    value = np.maximum(value, 0.0)
    thin = math.sqrt(value[1]) / (math.sqrt(value[2]) + MIN_SCALE_M)
    aside = math.sqrt(mean @ mean) / (math.sqrt(np.trace(moment)) + MIN_SCALE_M)
    if value[1] > NARROW * value[2]:
        normal = vector[:, 0]
        return abs(mean @ normal), math.sqrt(value[0]), thin, abs(normal[2]), aside
    along = vector[:, 2]
    off = math.sqrt(max(mean @ mean - (mean @ along) ** 2, 0.0))
    return off, math.sqrt(value[0] + value[1]), thin, abs(along[2]), aside


def far_features(xyz: list[Position], odds: list[float], typical: float) -> list[list[float]]:
    """Return the features of each point that the second trees see, behind those of the first."""
    near, far = lists(xyz, K), lists(xyz, MAX_NEIGHBOURS)
    radius = [math.dist(xyz[p], xyz[near[p][-1]]) for p in range(len(xyz))]
    found = []
    for p in range(len(xyz)):
        values = [
            *_widths(xyz, far[p], radius, p),
            *_group(xyz, far[p], radius, p),
            *_planes(xyz, far[p], radius, p),
            *_heights(xyz, far[p], radius, p, typical),
            odds[p],
            sum(odds[o] for o in near[p]) / K,
            sum(odds[o] > 0 for o in near[p]) / K,
            sum(odds[o] > 0 for o in far[p]) / len(far[p]),
        ]
        found.append([min(max(value, -FAR), FAR) for value in values])
    return found


def scale(others: list[int], radius: list[float]) -> float:
    """Return S: the median radius of the others, the upper of two in the middle."""
    return sorted(radius[o] for o in others)[len(others) // 2] + MIN_SCALE_M


def _widths(xyz: list[Position], others: list[int], radius: list[float], p: int) -> list[float]:
    wide, count = scale(others, radius), len(others)
    dense = sorted(radius[o] for o in others)[min(5, count - 1)] + MIN_SCALE_M
    twentieth = others[min(SOME, count) - 1]
    s = median(radius[o] for o in others[:K]) + MIN_SCALE_M
    return [
        *(radius[p] / wide, math.dist(xyz[p], xyz[twentieth]) / wide),
        *(math.dist(xyz[p], xyz[others[-1]]) / wide, radius[p] / dense),
        wide / s,
    ]


def _group(xyz: list[Position], others: list[int], radius: list[float], p: int) -> list[float]:
    """Say what hangs together with the point up to each distance."""
    wide = scale(others, radius)
    edges = []
    # The way to each point that is left: from the nearest of those that hang together.
    shortest = {o: (math.sqrt(squared(xyz[p], xyz[o])), o) for o in others}
    while shortest:
        edge, new = min(shortest.values())
        edges.append(edge)
        del shortest[new]
        for o, reach in shortest.items():
            shortest[o] = min(reach, (math.sqrt(squared(xyz[new], xyz[o])), o))
    longest = max(edges)
    before = edges.index(longest)
    of = max(edges[:before]) if before else wide
    group = next((n for n, edge in enumerate(edges) if edge > 2 * wide), len(edges))
    against = longest / (of + MIN_SCALE_M) if longest > 0 else 0.0
    return [edges[0] / wide, longest / wide, before, against, group]


def _planes(xyz: list[Position], others: list[int], radius: list[float], p: int) -> list[float]:
    wide, found = scale(others, radius), []
    for count in (SOME, MAX_NEIGHBOURS):
        off, flat, *_ = plane(xyz, others[:count], p)
        found += [off / wide, flat / wide, off / (flat + SMOOTH * wide)]
    return found


def _heights(
    xyz: list[Position], others: list[int], radius: list[float], p: int, typical: float
) -> list[float]:
    wide, z = scale(others, radius), xyz[p][2]
    few, many = (_below(xyz, others[:count], wide, p) for count in (SOME, MAX_NEIGHBOURS))
    found = [*few[:2], *many[:2], *few[2:], *many[2:], wide / typical]
    found.append(sum(xyz[o][2] > z for o in others) / len(others))
    between = []
    for m, one in enumerate(others[:SOME]):
        for other in others[:m]:
            (ax, ay), (bx, by) = (
                (xyz[o][0] - xyz[p][0], xyz[o][1] - xyz[p][1]) for o in (one, other)
            )
            a, b = math.hypot(ax, ay), math.hypot(bx, by)
            if ax * bx + ay * by < -0.8 * a * b:
                between.append(((xyz[one][2] - z) * b + (xyz[other][2] - z) * a) / (a + b))
    return [*found, *((min(between) / wide, -max(between) / wide) if between else (0.0, 0.0))]


def add_up(
    start: float,
    features: list[list[int]],
    limits: list[list[float]],
    leaves: list[list[float]],
    values: list[float],
) -> float:
    """Add up what trees of three questions say of a point with these features."""
    total = np.float32(start)
    for feature, limit, leaf in zip(features, limits, leaves, strict=True):
        node = 0
        for _ in range(3):
            above = np.float32(values[feature[node]]) > np.float32(limit[node])
            node = 2 * node + 2 if above else 2 * node + 1
        total = np.float32(total + np.float32(leaf[node - 7]))
    return float(total)
