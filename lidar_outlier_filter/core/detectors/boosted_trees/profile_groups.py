# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Small things that float free, found in the scan pattern of a profile scanner.

Returns that follow each other closely are a segment of their line. Segments of more than ``LARGE``
returns are surfaces. Smaller ones that are close to each other on lines beside are a group, and a
group is free unless it is close to a surface. An arm that moves while the scanner passes is such a
group, straight and slanted; a pole stands on the road, and upright. z must be up.

Returns are joined twice: widely, so that a group stays whole, and narrowly, so that it comes free
of a car that it nearly touches.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.detectors.boosted_trees.features import PROFILE
from lidar_outlier_filter.core.detectors.boosted_trees.window import OTHER, RINGS
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.kernels.jacobi import eigen
from lidar_outlier_filter.core.kernels.kernels import inner_kernel, kernel
from lidar_outlier_filter.core.scan_pattern.placed_pattern import lines_at_once

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Bools, Floats, Index, Singles
    from lidar_outlier_filter.core.scan_pattern.placed_pattern import Pattern

GROUPS = tuple(name for name in PROFILE if name.startswith('group'))
REACHES = (4.0, 1.6)  # × what beams are apart: up to which returns are joined
LARGE = 40  # returns of a segment: more are a surface
SMALLEST = 6  # returns of a group
MOMENTS = 16  # sums of a group: its returns; x, y, z; their six products; the same of its lines
NONE = np.float32(-1.0)
COUNT = len(GROUPS)
UNIFORM = np.sqrt(12.0)  # length of an even row ÷ its standard deviation
TINY = 1e-12  # m²


class Segments(NamedTuple):
    """The segments of all lines, numbered from 0.

    Attributes
    ----------
    of : (M,) int32
        The segment of each place; -1 where there is no point.
    size : (S,) int32
        How many returns each has.

    """

    of: Index
    size: Index


def find_groups(pattern: Pattern, near: Index, threads: int = 0) -> Singles:
    """Describe the free group that each point is in.

    Parameters
    ----------
    pattern : of the points, in M places
    near : (4, M) the nearest place on each line beside
    threads : at most so many at once; 0 for as many as there are cores

    Returns
    -------
    (5, M) float32
        Of ``GROUPS``; of the wide group, where there is one.

    """
    out = np.full((len(GROUPS), len(pattern.order)), NONE)
    found = pool.run(lambda n, _: _find(pattern, near, REACHES[n]), len(REACHES), 1, threads)

    def write(begin: int, end: int) -> None:
        # The wide groups last, so that they are what stays.
        for segments, group, of_groups in reversed(found):
            _write(pattern, segments, group, of_groups, begin, end, out)

    lines = len(pattern.first)
    pool.run(write, lines, lines_at_once(lines, len(pattern.order)), threads)
    return out


def _find(pattern: Pattern, near: Index, reach: float) -> tuple[Segments, Index, Singles]:
    """Return all segments, the free group of each, and what is said of each group."""
    segments = find_segments(pattern, reach)
    group = join(pattern, near, reach, segments)
    sums = _sum_up(pattern, segments, group, int(group.max(initial=-1)) + 1)
    return segments, group, _describe(sums)


@kernel
def find_segments(pattern: Pattern, reach: float) -> Segments:
    """Find the segments of all lines, one after the other."""
    of = np.full(len(pattern.order), -1, np.int32)
    size = np.zeros(len(pattern.order), np.int32)
    count = 0
    for line in range(len(pattern.first)):
        low = pattern.first[line]
        for k in range(low, pattern.last[line]):
            if k == low or not _is_close(pattern, line, k, k - 1, reach):
                count += 1
            of[k] = count - 1
            size[count - 1] += 1
    return Segments(of, size[:count].copy())


@inner_kernel
def _is_close(pattern: Pattern, line: int, k: int, j: int, reach: float) -> bool:
    """Return whether place j is within reach of place k, which is of the line."""
    most = reach * (pattern.range[k] * pattern.gap[line] + pattern.apart[line])
    x, y, z = pattern.x[k] - pattern.x[j], pattern.y[k] - pattern.y[j], pattern.z[k] - pattern.z[j]
    return bool(x * x + y * y + z * z <= most * most)


@kernel
def join(pattern: Pattern, near: Index, reach: float, segments: Segments) -> Index:
    """Return the number of the free group that each segment is in, from 0; -1 for none."""
    of, size = segments.of, segments.size
    root, tied = np.arange(len(size)), np.zeros(len(size), np.bool_)
    for line in range(len(pattern.first)):
        for k in range(pattern.first[line], pattern.last[line]):
            if size[of[k]] > LARGE:
                continue
            for ring in range(2 * RINGS):
                for m in range(-OTHER, OTHER + 1):
                    j = near[ring, k] + m
                    # Most are joined already, which is seen faster than measured.
                    if of[j] < 0 or root[of[j]] == root[of[k]]:
                        continue
                    large = size[of[j]] > LARGE
                    if (large and tied[of[k]]) or not _is_close(pattern, line, k, j, reach):
                        continue
                    if large:
                        tied[of[k]] = True
                    else:
                        a, b = _root(root, of[k]), _root(root, of[j])
                        root[max(a, b)] = min(a, b)
    return _number(root, tied, segments)


