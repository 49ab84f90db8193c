# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Gross elevation errors: z compared with its neighbours in x and y (Kang, Huang and Yang 2018).

Their section 3.3, with its numbers:

1. Points beyond a gap of the elevation histogram are rejected. The paper finds gaps by eye; here
   it is an empty range wider than ``gap`` with at most a thousandth of all points, or one, beyond.
2. A kd-tree of x and y of the remaining points.
3. M, the mean elevation of the k nearest others less the elevation of the point. Points that tie
   with the k-th are included, so that M does not depend on the order of the points.
4. Mean and standard deviation σ of all M.
5. Points with ``|M - mean| > multiplier · σ`` are rejected.

The paper's (5) is M - mean > 3σ. Exactly as published it finds low points only, although section 1
promises high ones too; this is ``sides: low``, its mirror image is ``high``, and ``both`` takes the
absolute value. σ is at least 5 mm, so that rounding on a flat floor is not a gross error.

z must point up; neighbours in x and y must be neighbours on a surface, as in airborne scans.

``against: ground`` compares with the ground under the cloud instead, in metres: a progressive
morphological filter (Zhang et al. 2003).

1. The lowest point of each cell of a grid. An empty cell is interpolated between the nearest two
   occupied cells of its row; beyond the last of them the height is constant. Empty rows are
   interpolated between rows in the same way.
2. Openings by squares of 3, 5, 9, 17 … cells, each applied to the last result, until a square
   is as wide as the widest object.
3. A cell that an opening of w cells lowers by more than ``RISE_M`` + ``SLOPE`` · (w - prior w) ·
   cell, at most ``MAX_RISE_M``, is not ground; for the first opening it is ``RISE_M``. The ground
   under such cells is filled as in 1.

Openings keep what is lower than its surroundings: the paper does not treat low points. Here a
ground cell more than ``PIT`` below its closing by 3 × 3 cells is raised to it after the openings,
so that low points do not pull the ground down. Under dense canopy this raises true ground, too.
"""

import numpy as np

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Bools, Floats, Index, Ints
from lidar_outlier_filter.core.detectors.builtin import Elevation
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.neighbours.neighbourhood import LARGEST_M, Neighbourhood
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.parameters.filter import FilterParameters

RISE_M, MAX_RISE_M = 0.3, 3.0
PIT = 0.5  # metres
SLOPE = 0.3  # of the ground, rise ÷ run
MAX_CELLS = 16  # for a point, and as many as in FREE_CELLS in any case
FREE_CELLS = 1 << 22
POINTS_AT_ONCE = 1 << 14  # points that a thread takes at once
SHARE = 0.001  # largest share of the points taken off as set apart, on each side
SIGMA_FLOOR_M = 0.005  # least standard deviation that an estimate may give


def score(seen: DetectorInput, parameters: FilterParameters) -> Scores:
    """Score every point of a chain's input."""
    return Scores(detect(seen.points.xyz, parameters.of(Elevation), seen.threads))


def detect(xyz: Floats, parameters: Elevation, threads: int = 0, *, on_map: bool = True) -> Floats:
    """Test the elevation of every point.

    Parameters
    ----------
    xyz : (N, 3) float64, finite, metres, z up
    parameters : see :class:`~.builtin.Elevation`
    threads : at most so many, 0 for all cores; the scores do not depend on it
    on_map : whether neighbours are the nearest in x and y, as in the paper, or in x, y and z

    Returns
    -------
    (N,) float64
        Statistic ÷ critical value, more than 1 exactly where rejected. Points beyond an elevation
        gap: their distance from the others ÷ ``gap``. All others: equation (5), maybe negative
        unless ``sides`` is ``both``. NaN for points without k others. Against the ground:
        height above it, or depth × ``depth_counts``, ÷ ``height``; for a few points so far off
        that the grid would have too many cells, the distance from the others ÷ ``widest``.

    Raises
    ------
    FilterError
        If a coordinate is not finite, or so large that its square is not; against the ground, if
        cells exceed both 16 per point and 4,194,304.

    References
    ----------
    .. [1] Kang, Huang and Yang (2018): A gross error elimination method for point cloud data based
       on kd-tree. ISPRS Archives XLII-3, 719-722.
       https://doi.org/10.5194/isprs-archives-XLII-3-719-2018
    .. [2] Zhang, Chen, Whitman, Shyu, Yan and Zhang (2003): A progressive morphological filter for
       removing nonground measurements from airborne LIDAR data. IEEE Transactions on Geoscience and
       Remote Sensing 41(4), 872-882. https://doi.org/10.1109/TGRS.2003.810682

    Examples
    --------
    >>> import numpy as np
    >>> from lidar_outlier_filter.core.detectors import elevation
    >>> from lidar_outlier_filter.core.detectors.builtin import Elevation
    >>> x, y = np.divmod(np.arange(900.0), 30)
    >>> xyz = np.column_stack([x, y, 0.01 * np.sin(x)])
    >>> xyz[77, 2] = 6.0  # above a floor
    >>> score = elevation.detect(xyz, Elevation())
    >>> np.flatnonzero(score > 1).tolist()
    [77]

    """
    against_ground = parameters.against == 'ground'
    if len(xyz) <= (0 if against_ground else parameters.k):
        return np.full(len(xyz), np.nan)
    if not (xyz.min() >= -LARGEST_M and xyz.max() <= LARGEST_M):
        got = xyz[~(np.abs(xyz) <= LARGEST_M)][0]
        raise FilterError('coordinates', f'finite and at most {LARGEST_M:g} m', got)
    if against_ground:
        return _against_ground(xyz, parameters)
    return _against_neighbours(xyz, parameters, threads, on_map=on_map)


