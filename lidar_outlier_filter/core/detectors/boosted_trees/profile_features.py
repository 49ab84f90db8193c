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

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.detectors.boosted_trees.features import PROFILE, rows
from lidar_outlier_filter.core.detectors.boosted_trees.window import (
    AROUND,
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
    TWO,
    ZERO,
    F,
)
from lidar_outlier_filter.core.detectors.boosted_trees.window_features import COUNT
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.kernels.eigen import eigen
from lidar_outlier_filter.core.kernels.kernels import (
    device_function,
    inlined_kernel,
    kernel,
    noalias_kernel,
)
from lidar_outlier_filter.core.kernels.lanes import network, sort

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.core.annotations import Bools, Floats, Index, Ints, Singles
    from lidar_outlier_filter.core.detectors.boosted_trees.window import (
        PatternWindow,
        Prepared,
    )
    from lidar_outlier_filter.core.scan_pattern.placed_pattern import Pattern

ROW = rows(PROFILE, COUNT)
PAIRS = OWN + RINGS * AROUND
MAX_OFF_SIGMAS = F(3.5)  # standard deviations up to which a pair is right
MISSING = F(1e6)  # behind all others
ALL = network(PAIRS, range(PAIRS))
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
    _predict_own(prepared.pattern, line, window, pairs)
    _predict_other(prepared.pattern, line, window, pairs)
    _write_right(pairs, values[ROW.agree])
    sort(pairs, ALL)
    _write_median(pairs, values[ROW.middle])
    _write_groups(prepared.groups, window.positions, values)


@noalias_kernel
def _write_groups(groups: Singles, positions: Ints, values: Singles) -> None:
    """Write the features of the groups of points."""
    for row in range(len(groups)):
        for lane in range(len(positions)):
            values[ROW.group + row, lane] = groups[row, positions[lane]]


@noalias_kernel
def _predict_own(pattern: Pattern, line: int, window: PatternWindow, pairs: Singles) -> None:
    """Write by how much pairs of the line predict a longer range, in σ, plus ``MAX_VALUE``."""
    square, mine, own = window.square, window.mine, window.own
    sigma = HALF * pattern.noise[line]
    for m in range(OWN):
        a, b, row = OWN - 1 - m, OWN + m, pairs[m]
        before, after = own[OWN_RANGES + a], own[OWN_RANGES + b]
        for lane in range(len(row)):
            r = mine[RANGE, lane]
            pa, pb = own[OWN_PHASES + a, lane], own[OWN_PHASES + b, lane]
            good = (square[a, lane] < FAR) & (square[b, lane] < FAR) & (pb > pa)
            part = -pa / (pb - pa if good else ONE)
            value = (ONE - part) / before[lane] + part / after[lane]
            # Of a plane, the inverse range is a sine: between two others it is more than a line.
            off = (r * value - ONE - HALF * pa * pb) * r / sigma
            row[lane] = min(max(off, -MAX_VALUE), MAX_VALUE) + MAX_VALUE if good else MISSING


@noalias_kernel
def _predict_other(pattern: Pattern, line: int, window: PatternWindow, pairs: Singles) -> None:
    """Write the same of pairs of lines before and after."""
    square, away = window.square, window.away
    reach, sigma = window.mine[RANGE], HALF * pattern.noise[line]
    for ring in range(RINGS):
        for m in range(AROUND):
            a = 2 * OWN + ring * AROUND + m
            b = 2 * OWN + (2 * RINGS - 1 - ring) * AROUND + 2 * OTHER - m
            row, aside = pairs[OWN + ring * AROUND + m], F(m - OTHER) * pattern.step[line]
            curved = HALF * aside * aside
            for lane in range(len(row)):
                r = reach[lane]
                good = (square[a, lane] < FAR) & (square[b, lane] < FAR)
                value = HALF / (r + away[a, lane]) + HALF / (r + away[b, lane])
                off = (r * value - ONE + curved) * r / sigma
                row[lane] = min(max(off, -MAX_VALUE), MAX_VALUE) + MAX_VALUE if good else MISSING


@noalias_kernel
def _write_right(pairs: Singles, row: Singles) -> None:
    """Write the share of the pairs that predict the range."""
    for lane in range(len(row)):
        right = count = ZERO
        for m in range(len(pairs)):
            count += ONE if pairs[m, lane] < MISSING else ZERO
            right += ONE if abs(pairs[m, lane] - MAX_VALUE) < MAX_OFF_SIGMAS else ZERO
        row[lane] = right / count if count > ZERO else -ONE


