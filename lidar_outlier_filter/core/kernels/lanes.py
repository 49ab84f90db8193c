# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Work on several points side by side, in lanes, which a processor does at one stroke.

Arrays are [quantity, neighbour, lane], and innermost loops go over the lanes: so nothing depends on
the order in which the sums of one point are added up, and each lane gets what it would get alone.
The length of innermost loops is that of an array, because the compiler unrolls literal ones.
"""

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Ints, Singles
from lidar_outlier_filter.core.kernels.kernels import device_function, kernel

LANES = 32  # twice what compilers unroll a loop to; more would not fit into the nearest cache


def network(count: int, selected: range) -> Ints:
    """Return the pairs of rows to compare and swap, in order, that sort ``count`` rows.

    Batcher's merge exchange (Knuth 5.2.2, algorithm M), without the steps that the
    ``selected`` ranks, from 0, do not depend on: the other rows are not sorted.

    Returns
    -------
    (C, 2) int64
        The row that takes the smaller value first.

    """
    pairs = []
    top = 1 << max((count - 1).bit_length() - 1, 0)
    step = top
    while step > 0:
        size, remainder, distance = top, 0, step
        while True:
            pairs += [(i, i + distance) for i in range(count - distance) if i & step == remainder]
            if size == step:
                break
            size, remainder, distance = size // 2, step, size - step
        step //= 2
    needed, kept = set(selected), []
    for pair in reversed(pairs):
        if not needed.isdisjoint(pair):
            needed.update(pair)
            kept.append(pair)
    return np.array(kept[::-1], np.int64).reshape(-1, 2)


@device_function
def rows_of_singles(count: int) -> Singles:
    """Allocate rows of lanes, single precision, for any count: numba compiles it once."""
    return np.empty((count, LANES), np.float32)


@kernel
def next_batch(points: Ints, selected: NDArray[np.bool_], begin: int, end: int) -> tuple[int, int]:
    """Put the next selected points of a range into lanes; spare lanes repeat the last point.

    Returns the number of points, and where the next batch begins.
    """
    count = 0
    while begin < end and count < len(points):
        points[count] = begin
        count += selected[begin]
        begin += 1
    if count > 0:
        points[count:] = points[count - 1]
    return count, begin


@kernel
def sort(values: NDArray[np.floating], pairs: Ints) -> None:
    """Sort values, none negative, of each lane by the rows of a :func:`network`."""
    for pair in range(len(pairs)):
        a, b = pairs[pair, 0], pairs[pair, 1]
        for lane in range(values.shape[1]):
            one, other = values[a, lane], values[b, lane]
            # The sign is taken off only because, where a value could stay as it is, the compiler
            # would write under a mask, which takes three times as long.
            values[a, lane], values[b, lane] = abs(min(one, other)), abs(max(one, other))
