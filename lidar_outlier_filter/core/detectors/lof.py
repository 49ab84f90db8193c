# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The local outlier factor (Breunig, Kriegel, Ng and Sander 2000; Sotoodeh 2006, section 4).

Let k = ``min_pts`` and N(p) all others within the k-distance of p, ties included. The reach
distance of p from o is the larger of the k-distance of o and the distance from p to o. Then:

    density(p) = 1 / mean reach distance of p from all o in N(p)
    LOF(p) = mean of density(o) / density(p) over all o in N(p)

It is about 1 within a region of even density, whatever that density is, and has no unit.

Where more than k points coincide their k-distance is 0 and their density infinite. For that case
Breunig et al. (remark on definition 6) propose the *k-distinct-distance*, to the k-th nearest other
place at which there are points. Here it is used only if the k-distance is 0;
with fewer than k other positions the farthest counts, and if all points coincide the LOF is 1.
So all factors are finite, and neither a stack of points nor those around it are rejected for it.

Other programs: scikit-learn's ``LocalOutlierFactor`` (k is its ``n_neighbors``) takes exactly k
neighbours even if several tie for the last rank, and adds 1e-10 to the mean reach distance: good
points near more than k coincident ones get factors of millions. PDAL's ``filters.lof`` (k is its
``minpts``) counts the point itself as a neighbour, which pulls all factors towards 1. So does
PCL-LOFFilter, the code of Pirotti et al. (2018), which also squares all distances.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Floats, Ints
from lidar_outlier_filter.core.detectors.builtin import Lof
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.kernels import threads
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.parameters.filter import FilterParameters

LISTED = -1  # the row of points that have none of their own
POINTS_AT_ONCE = 4096  # points that a thread takes at once


class _Near(NamedTuple):
    """The neighbourhoods N(p) of all points, in tree order.

    Most are the k nearest others. Points with ties have a longer row; coincident points
    with a k-distance of 0 share one row.

    Attributes
    ----------
    listed : (N, k) int32
        The k nearest others of each point.
    row : (N,) int32
        The row of ``more`` that holds N(p), or LISTED: ``listed`` holds it.
    first : (R + 1,) int64
        Row r is ``more[first[r]:first[r + 1]]``.
    more : (M,) int32
        Indices of neighbours, row after row.

    """

    listed: NDArray[np.int32]
    row: NDArray[np.int32]
    first: Ints
    more: NDArray[np.int32]


def score(seen: DetectorInput, parameters: FilterParameters) -> Scores:
    """Score every point of a chain's input."""
    return Scores(detect(seen.neighbourhood, parameters.of(Lof)))


def detect(neighbourhood: Neighbourhood, parameters: Lof) -> Floats:
    """Score every point by its local outlier factor.

    Parameters
    ----------
    neighbourhood : N points
    parameters : see :class:`~.builtin.Lof`

    Returns
    -------
    (N,) float64
        In the order in which the points were given, ÷ ``threshold``: the LOF (``lof``), or its
        absolute difference from the median of all (``lof2``, Pirotti et al. 2018). NaN for all
        points where each has fewer than ``min_pts`` others.

    References
    ----------
    .. [1] Breunig, Kriegel, Ng and Sander (2000): LOF: identifying density-based local outliers.
       SIGMOD, 93-104. https://doi.org/10.1145/342009.335388
    .. [2] Sotoodeh (2006): Outlier detection in laser scanner point clouds. ISPRS Archives XXXVI-5,
       297-302.
    .. [3] Pirotti, Ravanelli, Fissore and Masiero (2018): Implementation and assessment of two
       density-based outlier detection methods over large spatial point clouds. Open Geospatial
       Data, Software and Standards 3, 14. https://doi.org/10.1186/s40965-018-0056-5

    Examples
    --------
    >>> import numpy as np
    >>> from lidar_outlier_filter.core.detectors import lof
    >>> from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
    >>> from lidar_outlier_filter.core.detectors.builtin import Lof
    >>> x, y = np.divmod(np.arange(900.0), 30)
    >>> xyz = np.column_stack([x, y, 0.01 * np.sin(x)])
    >>> xyz[77, 2] = 6.0  # above a floor
    >>> parameters = Lof(threshold=2.0)
    >>> score = lof.detect(Neighbourhood(xyz, parameters.min_pts), parameters)
    >>> np.flatnonzero(score > 1).tolist()
    [77]

    """
    return compare(measure(neighbourhood, parameters), parameters)