def _against_neighbours(
    xyz: Floats, parameters: Elevation, threads: int, *, on_map: bool
) -> Floats:
    """Go through steps 1 to 5."""
    beyond = _beyond(xyz[:, 2], parameters.gap)
    left = beyond <= 0
    score = np.full(len(xyz), np.nan)
    np.divide(beyond, parameters.gap, out=score, where=~left)
    if np.count_nonzero(left) <= parameters.k:
        return score
    body_xyz = xyz if left.all() else xyz[left]
    difference = differences(body_xyz, parameters.k, threads, on_map=on_map)
    sigma = max(SIGMA_FLOOR_M, float(np.std(difference, ddof=1)))
    off = (difference - np.mean(difference)) / (parameters.multiplier * sigma)
    score[left] = {'low': off, 'high': -off, 'both': np.abs(off)}[parameters.sides]
    return score


def _against_ground(xyz: Floats, parameters: Elevation) -> Floats:
    """Score heights above the ground, and depths below it."""
    cell, widest = parameters.cell, max(parameters.widest, parameters.cell)
    score = np.zeros(len(xyz))
    if _count_cells(xyz, cell) > max(FREE_CELLS, MAX_CELLS * len(xyz)):
        score = np.maximum(*(_beyond(xyz[:, axis], widest) for axis in range(2))) / widest
        score = np.maximum(score, 0)
    near = score <= 0
    height = heights(xyz[near], cell, parameters.widest)
    above, below = height, -parameters.depth_counts * height
    sides = {'high': above, 'low': below, 'both': np.maximum(above, below)}
    score[near] = sides[parameters.sides] / parameters.height
    return score


def _beyond(values: Floats, gap: float) -> Floats:
    """Return how far values are outside the limits of :func:`body`; 0 or less: inside."""
    low, high = body(values, gap)
    return np.maximum(low - values, values - high)


def body(elevation: Floats, gap: float) -> tuple[float, float]:
    """Return the lowest and the highest elevation between the gaps, metres.

    Each side is cut at the innermost empty range wider than ``gap`` with at most ``SHARE`` of the
    points, or one, beyond it. One or two points have no gap; nor has a cloud if ``gap`` is 0.

    """
    count = len(elevation)
    most = max(1, int(SHARE * count))
    if gap == 0 or 2 * most >= count:
        return float(elevation.min()), float(elevation.max())
    outside = (most, count - 1 - most)
    ends = np.partition(elevation, outside)
    lowest, highest = np.sort(ends[: most + 1]), np.sort(ends[outside[1] :])
    steps = np.flatnonzero(np.diff(lowest) > gap)
    low = lowest[steps[-1] + 1] if len(steps) else lowest[0]
    steps = np.flatnonzero(np.diff(highest) > gap)
    high = highest[steps[0]] if len(steps) else highest[-1]
    return float(low), float(high)


def differences(xyz: Floats, k: int, threads: int = 0, *, on_map: bool = True) -> Floats:
    """Return M of step 3 for every point, metres; there must be more than k."""
    searched = xyz.copy()
    if on_map:
        searched[:, 2] = 0.0
    neighbourhood = Neighbourhood(searched, k, threads)
    index, tied = neighbourhood.nearest(k)
    order = neighbourhood.order
    # Copy the column first: picked from rows, each value would fetch a whole cache line.
    elevation = xyz[:, 2].copy()[order]
    result = np.empty(len(xyz))

    def work(begin: int, end: int) -> None:
        _kernels.elevation_differences(elevation, index, begin, end, result)

    pool.run(work, len(xyz), POINTS_AT_ONCE, threads)
    _correct_ties(neighbourhood, elevation, index, np.flatnonzero(tied), result)
    in_input_order = np.empty(len(xyz))
    in_input_order[order] = result
    return in_input_order


