# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The elevation gross-error test as textbook loops: the slow twin of the fast one.

Nothing of the package is imported here, so that no mistake can be shared. The method is that of
Kang, Huang and Yang, "A gross error elimination method for point cloud data based on kd-tree"
(2018), section 3.3, whose steps are named. Distances are compared by their squares.
"""

from collections.abc import Callable, Iterable, Sequence
from math import inf, nan
from statistics import fmean, stdev

Cloud = Sequence[Sequence[float]]


def set_apart(elevation: Sequence[float], gap: float, share: float) -> list[float]:
    """Step 1: by how much each point is beyond the rest of the cloud; 0 for the points of it.

    Seen from outside, elevations end at an empty stretch wider than ``gap``. Points beyond it are
    set apart if they are at most ``share`` of all, or a single one. Of one or two points none is.
    """
    count = len(elevation)
    most = max(1, int(share * count))
    rank = sorted(range(count), key=lambda i: elevation[i])
    beyond = [0.0] * count
    if 2 * most >= count:
        return beyond
    for upwards in (False, True):
        inwards = rank[::-1] if upwards else rank
        outside = 0
        for n in range(1, most + 1):
            if abs(elevation[inwards[n]] - elevation[inwards[n - 1]]) > gap > 0:
                outside = n
        for i in inwards[:outside]:
            beyond[i] = abs(elevation[i] - elevation[inwards[outside]])
    return beyond


def nearest(cloud: Cloud, p: int, k: int, axes: int = 2) -> list[int]:
    """Step 3: the k nearest others in x and y, or in z too, and all that are as near."""

    def squared(q: int) -> float:
        total = 0.0
        for axis in range(axes):
            step = cloud[p][axis] - cloud[q][axis]
            total += step * step
        return total

    others = {q: squared(q) for q in range(len(cloud)) if q != p}
    reach = sorted(others.values())[k - 1]
    return [q for q, distance in others.items() if distance <= reach]


def difference(cloud: Cloud, p: int, k: int, axes: int = 2) -> float:
    """Step 3: M, mean elevation of the neighbours less that of the point."""
    return fmean(cloud[q][2] for q in nearest(cloud, p, k, axes)) - cloud[p][2]


def scores(  # noqa: PLR0913  all settings
    cloud: Cloud,
    k: int,
    multiplier: float,
    sides: str,
    gap: float,
    share: float,
    sigma_floor: float,
    neighbours: str = 'map',
) -> list[float]:
    """Go through steps 1 to 5: statistic ÷ critical value; NaN where there are too few others."""
    if len(cloud) <= k:
        return [nan] * len(cloud)
    beyond = set_apart([point[2] for point in cloud], gap, share)
    result = [b / gap if b > 0 else nan for b in beyond]
    left = [i for i, b in enumerate(beyond) if b == 0]
    if len(left) <= k:
        return result
    body = [cloud[i] for i in left]
    axes = 2 if neighbours == 'map' else 3
    differences = [difference(body, p, k, axes) for p in range(len(body))]
    mean, sigma = fmean(differences), max(sigma_floor, stdev(differences))
    for i, m in zip(left, differences, strict=True):
        off = (m - mean) / (multiplier * sigma)
        result[i] = {'both': abs(off), 'low': off, 'high': -off}[sides]
    return result


# Against the ground: Zhang et al. (2003), "A progressive morphological filter" --------------------

Grid = list[list[float]]


def on_line(known: dict[int, float], at: float) -> float:
    """Return the height at a place of a row: between the nearest two that are known, or as one."""
    before = [i for i in known if i <= at]
    behind = [i for i in known if i >= at]
    if not before or not behind:
        return known[min(behind) if behind else max(before)]
    low, high = max(before), min(behind)
    if low == high:
        return known[low]
    return known[low] + (known[high] - known[low]) * (at - low) / (high - low)


def filled(grid: Grid, known: list[list[bool]]) -> Grid:
    """Fill what is not known, along rows; then rows of which nothing is known."""
    rows: dict[int, list[float]] = {}
    for i, row in enumerate(grid):
        there = {j: z for j, z in enumerate(row) if known[i][j]}
        if there:
            rows[i] = [row[j] if j in there else on_line(there, j) for j in range(len(row))]
    if not rows:
        return grid
    return [
        rows[i]
        if i in rows
        else [on_line({k: row[j] for k, row in rows.items()}, i) for j in range(len(grid[0]))]
        for i in range(len(grid))
    ]


def filtered(grid: Grid, width: int, choose: Callable[[Iterable[float]], float]) -> Grid:
    """Give each cell the least, or the greatest, of the square around it; edges are mirrored."""
    rows, columns, half = len(grid), len(grid[0]), width // 2

    def inside(i: int, count: int) -> int:
        i %= 2 * count
        return i if i < count else 2 * count - 1 - i

    return [
        [
            choose(
                grid[inside(i + a, rows)][inside(j + b, columns)]
                for a in range(-half, half + 1)
                for b in range(-half, half + 1)
            )
            for j in range(columns)
        ]
        for i in range(rows)
    ]


def ground(grid: Grid, cell: float, widest: float, slope: float) -> Grid:
    """Find the ground: steps 2 and 3, and then low cells are raised."""
    surface, is_ground, before, width = grid, [[True] * len(row) for row in grid], 3, 3
    while True:
        opened = filtered(filtered(surface, width, min), width, max)
        rise = min(0.3 + slope * (width - before) * cell, 3.0)
        for i, row in enumerate(surface):
            for j, z in enumerate(row):
                is_ground[i][j] = is_ground[i][j] and z - opened[i][j] <= rise
        surface = opened
        if width * cell >= widest:
            break
        before, width = width, 2 * width - 1
    surface = filled(grid, is_ground)
    closed = filtered(filtered(surface, 3, max), 3, min)
    return [
        [c if c - z > 0.5 else z for c, z in zip(*rows, strict=True)]
        for rows in zip(closed, surface, strict=True)
    ]


def ground_scores(  # noqa: PLR0913  all settings
    cloud: Cloud,
    height: float,
    depth_counts: float,
    sides: str,
    cell: float,
    widest: float,
    slope: float,
) -> list[float]:
    """Score the heights above the ground, between the centres of cells on straight lines."""
    west, south = (min(point[axis] for point in cloud) for axis in (0, 1))
    positions = [((x - west) / cell, (y - south) / cell) for x, y, _ in cloud]
    rows, columns = (int(max(place[axis] for place in positions)) + 1 for axis in (0, 1))
    grid = [[inf] * columns for _ in range(rows)]
    for (u, v), point in zip(positions, cloud, strict=True):
        grid[int(u)][int(v)] = min(grid[int(u)][int(v)], point[2])
    known = [[z < inf for z in row] for row in grid]
    surface = ground(filled(grid, known), cell, widest, slope)
    found = []
    for (u, v), point in zip(positions, cloud, strict=True):
        crossed = {
            j: on_line({i: surface[i][j] for i in range(rows)}, u - 0.5) for j in range(columns)
        }
        above = point[2] - on_line(crossed, v - 0.5)
        below = -depth_counts * above
        found.append({'high': above, 'low': below, 'both': max(above, below)}[sides] / height)
    return found