@inner_kernel
def _root(root: NDArray[np.int64], i: int) -> int:
    while root[i] != i:
        root[i] = root[root[i]]
        i = root[i]
    return int(i)


@inner_kernel
def _number(root: NDArray[np.int64], tied: Bools, segments: Segments) -> Index:
    """Give a number to each free group that is large enough."""
    count, size = np.zeros(len(root), np.int64), segments.size
    for s in range(len(root)):
        r = _root(root, s)
        count[r] += size[s]
        tied[r] |= tied[s] or size[s] > LARGE
    number = np.full(len(root), -1, np.int32)
    total = 0
    for s in range(len(root)):
        r = _root(root, s)
        if tied[r] or count[r] < SMALLEST:
            continue
        # The first segment of a group is its root.
        if r == s:
            number[s] = total
            total += 1
        else:
            number[s] = number[r]
    return number


@kernel
def _sum_up(pattern: Pattern, segments: Segments, group: Index, count: int) -> Floats:
    """Sum up the coordinates of groups: of all returns, and of the means of lines, (16, G)."""
    sums, line_sums = np.zeros((MOMENTS, count)), np.zeros((4, count))
    last = np.full(count, -1)
    for line in range(len(pattern.first)):
        for k in range(pattern.first[line], pattern.last[line]):
            g = group[segments.of[k]]
            if g < 0:
                continue
            if last[g] != line:
                _close_line(line_sums, g, sums)
                last[g] = line
            x, y, z = float(pattern.x[k]), float(pattern.y[k]), float(pattern.z[k])
            sums[0, g] += 1.0
            line_sums[0, g] += 1.0
            for axis, value in enumerate((x, y, z)):
                sums[1 + axis, g] += value
                line_sums[1 + axis, g] += value
            for row, value in enumerate((x * x, y * y, z * z, x * y, x * z, y * z)):
                sums[4 + row, g] += value
    for g in range(count):
        _close_line(line_sums, g, sums)
    return sums


@inner_kernel
def _close_line(line_sums: Floats, g: int, sums: Floats) -> None:
    """Add the mean of what a line saw of a group, as often as it saw it, and begin anew."""
    n, x, y, z = line_sums[0, g], line_sums[1, g], line_sums[2, g], line_sums[3, g]
    if n > 0.0:
        for row, value in enumerate((x * x, y * y, z * z, x * y, x * z, y * z)):
            sums[10 + row, g] += value / n
    line_sums[:, g] = 0.0


@kernel
def _describe(sums: Floats) -> Singles:
    """Return what ``GROUPS`` says of each group, (5, G)."""
    found = np.empty((COUNT, sums.shape[1]), np.float32)
    moment, vectors = np.empty((3, 3)), np.empty((3, 3))
    for g in range(sums.shape[1]):
        count = sums[0, g]
        for i in range(3):
            for j in range(3):
                moment[i, j] = _moment(sums, 4, g, i, j)
        eigen(moment, vectors, 3)
        long = 0
        for i in range(1, 3):
            if moment[i, i] > moment[long, long]:
                long = i
        one, other = (long + 1) % 3, (long + 2) % 3
        most = max(moment[long, long], TINY)
        middle = max(moment[one, one], moment[other, other], TINY)
        advance = 0.0
        for i in range(3):
            for j in range(3):
                advance += vectors[i, long] * _moment(sums, 10, g, i, j) * vectors[j, long]
        found[0, g], found[1, g] = count, abs(vectors[2, long])
        found[2, g] = np.sqrt(middle / most)
        found[3, g] = np.sqrt(max(advance, 0.0) / most)
        found[4, g] = UNIFORM * np.sqrt(most)
    return found


@inner_kernel
def _moment(sums: Floats, first: int, g: int, i: int, j: int) -> float:
    """Return the mean of a product of coordinates, less that of the means; sums from a row on."""
    count, row = sums[0, g], i if i == j else 2 + i + j
    return float(sums[first + row, g] / count - sums[1 + i, g] / count * (sums[1 + j, g] / count))


@kernel
def _write(
    pattern: Pattern,
    segments: Segments,
    group: Index,
    of_groups: Singles,
    begin: int,
    end: int,
    out: Singles,
) -> None:
    """Write what is said of the groups of lines begin to end."""
    of = segments.of  # once, because every time its references are counted
    for line in range(begin, end):
        for k in range(pattern.first[line], pattern.last[line]):
            g = group[of[k]]
            if g >= 0:
                for f in range(len(out)):
                    out[f, k] = of_groups[f, g]
