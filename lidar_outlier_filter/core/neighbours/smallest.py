# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The k smallest of some hundred distances, without branches that nobody could predict.

First a limit is found that has at least k of them, and not many more, below it: counting is what a
processor does fastest, several at a stroke. Then the few below are sorted, by counting again.
"""

from __future__ import annotations

import numpy as np

from lidar_outlier_filter.core.annotations import Floats, Ints
from lidar_outlier_filter.core.kernels.kernels import kernel, noalias_kernel

STROKE = 16  # distances are padded with inf to a multiple of it: loops without a remainder
SURPLUS = 12  # distances that may be sorted although they are not among the k smallest
STEPS = 16  # towards the limit; ties may make it impossible
RANKED = 128  # up to here counting smaller ones is faster than to sort


@kernel
def padded(count: int) -> int:
    """Round up to whole strokes."""
    return (count + STROKE - 1) // STROKE * STROKE


@kernel
def count_up_to(distance: Floats, size: int, limit: float) -> int:
    """Count those of the first ``size`` distances that are not greater than the limit."""
    count = 0
    for i in range(size):
        count += distance[i] <= limit
    return count


@kernel
def tighten(
    distance: Floats, size: int, k: int, guess: float, upper: float, upper_count: int
) -> float:
    """Find a limit with at least k distances up to it, and not many more, if there is one.

    ``upper`` is a limit with at least k, and ``upper_count`` how many. Around a point of a surface
    their number grows like the squared distance, so the next limit is interpolated.
    """
    lower, lower_count, limit = 0.0, 0, guess
    for _ in range(STEPS):
        if upper_count <= k + SURPLUS:
            break
        if not lower < limit < upper:
            share = (k + SURPLUS / 2 - lower_count) / (upper_count - lower_count)
            limit = lower + share * (upper - lower)
            if not lower < limit < upper:
                break
        count = count_up_to(distance, size, limit)
        if count >= k:
            upper, upper_count = limit, count
        else:
            lower, lower_count = limit, count
    return upper


@kernel
def enough(distance: Floats, count: int, k: int, limit: float) -> float:
    """Find a limit, not much further, up to which there are at least k distances.

    Fewer than k are up to the limit given, and at least k of the ``count`` distances are finite.
    """
    furthest = 0.0
    for i in range(count):
        if furthest < distance[i] < np.inf:
            furthest = distance[i]
    return tighten(distance, count, k, 2 * limit, furthest, count)


@kernel
def choose(
    distance: Floats, index: Ints, count: int, limit: float, few: Floats, few_index: Ints
) -> int:
    """Copy the distances up to the limit, and their indices; return how many there are."""
    chosen = 0
    for i in range(count):
        few_index[chosen] = i
        chosen += distance[i] <= limit
    for i in range(chosen):
        which = few_index[i]
        few[i], few_index[i] = distance[which], index[which]
    return chosen


@kernel
def sort(
    order: Ints, few: Floats, few_index: Ints, count: int, best: Floats, best_index: Ints
) -> None:
    """Sort distances, and equal ones by the ``order`` of their indices.

    There must be three more entries, and ``few`` is padded.
    """
    if count > RANKED or not _rank(few, few_index, count, best, best_index):
        _sort(order, few, few_index, count, best, best_index)


@noalias_kernel
def _rank(few: Floats, few_index: Ints, count: int, best: Floats, best_index: Ints) -> bool:
    """Sort by counting for each of the few how many are nearer; False, and unsorted, with ties.

    Four at once, because loading costs more than comparing.
    """
    size = (count + 3) // 4 * 4
    for i in range(count, size):
        few[i] = np.inf
    total = 0
    for i in range(0, size, 4):
        a, b, c, d = few[i], few[i + 1], few[i + 2], few[i + 3]
        rank_a = rank_b = rank_c = rank_d = 0
        for j in range(size):
            other = few[j]
            rank_a += other < a
            rank_b += other < b
            rank_c += other < c
            rank_d += other < d
        best[rank_d], best_index[rank_d] = d, few_index[i + 3]
        best[rank_c], best_index[rank_c] = c, few_index[i + 2]
        best[rank_b], best_index[rank_b] = b, few_index[i + 1]
        best[rank_a], best_index[rank_a] = a, few_index[i]
        total += rank_a + rank_b + rank_c + rank_d
    # The ranks are 0, 1, 2 … if no two are equal, and that of padding is the count.
    return total == count * (count - 1) // 2 + (size - count) * count


@noalias_kernel
def _sort(order: Ints, few: Floats, few_index: Ints, count: int, best: Floats, index: Ints) -> None:
    """Sort by distance, then index: Shell's sort with Knuth's steps."""
    for i in range(count):
        best[i], index[i] = few[i], few_index[i]
    step = 1
    while step < count // 3:
        step = 3 * step + 1
    while step > 0:
        for i in range(step, count):
            d, p, j = best[i], index[i], i
            while j >= step and (
                best[j - step] > d or (best[j - step] == d and order[index[j - step]] > order[p])
            ):
                best[j], index[j] = best[j - step], index[j - step]
                j -= step
            best[j], index[j] = d, p
        step //= 3