def measure(neighbourhood: Neighbourhood, parameters: Lof) -> Floats:
    """Return the LOF of every point, (N,) as given; NaN for all if each has too few others."""
    factor = np.full(len(neighbourhood), np.nan)
    if len(neighbourhood) > parameters.min_pts:
        factor[neighbourhood.order] = _factors(neighbourhood, parameters.min_pts)
    return factor


def compare(factor: Floats, parameters: Lof) -> Floats:
    """Score all points of a cloud by their LOF, see :func:`detect`."""
    if parameters.statistic == 'lof2' and not np.isnan(factor).all():
        factor = np.abs(factor - np.median(factor))
    return factor / parameters.threshold


def _factors(neighbourhood: Neighbourhood, k: int) -> Floats:
    """Return the LOF of all points, in tree order; the work is linear however many coincide."""
    xyz = neighbourhood.xyz
    square = neighbourhood.squared_distances(k)
    stacked, first_there = _unstack(neighbourhood, k, square)
    if not square.any():
        return np.ones(len(xyz))
    near = _near(neighbourhood, k, square, stacked, first_there)

    def of_all(work: Callable[..., None], *given: Floats) -> Floats:
        result = np.empty(len(xyz))
        threads.run(
            lambda begin, end: work(near, *given, begin, end, result),
            len(xyz),
            POINTS_AT_ONCE,
            neighbourhood.threads,
        )
        result[stacked] = result[first_there]
        return result

    density = of_all(_kernels.write_densities, xyz, square)
    return of_all(_kernels.write_density_ratios, density)


def _unstack(neighbourhood: Neighbourhood, k: int, square: Floats) -> tuple[Ints, Ints]:
    """Put squared k-distinct-distances where k-distances are 0.

    Returns those points, and for each of them the point given first at the same place.
    """
    stacked = np.flatnonzero(square == 0)
    if len(stacked) == 0:
        return stacked, stacked
    alone, index, (copy, original) = neighbourhood.distinct()
    first = np.arange(len(square))  # as given
    first[copy] = original
    first = first[neighbourhood.order[stacked]]
    most = min(k, len(alone) - 1)
    if most > 0:
        distinct = np.empty(len(square))
        distinct[index] = alone.squared_distances(most)
        square[stacked] = distinct[first]
    return stacked, _positions(neighbourhood)[first]


def _positions(neighbourhood: Neighbourhood) -> Ints:
    """Return where in tree order each point is."""
    position = np.empty(len(neighbourhood), np.int64)
    position[neighbourhood.order] = np.arange(len(position))
    return position


def _near(
    neighbourhood: Neighbourhood, k: int, square: Floats, stacked: Ints, first_there: Ints
) -> _Near:
    """Find all neighbours within the k-distances."""
    listed, tied = neighbourhood.nearest(k)
    special = tied.copy()
    # Lists of coincident points are as long as these are many: one has it, and stands for all.
    special[stacked] = False
    special[first_there] = True
    own = np.flatnonzero(special)
    row = np.full(len(tied), LISTED, np.int32)
    row[own] = np.arange(len(own))
    first, more = neighbourhood.within(own, square[own])
    if len(own) > 0:
        _order_as_given(neighbourhood, first, more)
    return _Near(listed, row, first, more)


def _order_as_given(neighbourhood: Neighbourhood, first: Ints, more: NDArray[np.int32]) -> None:
    """Sort each row as the points were given.

    Sums then do not depend on the tree, which changes if points far off are missing, for example
    because an earlier detector rejected them.
    """
    order, position = neighbourhood.order, _positions(neighbourhood)
    threads.run(
        lambda begin, end: _kernels.sort_rows_as_given(first, order, position, begin, end, more),
        len(first) - 1,
        POINTS_AT_ONCE,
        neighbourhood.threads,
    )
