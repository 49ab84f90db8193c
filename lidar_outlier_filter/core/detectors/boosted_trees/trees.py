# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Sums of small decision trees: each asks three questions, one after the other.

All trees have seven questions, of which a point answers three, and eight values: so many points are
asked side by side without a branch.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from lidar_outlier_filter.core.kernels.kernels import apart_kernel, kernel

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Singles

QUESTIONS, VALUES = 7, 8


class Trees(NamedTuple):
    """T trees.

    Attributes
    ----------
    feature : (T, 7) int32
        What is asked for: the first; then the second, left and right; then the third, from left to
        right. A point goes right where its feature is greater.
    limit : (T, 7) float32
    value : (T, 8) float32
        From left to right.
    start : float32
        What the sum begins with.

    """

    feature: NDArray[np.int32]
    limit: Singles
    value: Singles
    start: np.float32


@kernel
def add_up(trees: Trees, features: Singles, total: Singles) -> None:
    """Do as :func:`add_lanes`: an entry for Python."""
    add_lanes(trees, features, total)


@apart_kernel
def add_lanes(trees: Trees, features: Singles, total: Singles) -> None:
    """Write the sums (lanes,) of points with these features (F, lanes), in single precision."""
    for lane in range(len(total)):
        total[lane] = trees.start
    for tree in range(len(trees.feature)):
        f, t, v = trees.feature[tree], trees.limit[tree], trees.value[tree]
        a, b, c, d = features[f[0]], features[f[1]], features[f[2]], features[f[3]]
        e, g, h = features[f[4]], features[f[5]], features[f[6]]
        t0, t1, t2, t3, t4, t5, t6 = t[0], t[1], t[2], t[3], t[4], t[5], t[6]
        v0, v1, v2, v3, v4, v5, v6, v7 = v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7]
        for lane in range(len(total)):
            low = v1 if d[lane] > t3 else v0
            high = v3 if e[lane] > t4 else v2
            left = high if b[lane] > t1 else low
            low = v5 if g[lane] > t5 else v4
            high = v7 if h[lane] > t6 else v6
            right = high if c[lane] > t2 else low
            total[lane] += right if a[lane] > t0 else left