def _correct_ties(
    neighbourhood: Neighbourhood, elevation: Floats, index: Index, tied: Ints, result: Floats
) -> None:
    """Write M of points with more neighbours than fit in their lists."""
    if not len(tied):
        return
    xyz = neighbourhood.xyz
    away = xyz[tied] - xyz[index[tied, -1]]
    squared = away[:, 0] * away[:, 0] + away[:, 1] * away[:, 1] + away[:, 2] * away[:, 2]
    # Coincident ones all have the same neighbours: the others of their stack. Lists of them would
    # grow with the square of its height.
    stacked = tied[squared == 0]
    _, stack, height = np.unique(xyz[stacked], axis=0, return_inverse=True, return_counts=True)
    stack = stack.reshape(-1)
    first = np.full(len(height), -1)
    first[stack[::-1]] = stacked[::-1]
    above = elevation[stacked] - elevation[first[stack]]
    total = np.bincount(stack, above, len(height))
    result[stacked] = (total[stack] - above) / (height[stack] - 1) - above
    others = tied[squared > 0]
    offsets, near = neighbourhood.within(others, squared[squared > 0])
    count = np.diff(offsets)
    above = elevation[near] - np.repeat(elevation[others], count)
    result[others] = np.bincount(np.repeat(np.arange(len(others)), count), above) / count


# The ground ---------------------------------------------------------------------------------------


def heights(xyz: Floats, cell: float, widest: float) -> Floats:
    """Return how high N points are above the ground, metres; negative below it.

    Between the centres of cells the ground is interpolated, along x and along y.

    Raises
    ------
    FilterError
        If cells exceed both 16 per point and 4,194,304.

    """
    # SciPy's filters take a third of a second to import, and neighbours need none of them.
    from scipy import ndimage  # noqa: PLC0415

    if _count_cells(xyz, cell) > max(FREE_CELLS, MAX_CELLS * len(xyz)):
        must_be = f'large enough for at most {MAX_CELLS} cells a point'
        extent = ' × '.join(f'{side:g}' for side in np.ptp(xyz[:, :2], axis=0))
        raise FilterError('elevation.cell', must_be, f'{cell:g} m for {extent} m')
    at = (xyz[:, :2] - xyz[:, :2].min(axis=0)) / cell
    shape = at.max(axis=0).astype(np.int64) + 1
    ground = _surface(_lowest(at, xyz[:, 2], shape), cell, widest)
    height: Floats = xyz[:, 2] - ndimage.map_coordinates(
        ground, at.T - 0.5, order=1, mode='nearest'
    )
    return height


def _count_cells(xyz: Floats, cell: float) -> float:
    """Count the cells under a cloud, which may be more than there are integers."""
    return float(np.prod(np.floor(np.ptp(xyz[:, :2], axis=0) / cell) + 1))


def _lowest(at: Floats, z: Floats, shape: Ints) -> Floats:
    """Return the lowest z of each cell; one without points is filled."""
    grid = np.full(shape, np.inf)
    index = at.astype(np.int64)
    np.minimum.at(grid, (index[:, 0], index[:, 1]), z)
    return _filled(grid, np.isfinite(grid))


def _surface(grid: Floats, cell: float, widest: float) -> Floats:
    """Return the ground of a grid of lowest points."""
    from scipy import ndimage  # noqa: PLC0415  as above

    ground, is_ground = grid, np.ones(grid.shape, np.bool_)
    before = width = 3
    while True:
        opened = ndimage.grey_opening(ground, (width, width))
        rise = min(RISE_M + SLOPE * (width - before) * cell, MAX_RISE_M)
        is_ground &= ground - opened <= rise
        ground = opened
        if width * cell >= widest:
            break
        before, width = width, 2 * width - 1
    ground = _filled(grid, is_ground)
    closed = ndimage.grey_closing(ground, (3, 3))
    return np.where(closed - ground > PIT, closed, ground)


def _filled(grid: Floats, known: Bools) -> Floats:
    """Fill the cells that are not known, along rows, and then rows of which none is known.

    Of a grid without any known cell nothing changes.
    """
    rows = np.flatnonzero(known.any(axis=1))
    if len(rows) == 0:
        return grid
    result = grid.copy()
    columns = np.arange(grid.shape[1])
    for row in rows[~known[rows].all(axis=1)]:
        there = np.flatnonzero(known[row])
        result[row] = np.interp(columns, there, grid[row, there])
    for column in columns if len(rows) < len(grid) else ():
        result[:, column] = np.interp(np.arange(len(grid)), rows, result[rows, column])
    return result
