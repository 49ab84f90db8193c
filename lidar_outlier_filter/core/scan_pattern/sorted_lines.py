# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Returns of scan lines sorted by phase: the angle that the head, or the mirror, has turned."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.kernels.kernels import inner_kernel, kernel

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Floats, Ints, Singles

MOST_MOVES = 16  # for each return of a line, one by one; beyond, the line is merged
SAME_SHOT = 2e-5  # rad: nearer than that, two returns of a ring are of one beam


class OrderedLines(NamedTuple):
    """Points as given, and their order by line.

    Attributes
    ----------
    xyz, distance : (N, 3), (N,) float64
        As given, metres.
    order : (N,) int64
        The index, as given, of each point sorted by line.
    first : (L + 1,) int64
        Where each line begins in the order.

    """

    xyz: Floats
    distance: Floats
    order: Ints
    first: Ints


@kernel
def sort_lines(lines: OrderedLines, begin: int, end: int, phase: Floats, up: Floats) -> None:
    """Sort each line by phase; of one phase, by range and position, whatever the order given.

    Lines are nearly sorted, where the head turns steadily: then few returns move, and not far.
    """
    order, first = lines.order, lines.first
    for line in range(begin, end):
        low, high = first[line], first[line + 1]
        left = MOST_MOVES * (high - low)
        for k in range(low + 1, high):
            if phase[k] > phase[k - 1]:
                continue
            m = k
            while m > low and _is_before(lines, phase, m, m - 1):
                phase[m], phase[m - 1] = phase[m - 1], phase[m]
                order[m], order[m - 1] = order[m - 1], order[m]
                up[m], up[m - 1] = up[m - 1], up[m]
                m -= 1
            left -= k - m
            if left < 0:
                _merge(lines, low, high, phase, up)
                break


@kernel
def join_shots(lines: OrderedLines, begin: int, end: int, phase: Floats, up: Floats) -> None:
    """Give all returns of a shot the phase of the first; sort them by range and position."""
    order, first = lines.order, lines.first
    for line in range(begin, end):
        start = first[line]
        for k in range(first[line] + 1, first[line + 1]):
            if phase[k] - phase[start] >= SAME_SHOT:
                start = k
                continue
            phase[k] = phase[start]
            m = k
            while m > start and _is_before(lines, phase, m, m - 1):
                order[m], order[m - 1] = order[m - 1], order[m]
                up[m], up[m - 1] = up[m - 1], up[m]
                m -= 1


@inner_kernel
def _merge(lines: OrderedLines, low: int, high: int, phase: Floats, up: Floats) -> None:
    """Sort one line, whatever its order; what is equal stays in its order."""
    count, size = high - low, 1
    rank, merged = np.empty(count, np.int64), np.empty(count, np.int64)
    for k in range(count):
        rank[k] = low + k
    while size < count:
        for begin in range(0, count, 2 * size):
            middle, end = min(begin + size, count), min(begin + 2 * size, count)
            i, j = begin, middle
            for k in range(begin, end):
                if j >= end or (i < middle and not _is_before(lines, phase, rank[j], rank[i])):
                    merged[k] = rank[i]
                    i += 1
                else:
                    merged[k] = rank[j]
                    j += 1
        rank, merged = merged, rank
        size *= 2
    turned, sine = np.empty(count), np.empty(count)
    for k in range(count):
        merged[k], turned[k], sine[k] = lines.order[rank[k]], phase[rank[k]], up[rank[k]]
    for k in range(count):
        lines.order[low + k], phase[low + k], up[low + k] = merged[k], turned[k], sine[k]


@inner_kernel
def _is_before(lines: OrderedLines, phase: Floats, a: int, b: int) -> bool:
    if phase[a] != phase[b]:
        return bool(phase[a] < phase[b])
    xyz, distance, order, _ = lines
    i, j = order[a], order[b]
    if distance[i] != distance[j]:
        return bool(distance[i] < distance[j])
    for axis in range(3):
        if xyz[i, axis] != xyz[j, axis]:
            return bool(xyz[i, axis] < xyz[j, axis])
    return False


@kernel
def find_copies(lines: OrderedLines, phase: Floats, intensity: Singles, original: Ints) -> int:
    """Write which return each sorted one is a copy of, or its own index; count the copies.

    Of several at one place the brightest is the original, so that the order given does not matter.
    """
    xyz, _, order, first = lines
    count = 0
    for line in range(len(first) - 1):
        begin = first[line]
        for k in range(first[line], first[line + 1]):
            original[k] = order[k]
            i, j = order[k], order[begin]
            same = k > begin and phase[k] == phase[begin]
            for axis in range(3):
                same &= xyz[i, axis] == xyz[j, axis]
            if not same:
                begin = k
                continue
            count += 1
            best = original[begin]
            if len(intensity) > 0 and intensity[i] > intensity[best]:
                best = i
            original[begin : k + 1] = best
    return count
