# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the scan line of a point says of it: steps, predictions, and what is usual around it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.kernels.kernels import inner_kernel, kernel
from lidar_outlier_filter.core.kernels.lanes import LANES, fill, network, sort

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Bools, Floats, Ints

WINDOW = 8  # points of the line on either side that show what is usual
ALL = network(2 * WINDOW, range(2 * WINDOW))


@kernel
def follow(
    begin: int,
    end: int,
    wanted: Bools,
    xyz: Floats,
    t: Ints,
    before: Ints,
    after: Ints,
    step: Floats,
    along: Floats,
) -> None:
    """Measure steps and predictions of a range of points, which are sorted by line and time.

    Writes the distance to the nearer of the two neighbours in the segment; and the smallest of the
    differences from three predictions, each divided by what the noise of its two points adds: from
    the two in front, the two behind, and from one on either side. inf where there is none. Nothing
    is written of points that are in the window of no wanted one.
    """
    asked = _around(wanted, begin, end)
    for i in range(begin, end):
        if not asked[i - begin]:
            continue
        a, b = before[i], after[i]
        nearer = best = np.inf
        if a >= 0:
            nearer = _gap(xyz, i, a)
            if before[a] >= 0:
                best = _difference(xyz, t, i, a, before[a])
        if b >= 0:
            nearer = min(nearer, _gap(xyz, i, b))
            if after[b] >= 0:
                best = min(best, _difference(xyz, t, i, b, after[b]))
        if a >= 0 and b >= 0:
            best = min(best, _difference(xyz, t, i, a, b))
        step[i], along[i] = nearer, best


@inner_kernel
def _around(wanted: Bools, begin: int, end: int) -> Bools:
    """Return of a range of points which are up to WINDOW returns away from a wanted one."""
    result = np.zeros(end - begin, np.bool_)
    done = begin
    for i in range(max(begin - WINDOW, 0), min(end + WINDOW, len(wanted))):
        if wanted[i]:
            for j in range(max(done, i - WINDOW), min(i + WINDOW + 1, end)):
                result[j - begin] = True
            done = max(done, i + WINDOW + 1)
    return result


@inner_kernel
def _gap(xyz: Floats, i: int, j: int) -> float:
    x, y, z = xyz[j, 0] - xyz[i, 0], xyz[j, 1] - xyz[i, 1], xyz[j, 2] - xyz[i, 2]
    return float(np.sqrt((x * x + y * y) + z * z))


@inner_kernel
def _difference(xyz: Floats, t: Ints, i: int, j: int, k: int) -> float:
    """Measure how far a point is from the straight way through two others, at its own time."""
    span = t[k] - t[j]
    if span == 0:
        return np.inf
    part = (t[i] - t[j]) / span
    total = 0.0
    for axis in range(3):
        first, second = xyz[j, axis] - xyz[i, axis], xyz[k, axis] - xyz[i, axis]
        value = (1 - part) * first + part * second
        total += value * value
    return float(np.sqrt(total / (1 + (1 - part) ** 2 + part * part)))


@kernel
def usual(
    begin: int,
    end: int,
    wanted: Bools,
    first: Ints,
    values: Floats,
    back: Ints,
    result: Floats,
) -> None:
    """Write medians of the others up to WINDOW returns away in the line, for the wanted points.

    ``first`` (L + 1,) says where lines begin, and ``back`` (N,) where in the result each point is.
    Of each row of ``values`` (Q, N), infinite ones do not count; where there is no other, the
    median is the point's own value.
    """
    points = np.empty(LANES, np.int64)
    low, high, count = np.empty_like(points), np.empty_like(points), np.empty_like(points)
    near = np.empty((2 * WINDOW, LANES))
    line = np.searchsorted(first, begin, side='right') - 1
    while begin < end:
        found, begin = fill(points, wanted, begin, end)
        if found == 0:
            break
        for lane in range(len(points)):
            i = points[lane]
            while i >= first[line + 1]:
                line += 1
            low[lane] = max(first[line], i - WINDOW)
            high[lane] = min(first[line + 1], i + WINDOW + 1)
        for row in range(len(values)):
            for lane in range(len(points)):
                i, c = points[lane], 0
                for j in range(low[lane], high[lane]):
                    near[c, lane] = values[row, j]
                    c += j != i and values[row, j] < np.inf
                near[c:, lane] = np.inf
                count[lane] = c
            sort(near, ALL)
            for lane in range(len(points)):
                i, c = points[lane], count[lane]
                median = (near[(c - 1) // 2, lane] + near[c // 2, lane]) / 2
                result[row, back[i]] = median if c > 0 else values[row, i]
