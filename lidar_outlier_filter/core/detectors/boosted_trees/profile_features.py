# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Features of profile scanners alone: predictions by pairs of returns, and free groups.

Two returns of the window that lie opposite each other predict the range between them: those as many
positions before and after in the line, and those of lines before and after. On a surface all pairs
agree, and so do all about a point that is off it.

Returns that follow each other closely are a segment of their line. Segments of more than
``MAX_SEGMENT`` returns are surfaces. Smaller ones that are close to each other on neighbouring
lines are a group, and a group is free unless it is close to a surface. An arm that moves while the
scanner passes is such a group, straight and slanted; a pole stands on the road, and upright. z must
be up. Returns are joined twice: widely, so that a group stays whole, and narrowly, so that a group
separates from a car that it nearly touches.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Bools, Floats, Index, Ints, Singles
from lidar_outlier_filter.core.detectors.boosted_trees.features import PROFILE, rows
from lidar_outlier_filter.core.detectors.boosted_trees.window import (
    AROUND,
    COUNT,
    FAR,
    HALF,
    MAX_VALUE,
    ONE,
    OTHER,
    OWN,
    OWN_PHASES,
    OWN_RANGES,
    RANGE,
    RINGS,
    SIZE,
    TWO,
    ZERO,
    F,
    PatternWindow,
    Prepared,
)
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.kernels.eigen import eigen
from lidar_outlier_filter.core.kernels.kernels import (
    device_function,
    inlined_kernel,
    kernel,
    noalias_kernel,
)
from lidar_outlier_filter.core.kernels.lanes import LANES, network, sort
from lidar_outlier_filter.core.kernels.vectors import (
    WIDTH,
    count,
    follow,
    least,
    load,
    most,
    no_counts,
    select,
    single,
    store,
    take,
)
from lidar_outlier_filter.core.scan_pattern.placed_pattern import Pattern