@noalias_kernel
def _write_median(pairs: Singles, row: Singles) -> None:
    """Write the median of the valid pairs, which are sorted, less ``MAX_VALUE``; 0 for none."""
    for lane in range(len(row)):
        count = 0
        for m in range(len(pairs)):
            count += pairs[m, lane] < MISSING
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

    def find(n: int, _end: int) -> tuple[Ints, Singles]:
        segments = find_segments(pattern, REACHES[n])
        group = join(pattern, near, REACHES[n], segments)
        positions = np.flatnonzero(segments.of >= 0)
        positions = positions[group[segments.of[positions]] >= 0]
        of_groups = _describe(*_moments(pattern, positions, group[segments.of[positions]]))
        return positions, of_groups[:, group[segments.of[positions]]]

    # The wide groups last, so that they are what stays.
    for positions, described in reversed(pool.run(find, len(REACHES), 1, threads)):
        out[:, positions] = described
    return out


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


def join(pattern: Pattern, near: Index, reach: float, segments: Segments) -> Index:
    """Return the number of the free group that each segment is in, from 0; -1 for none."""
    root, tied = _tie(pattern, near, reach, segments)
    while (root[root] != root).any():
        root = root[root]
    size = np.bincount(root, segments.size, len(root))
    held = np.bincount(root, tied | (segments.size > MAX_SEGMENT), len(root)) > 0
    # The first segment of a group is its root.
    free = (root == np.arange(len(root))) & ~held & (size >= MIN_GROUP_RETURNS)
    number = np.full(len(root), -1, np.int32)
    number[free] = np.arange(np.count_nonzero(free))
    return number[root]


@kernel
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


def _moments(pattern: Pattern, positions: Ints, group: Index) -> tuple[Ints, Floats, Floats]:
    """Return the number of returns of G groups, and two second moments of them, (3, 3, G), m².

    These are of all returns; and of the mean of each line's, as often as it saw the group.
    """
    groups = int(group.max(initial=-1)) + 1
    line = np.searchsorted(pattern.last, positions, side='right')
    seen, pair, size = np.unique(line * groups + group, return_inverse=True, return_counts=True)
    xyz = np.stack([pattern.x, pattern.y, pattern.z])[:, positions]
    count = np.bincount(group, minlength=groups)
    of_lines = np.stack([np.bincount(pair, row, len(seen)) for row in xyz])
    mean = np.stack([np.bincount(group, row, groups) for row in xyz]) / count
    moments = np.empty((2, 3, 3, groups))
    for i in range(3):
        for j in range(3):
            square, outer = xyz[i] * xyz[j], of_lines[i] * of_lines[j] / size
            moments[0, i, j] = np.bincount(group, square, groups) / count - mean[i] * mean[j]
            outer = np.bincount(seen % max(groups, 1), outer, groups)
            moments[1, i, j] = outer / count - mean[i] * mean[j]
    return count, moments[0], moments[1]


def _describe(count: Ints, of_all: Floats, of_lines: Floats) -> Singles:
    """Return the features ``GROUPS`` of each group, (5, G)."""
    moments = np.ascontiguousarray(np.moveaxis(of_all, 2, 0))
    vectors = np.empty_like(moments)
    _turn(moments, vectors)
    values, every = np.diagonal(moments, axis1=1, axis2=2), np.arange(len(count))
    long = values.argmax(axis=1)
    along = vectors[every, :, long].T
    _, middle, most = np.maximum(np.sort(values, axis=1), TINY).T
    # One product after the other: a group's sum depends on no other group.
    advance = np.zeros(len(count))
    for i in range(3):
        for j in range(3):
            advance += along[i] * of_lines[i, j] * along[j]
    rows = (
        *(count, np.abs(along[2]), np.sqrt(middle / most)),
        *(np.sqrt(np.maximum(advance, 0.0) / most), UNIFORM * np.sqrt(most)),
    )
    return np.stack(rows).astype(np.float32)


@kernel
def _turn(moments: Floats, vectors: Floats) -> None:
    """Turn each of some moments (G, 3, 3) into its principal axes, the columns of ``vectors``."""
    for g in range(len(moments)):
        eigen(moments[g], vectors[g], 3)
