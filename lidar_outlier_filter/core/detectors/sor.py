# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of the distance to the nearest neighbours: SOR, SOR2 and radius, fixed or by range.

With d the mean distance of a point to its ``k`` nearest others:

``sor``
    d against mean + multiplier × standard deviation of the d of all points (Pirotti et al. 2018);
    the standard deviation is that of a sample, with N - 1.
``sor2``
    The absolute difference of d from the median of all, against ``limit`` (Pirotti et al. 2018).
``radius``
    The distance to neighbour number ``min_neighbors``, against ``radius``.

With ``range_scaled`` each point has its own limit, by its distance r from the sensor: ``sor`` and
``sor2`` the limit × range_factor × r (DSOR, Kurup and Bos 2021); ``radius`` the larger of radius
and range_factor × r (DROR, Charron, Phillips and Waslander 2018: range_factor is their multiplier ×
the angle between two beams).

A point at exactly its limit is kept, as PCL does; nothing but coincident points is within a limit
of 0. How other programs count:

=========================  =====================  ==================================================
peer                       k, min_neighbors here  at exactly the limit; other differences
=========================  =====================  ==================================================
PCL SOR                    mean_k                 kept; distances are rounded to float32
PCL RadiusOutlierRemoval   MinNeighborsInRadius   kept
PDAL statistical           mean_k                 rejected
PDAL radius                min_k                  not within; if it would reject all, it keeps all
Open3D statistical         nb_neighbors - 1       rejected; d is × k / (k + 1), and so is its limit;
                                                  points with d = 0 are rejected too
Open3D radius              nb_points              not within
DSOR, by its authors       mean_k - 1             rejected
DROR, by its authors       min_neighbors - 1      not within; r without z
=========================  =====================  ==================================================
"""

import numpy as np

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.detectors.builtin import Sor
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.kernels import threads
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.parameters.filter import FilterParameters

POINTS_AT_ONCE = 4096  # points that a thread takes at once


def score(seen: DetectorInput, parameters: FilterParameters) -> Scores:
    """Score every point of a chain's input."""
    own = parameters.of(Sor)
    ranges = seen.points.range if own.range_scaled else None
    return Scores(detect(seen.neighbourhood, own, ranges))


def detect(neighbourhood: Neighbourhood, parameters: Sor, range_m: Floats | None = None) -> Floats:
    """Score every point by the distance to its neighbours.

    Parameters
    ----------
    neighbourhood : N points
    parameters : see :class:`~.builtin.Sor`
    range_m : (N,) float64, optional
        Distance of each point from the sensor, metres, finite; ``range_scaled`` needs it.

    Returns
    -------
    (N,) float64
        In the order in which the points were given: statistic ÷ limit. NaN for all
        points if there are fewer than ``k`` others (``sor``, ``sor2``). inf for all if there are
        fewer than ``min_neighbors`` others (``radius``), as PCL and PDAL reject them.

    Raises
    ------
    FilterError
        ``range_scaled`` without ranges.

    References
    ----------
    .. [1] Pirotti, Ravanelli, Fissore and Masiero (2018): Implementation and assessment of two
       density-based outlier detection methods over large spatial point clouds. Open Geospatial
       Data, Software and Standards 3, 14. https://doi.org/10.1186/s40965-018-0056-5
    .. [2] Kurup and Bos (2021): DSOR: a scalable statistical filter for removing falling snow from
       LiDAR point clouds in severe winter weather. https://doi.org/10.48550/arXiv.2109.07078
    .. [3] Charron, Phillips and Waslander (2018): De-noising of lidar point clouds corrupted by
       snowfall. CRV. https://doi.org/10.1109/CRV.2018.00043

    Examples
    --------
    >>> import numpy as np
    >>> from lidar_outlier_filter.core.detectors import sor
    >>> from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
    >>> from lidar_outlier_filter.core.detectors.builtin import Sor
    >>> x, y = np.divmod(np.arange(900.0), 30)
    >>> xyz = np.column_stack([x, y, 0.01 * np.sin(x)])
    >>> xyz[77, 2] = 6.0  # above a floor
    >>> parameters = Sor(statistic='radius', radius=2.0, min_neighbors=3)
    >>> score = sor.detect(Neighbourhood(xyz, parameters.list_length), parameters)
    >>> np.flatnonzero(score > 1).tolist(), float(score[77].round(1))
    ([77], 3.0)

    """
    return compare(measure(neighbourhood, parameters), parameters, range_m)


def measure(neighbourhood: Neighbourhood, parameters: Sor) -> Floats:
    """Measure every point by its nearest neighbours alone.

    Returns
    -------
    (N,) float64
        In the order in which the points were given: the mean distance to the ``k`` nearest others,
        NaN for all if there are fewer; for ``radius`` the distance to neighbour number
        ``min_neighbors``, inf for all if there are fewer.

    """
    if parameters.statistic == 'radius':
        return _radius(neighbourhood, parameters.min_neighbors)
    if len(neighbourhood) <= parameters.k:
        return np.full(len(neighbourhood), np.nan)
    return _mean_distances(neighbourhood, parameters.k)


def compare(measured: Floats, parameters: Sor, range_m: Floats | None = None) -> Floats:
    """Score all points of a cloud by what :func:`measure` says of each; see :func:`detect`."""
    count = len(measured)
    scale = None
    if parameters.range_scaled:
        if range_m is None:
            must_be = 'given where sor.range_scaled is set'
            raise FilterError('the ranges of the points', must_be, None)
        scale = parameters.range_factor * range_m
    if parameters.statistic == 'radius':
        limit = parameters.radius if scale is None else np.maximum(parameters.radius, scale)
        return measured / limit
    if np.isnan(measured).all():
        return np.full(count, np.nan)
    if parameters.statistic == 'sor':
        # Rounding must not put the mean of equal numbers below all of them.
        mean = max(measured.mean(), measured.min())
        limit = float(mean + parameters.multiplier * measured.std(ddof=1))
        return _ratio(measured, limit if scale is None else limit * scale)
    distance = np.abs(measured - np.median(measured))
    return _ratio(distance, parameters.limit if scale is None else parameters.limit * scale)


def _radius(neighbourhood: Neighbourhood, least: int) -> Floats:
    """Return the smallest radius around each point that holds so many others."""
    count = len(neighbourhood)
    result = np.full(count, np.inf)
    if count > least:
        result[neighbourhood.order] = np.sqrt(neighbourhood.squared_distances(least))
    return result


def _mean_distances(neighbourhood: Neighbourhood, k: int) -> Floats:
    """Return the mean distance of each point to its k nearest others."""
    xyz, lists = neighbourhood.xyz, neighbourhood.nearest(k).index
    mean = np.empty(len(xyz))
    threads.run(
        lambda begin, end: _kernels.average_distances(xyz, lists, begin, end, mean),
        len(xyz),
        POINTS_AT_ONCE,
        neighbourhood.threads,
    )
    result = np.empty(len(xyz))
    result[neighbourhood.order] = mean
    return result


def _ratio(statistic: Floats, limit: Floats | float) -> Floats:
    """Divide by the limits. Over a limit of 0, statistics above 0 score inf, and 0 scores 0."""
    score = np.where(statistic > 0, np.inf, 0.0)
    with np.errstate(over='ignore'):
        np.divide(statistic, limit, out=score, where=np.greater(limit, 0))
    return score