ROW = rows(PROFILE, COUNT)
PAIRS = OWN + RINGS * AROUND
MAX_OFF_SIGMAS = F(3.5)  # standard deviations up to which a pair is right
MISSING = F(1e6)  # behind all others
LOWER_HALF = network(PAIRS, range(PAIRS // 2 + 1))  # where the median is, of any number
GROUPS = tuple(name for name in PROFILE if name.startswith('group'))
REACHES = (4.0, 1.6)  # × what beams are apart: up to which returns are joined
MAX_SEGMENT = 40  # returns of a segment: more are a surface
MIN_GROUP_RETURNS = 6  # returns of a group
NO_GROUP = np.float32(-1.0)
UNIFORM = np.sqrt(12.0)  # length of an even row ÷ its standard deviation
TINY = 1e-12  # m²


@inlined_kernel
def write_profile(
    prepared: Prepared, line: int, window: PatternWindow, pairs: Singles, values: Singles
) -> None:
    """Write the features of the points of gathered windows, behind those that all sensors have."""
    for lane in range(0, LANES, WIDTH):
        _predict(prepared.pattern, line, lane, window, pairs, values)
        _copy_groups(prepared.groups, window.positions, lane, values)
    sort(pairs, LOWER_HALF)
    _write_median(pairs, values[ROW.middle])


@noalias_kernel
def _predict(
    pattern: Pattern, line: int, lane: int, window: PatternWindow, pairs: Singles, values: Singles
) -> None:
    """Write by how much pairs predict a longer range, in σ, plus ``MAX_VALUE``, from a lane on.

    And the share of them that are right; their number is where their median will be.
    """
    square, away, own = window.square, window.away, window.own
    r, sigma = load(window.mine[RANGE], lane), HALF * pattern.noise[line]
    there, right = no_counts(), no_counts()
    for m in range(PAIRS):
        # Before and after in the line; then in the lines before and after.
        a, b = (OWN - 1 - m, OWN + m) if m < OWN else (OWN + m, SIZE - 1 + OWN - m)
        a, b = a * LANES + lane, b * LANES + lane
        good = (load(square, a) < FAR) & (load(square, b) < FAR)
        if m < OWN:
            pa, pb = load(own, OWN_PHASES * LANES + a), load(own, OWN_PHASES * LANES + b)
            good = good & (pb > pa)
            part = (ZERO - pa) / select(good, pb - pa, ONE)
            before, after = load(own, OWN_RANGES * LANES + a), load(own, OWN_RANGES * LANES + b)
            value = (ONE - part) / before + part / after
            # Of a plane, the inverse range is a sine: between two others it is more than a line.
            off = r * value - ONE - HALF * pa * pb
        else:
            aside = F((m - OWN) % AROUND - OTHER) * pattern.step[line]
            value = HALF / (r + load(away, a)) + HALF / (r + load(away, b))
            off = r * value - ONE + HALF * aside * aside
        off = least(most(off * r / sigma, -MAX_VALUE), MAX_VALUE) + MAX_VALUE
        store(pairs, m * LANES + lane, select(good, off, MISSING))
        right = count(right, good & (abs(off - MAX_VALUE) < MAX_OFF_SIGMAS))
        there = count(there, good)
    store(values, ROW.middle * LANES + lane, single(there))
    share = single(right) / most(single(there), ONE)
    store(values, ROW.agree * LANES + lane, select(single(there) > ZERO, share, -ONE))


@noalias_kernel
def _copy_groups(groups: Singles, positions: Ints, lane: int, values: Singles) -> None:
    """Write the features of the groups of points, from a lane on."""
    in_step = follow(load(positions, lane))
    for row in range(len(groups)):
        group = take(groups[row], positions, lane, 0, in_step)
        store(values, (ROW.group + row) * LANES + lane, group)


@noalias_kernel
def _write_median(pairs: Singles, row: Singles) -> None:
    """Write the median of pairs, which are sorted, less ``MAX_VALUE``; 0 for none."""
    for lane in range(len(row)):
        count = int(row[lane])
        low, high = pairs[max(count - 1, 0) // 2, lane], pairs[count // 2, lane]
        row[lane] = (low + high) / TWO - MAX_VALUE if count > 0 else ZERO


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
    pattern : of the points, in M positions
    near : (4, M) the nearest place on each line beside
    threads : maximum number of threads; 0: all cores

    Returns
    -------
    (5, M) float32
        Of ``GROUPS``; of the wide group, where there is one.

    """
    out = np.full((len(GROUPS), len(pattern.order)), NO_GROUP)

    def find(n: int, _end: int) -> tuple[Index, Index, Singles]:
        segments = find_segments(pattern, REACHES[n])
        group = join(pattern, near, REACHES[n], segments)
        return segments.of, group, _describe(pattern, segments.of, group)

    # The wide groups last, so that they are what stays.
    for found in reversed(pool.run(find, len(REACHES), 1, threads)):
        _write_groups(pattern, *found, out)
    return out


@kernel
def _write_groups(
    pattern: Pattern, of: Index, group: Index, described: Singles, out: Singles
) -> None:
    for line in range(len(pattern.first)):
        for k in range(pattern.first[line], pattern.last[line]):
            if group[of[k]] >= 0:
                out[:, k] = described[:, group[of[k]]]


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


@device_function
def _is_close(pattern: Pattern, line: int, k: int, j: int, reach: float) -> bool:
    """Return whether place j is within reach of place k, which is of the line."""
    most = reach * (pattern.range[k] * pattern.gap[line] + pattern.apart[line])
    x, y, z = pattern.x[k] - pattern.x[j], pattern.y[k] - pattern.y[j], pattern.z[k] - pattern.z[j]
    return bool(x * x + y * y + z * z <= most * most)


@kernel
def join(pattern: Pattern, near: Index, reach: float, segments: Segments) -> Index:
    """Return the number of the free group that each segment is in, from 0; -1 for none."""
    root, held = _tie(pattern, near, reach, segments)
    size, count = np.zeros(len(root), np.int64), 0
    for s in range(len(root)):
        root[s] = _root(root, s)
        size[root[s]] += segments.size[s]
        held[root[s]] |= held[s] or segments.size[s] > MAX_SEGMENT
    number = np.full(len(root), -1, np.int32)
    for s in range(len(root)):
        # The first segment of a group is its root.
        if root[s] == s and not held[s] and size[s] >= MIN_GROUP_RETURNS:
            number[s] = count
            count += 1
        number[s] = number[root[s]]
    return number


@device_function
def _tie(
    pattern: Pattern, near: Index, reach: float, segments: Segments
) -> tuple[NDArray[np.int64], Bools]:
    """Join segments that are close: return another one of each one's group, and what is tied."""
    of, size = segments.of, segments.size
    root, tied = np.arange(len(size)), np.zeros(len(size), np.bool_)
    for line in range(len(pattern.first)):
        for k in range(pattern.first[line], pattern.last[line]):
            if size[of[k]] > MAX_SEGMENT:
                continue
            for ring in range(2 * RINGS):
                for m in range(-OTHER, OTHER + 1):
                    j = near[ring, k] + m
                    # Most are joined already, which is seen faster than measured.
                    if of[j] < 0 or root[of[j]] == root[of[k]]:
                        continue
                    large = size[of[j]] > MAX_SEGMENT
                    if (large and tied[of[k]]) or not _is_close(pattern, line, k, j, reach):
                        continue
                    if large:
                        tied[of[k]] = True
                    else:
                        a, b = _root(root, of[k]), _root(root, of[j])
                        root[max(a, b)] = min(a, b)
    return root, tied


@device_function
def _root(root: NDArray[np.int64], i: int) -> int:
    while root[i] != i:
        root[i] = root[root[i]]
        i = root[i]
    return int(i)


@kernel
def _describe(pattern: Pattern, of: Index, group: Index) -> Singles:
    """Return the features ``GROUPS`` of each group, (5, G)."""
    groups = group.max() + 1
    count, total, product = (
        np.zeros((2, groups)),
        np.zeros((2, groups, 3)),
        np.zeros((2, groups, 9)),
    )
    for line in range(len(pattern.first)):
        _add_line(pattern, line, of, group, (count, total, product))
    found = np.empty((len(GROUPS), groups), np.float32)
    for g in range(groups):
        mean = total[0, g] / count[0, g]
        for n in range(2):
            for i in range(9):
                product[n, g, i] = product[n, g, i] / count[0, g] - mean[i // 3] * mean[i % 3]
        found[0, g] = count[0, g]
        _describe_moments(product[:, g].copy().reshape(2, 3, 3), found[1:, g])
    return found


@device_function
def _add_line(
    pattern: Pattern, line: int, of: Index, group: Index, sums: tuple[Floats, Floats, Floats]
) -> None:
    """Sum up the returns of a line by group, and their mean as often as it saw the group."""
    count, total, product = sums
    for k in range(pattern.first[line], pattern.last[line]):
        g = group[of[k]]
        if g >= 0:
            at = pattern.x[k], pattern.y[k], pattern.z[k]
            for n in range(2):
                count[n, g] += 1
                for i in range(3):
                    total[n, g, i] += at[i]
            for i in range(9):
                product[0, g, i] += at[i // 3] * at[i % 3]
    for k in range(pattern.first[line], pattern.last[line]):
        g = group[of[k]]
        if g >= 0 and count[1, g] > 0:
            for i in range(9):
                product[1, g, i] += total[1, g, i // 3] * total[1, g, i % 3] / count[1, g]
            count[1, g], total[1, g] = 0.0, 0.0


@device_function
def _describe_moments(moments: Floats, found: Singles) -> None:
    """Write the features of a group, by second moments (2, 3, 3) of all returns, and of lines."""
    of_all, of_lines, axes = moments[0], moments[1], np.empty((3, 3))
    eigen(of_all, axes, 3)
    a, b, c = of_all[0, 0], of_all[1, 1], of_all[2, 2]
    most, middle = max(a, b, c, TINY), max(min(max(a, b), max(min(a, b), c)), TINY)
    along = axes[:, np.diag(of_all).argmax()]
    # One product after the other: a group's sum depends on no other group.
    advance = 0.0
    for i in range(3):
        for j in range(3):
            advance += along[i] * of_lines[i, j] * along[j]
    found[0], found[1] = abs(along[2]), np.sqrt(middle / most)
    found[2], found[3] = np.sqrt(max(advance, 0.0) / most), UNIFORM * np.sqrt(most)
