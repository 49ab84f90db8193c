# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Quadric surfaces through the neighbourhood (Leslar, Wang and Hu 2010, section 2.2)."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import fdtri, stdtrit

from lidar_outlier_filter.core.detectors.quadric import windows as quadric_windows
from lidar_outlier_filter.core.detectors.quadric.kernels import empty_window
from lidar_outlier_filter.core.detectors.quadric.parameters import MIN_POINTS, Quadric
from lidar_outlier_filter.core.detectors.quadric.statistics import Rules
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.kernels import threads
from lidar_outlier_filter.core.neighbours.tree_steps import height
from lidar_outlier_filter.errors import FilterError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Floats
    from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
    from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
    from lidar_outlier_filter.parameters.filter import FilterParameters

SECTIONS = 64  # that a thread judges at once
PATCHES = 1024
FREEDOMS = 1000  # degrees of freedom in the tables; beyond, quantiles do not change


def score(seen: DetectorInput, parameters: FilterParameters) -> Scores:
    """Score every point of a chain's input."""
    sigma = seen.points.sigma
    variance = None if sigma is None else sigma**2
    return Scores(detect(seen.neighbourhood, parameters.of(Quadric), variance))


def detect(
    neighbourhood: Neighbourhood, parameters: Quadric, variance: Floats | None = None
) -> Floats:
    """Score every point by its distance from the surfaces around it.

    Parameters
    ----------
    neighbourhood : N points
    parameters : see :class:`~.quadric.parameters.Quadric`
    variance : (N,) or (N, 3, 3) float64, optional
        Of each point: of any of its coordinates, or D of all three, m². Only their ratios count:
        σ̂0 is estimated in every window. None: unit weights.

    Returns
    -------
    (N,) float64
        In the order in which the points were given: T (31) ÷ its critical value. NaN for points in
        windows that are undecided.

    Raises
    ------
    FilterError
        A variance that is not finite and positive (definite).

    References
    ----------
    .. [1] Leslar, Wang and Hu (2010): A comparison of two new methods of outlier detection for
       mobile terrestrial lidar data. ISPRS Commission I, ICWG VI.
    .. [2] Leslar, Wang and Hu (2011): Comprehensive utilization of temporal and spatial domain
       outlier detection methods for mobile terrestrial LiDAR data. Remote Sensing 3(8), 1724-1742.
       https://doi.org/10.3390/rs3081724

    Examples
    --------
    >>> import numpy as np
    >>> from lidar_outlier_filter.core.detectors.quadric import detector as quadric
    >>> from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
    >>> from lidar_outlier_filter.core.detectors.quadric.parameters import MIN_POINTS, Quadric
    >>> x, y = np.divmod(np.arange(900.0), 30)
    >>> xyz = np.column_stack([x, y, 0.01 * np.sin(x)])
    >>> xyz[77, 2] = 6.0  # above a floor
    >>> parameters = Quadric()
    >>> score = quadric.detect(Neighbourhood(xyz, parameters.list_length), parameters)
    >>> np.flatnonzero(score > 1).tolist()
    [77]

    """
    components = _components(variance, len(neighbourhood))
    score = np.full(len(neighbourhood), np.nan)
    if len(neighbourhood) < MIN_POINTS:
        return score
    place = quadric_windows.sort_leaves(neighbourhood.xyz, neighbourhood.tree)
    xyz, order = neighbourhood.xyz[place], neighbourhood.order[place]
    if parameters.window == 'patch':
        _patches(neighbourhood, place, parameters, xyz, components[order], score)
    else:
        _sections(neighbourhood, parameters, xyz, components[order], score)
    result = np.empty_like(score)
    result[order] = score
    return result


def _sections(
    neighbourhood: Neighbourhood, parameters: Quadric, xyz: Floats, variance: Floats, score: Floats
) -> None:
    tree, section, rules = neighbourhood.tree, parameters.section, _rules(parameters)
    levels, cores = height(tree), quadric_windows.find_cores(tree, section)
    room = int((tree.last - tree.first)[cores].max()) + quadric_windows.RIM * section

    def work(begin: int, end: int) -> tuple[NDArray[np.int64], Floats]:
        window = empty_window(room, variance.shape[1])
        return quadric_windows.judge_sections(
            xyz, variance, tree, levels, cores[begin:end], section, rules, window, score
        )

    others = threads.run(work, len(cores), SECTIONS, neighbourhood.threads)
    failed = ~(score <= 1)
    for index, value in others:
        quadric_windows.acquit(score, failed, index, value)


def _patches(
    neighbourhood: Neighbourhood,
    place: NDArray[np.int64],
    parameters: Quadric,
    xyz: Floats,
    variance: Floats,
    score: Floats,
) -> None:
    rules, nearest = (
        _rules(parameters),
        neighbourhood.nearest(min(parameters.k, len(xyz) - 1)).index,
    )
    rank = np.empty(len(xyz), np.int64)
    rank[place] = np.arange(len(xyz))

    def work(begin: int, end: int) -> None:
        window = empty_window(nearest.shape[1] + 1, variance.shape[1])
        quadric_windows.judge_patches(
            xyz, variance, nearest, place, rank, begin, end, rules, window, score
        )

    threads.run(work, len(xyz), PATCHES, neighbourhood.threads)


def _rules(parameters: Quadric) -> Rules:
    critical, ratio = tables(parameters.significance)
    return Rules(
        critical,
        ratio,
        parameters.sigma_floor,
        MIN_POINTS,
        1 if parameters.model == 'always' else parameters.surfaces,
        parameters.model == 'always',
    )


@lru_cache(maxsize=64)
def tables(significance: float) -> tuple[Floats, Floats]:
    """Return the quantiles, two-sided of t, and of F for three more parameters, by freedom.

    The first entry, for no degree of freedom, is inf.
    """
    freedom = np.arange(1, FREEDOMS)
    critical = np.abs(stdtrit(freedom, significance / 2))
    ratio = fdtri(3, freedom, 1 - significance)
    return np.append(np.inf, critical), np.append(np.inf, ratio)


def _components(variance: Floats | None, count: int) -> Floats:
    """Arrange variances by component: (N, 0) none, (N, 1) isotropic, (N, 6) xx xy xz yy yz zz."""
    if variance is None:
        return np.empty((count, 0))
    if variance.shape not in {(count,), (count, 3, 3)}:
        raise FilterError('the variance', f'({count},) or ({count}, 3, 3)', variance.shape)
    if variance.ndim == 1:
        proper = np.isfinite(variance) & (variance > 0)
        components = variance[:, None]
    else:
        components = variance[:, *np.triu_indices(3)]
        proper = _is_definite(variance)
    if not proper.all():
        wrong = int(np.flatnonzero(~proper)[0])
        raise FilterError('the variance', 'finite and positive', f'that of point {wrong}')
    return np.ascontiguousarray(components, np.float64)


def _is_definite(matrix: Floats) -> NDArray[np.bool_]:
    """Return which symmetric matrices (N, 3, 3) are positive definite, by their leading minors."""
    symmetric = (matrix == matrix.swapaxes(1, 2)).all(axis=(1, 2))
    finite = np.isfinite(matrix).all(axis=(1, 2)) & symmetric
    safe = np.where(finite[:, None, None], matrix, 0.0)
    minors = [np.linalg.det(safe[:, :k, :k]) > 0 for k in (1, 2, 3)]
    definite: NDArray[np.bool_] = finite & np.logical_and.reduce(minors)
    return definite
