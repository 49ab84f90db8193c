# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Groups of points that float free of everything else, thin, straight and slanted.

A profile scanner sees what moves while it passes, such as the arm of a barrier, as a slanted line
in the air: no less dense than what is around, but joined to nothing, and each scan line sees a
piece of its own. What stands or is laid is vertical or level; a wire, which is as thin as the beam,
is met but once by each line. Points are joined twice: widely, so that a group stays whole, and
narrowly, so that it comes free of a car that it nearly touches. z must be up.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.detectors.boosted_trees.weighted_sum.surface import K
from lidar_outlier_filter.core.kernels.kernels import inner_kernel, kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Floats, Ints
    from lidar_outlier_filter.core.detectors.boosted_trees.weighted_sum.features import Scan

JOINED = 12  # nearest neighbours of which a point may be joined to any
REACHES = (4.0, 1.5)  # expected spacings up to which points are joined
SMALLEST, LARGEST = 24, 3000  # points of a group
NARROW = 0.35  # standard deviation across, of that along: thinner groups are straight
LONGEST, WIDEST = 8.0, 0.25  # metres
LEVEL, STEEP = 0.1, 0.92  # sines of the slope: between them a group is slanted
OF_LINE = 1.5  # points that a line sees of a group, at least and on average: more than a wire's
FEW_LINES = 3
ACROSS = 0.95  # spread of what the lines see on average ÷ that of all: each sees a piece of its own
UNIFORM = np.sqrt(12.0)  # length of an even row ÷ its standard deviation


def straightness(scan: Scan, spacing: Floats) -> Floats:
    """Return of each point in a slanted group how straight that is.

    Parameters
    ----------
    scan : of more than 20 points
    spacing : (N,) expected distance to near neighbours, in tree order, metres

    Returns
    -------
    (N,) float64
        In tree order, NARROW × length ÷ width of the group, more than 1 where it is straight, the
        greater of both; NaN for points in none that is slanted and of the right size.

    """
    xyz, line = scan.neighbourhood.xyz, scan.ordered.line[scan.rank]
    nearest = scan.neighbourhood.nearest(K).index
    after = scan.lines.after[scan.rank]
    after = np.where(after >= 0, scan.back[after], -1)
    result = np.full(len(xyz), np.nan)
    for reach in REACHES:
        root = _join(xyz, nearest[:, :JOINED], reach * spacing, after)
        result = np.fmax(result, _of_groups(xyz, line, root))
    return result


def _of_groups(xyz: Floats, line: Ints, root: Ints) -> Floats:
    """Return of each point how straight the group is that its root names."""
    count = np.bincount(root)[root]
    members = np.flatnonzero((count >= SMALLEST) & (count <= LARGEST))
    members = members[np.argsort(root[members], kind='stable')]
    ends = np.flatnonzero(np.diff(root[members], append=-1)) + 1
    result = np.full(len(root), np.nan)
    for begin, end in zip([0, *ends[:-1]], ends, strict=False):
        some = members[begin:end]
        result[some] = _straightness(xyz[some], line[some])
    return result


def _straightness(xyz: Floats, line: Ints) -> float:
    """Return how straight a group is, or NaN if it is a wire, or not slanted, or too large."""
    _, of_line, count = np.unique(line, return_inverse=True, return_counts=True)
    if len(line) < OF_LINE * len(count):
        return np.nan
    value, vector = np.linalg.eigh(np.cov(xyz.T, bias=True))
    length, width = np.sqrt(max(value[2], 0.0)), np.sqrt(max(value[1], 0.0))
    slanted = LEVEL < abs(vector[2, 2]) < STEEP
    if not slanted or UNIFORM * length > LONGEST or UNIFORM * width > WIDEST:
        return np.nan
    along = (xyz - xyz.mean(axis=0)) @ vector[:, 2]
    means = np.bincount(of_line, along) / count
    if len(count) > FEW_LINES and means.std() < ACROSS * length:
        return np.nan
    return float(NARROW * length / max(width, 1e-9))


@kernel
def _join(xyz: Floats, nearest: NDArray[np.int32], reach: Floats, after: Ints) -> Ints:
    """Join points with their neighbours, near ones and the next one in the line, within reach.

    Returns a number for each group: that of its first point.
    """
    root = np.arange(len(xyz))
    for i in range(len(xyz)):
        for m in range(nearest.shape[1] + 1):
            j = nearest[i, m] if m < nearest.shape[1] else after[i]
            # Most are joined already, which is seen faster than measured.
            if j < 0 or root[i] == root[j]:
                continue
            x, y, z = xyz[i, 0] - xyz[j, 0], xyz[i, 1] - xyz[j, 1], xyz[i, 2] - xyz[j, 2]
            if x * x + y * y + z * z <= min(reach[i], reach[j]) ** 2:
                a, b = _find(root, i), _find(root, j)
                root[max(a, b)] = min(a, b)
    for i in range(len(root)):
        root[i] = _find(root, i)
    return root


@inner_kernel
def _find(root: Ints, i: int) -> int:
    while root[i] != i:
        root[i] = root[root[i]]
        i = root[i]
    return int(i)
