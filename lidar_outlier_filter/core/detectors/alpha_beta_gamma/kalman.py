# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The α-β-γ smoother as a textbook Kalman filter: slow, and easy to audit.

Chosen by ``engine: filterpy``. One window is one run of ``filterpy.kalman.KalmanFilter`` with the
states position, velocity and (order 2) acceleration of x, y and z, without process noise, followed
by its Rauch-Tung-Striebel smoother. The instant in question is a step without measurement.

The start is exact. A large first covariance ("nothing is known yet") would not do: too small, it
draws the result to itself; too large, the digits of the result cancel; of 1e6 to 1e12 times the
variance of a point, none comes within 1e-6 of least squares in all windows. Instead the outermost
points and the one that lies best between them fix the first state and its variance, and all others
update it: the same least squares solution, to 1e-9 in the worst windows tried, 1e-12 in most.

filterpy is an optional dependency, imported on first use. Versions 1.4.5 and 2.0.0 both serve.
"""

from importlib import import_module
from math import factorial, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.detectors.alpha_beta_gamma.normal_equations import (
    AFTER,
    BEFORE,
    CENTRED,
    WEIGHT,
    Series,
    T,
    X,
)
from lidar_outlier_filter.core.detectors.builtin import AlphaBetaGamma
from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.errors import ParameterError

COORDINATES = 3
SINGULAR = 1e-10  # det N below this part of the product of its diagonal: no prediction


def residuals(series: Series, which: NDArray[np.int64], parameters: AlphaBetaGamma) -> Floats:
    """Return the standardised differences (17), before division by a σ common to the line.

    Returns
    -------
    (3, 3, M) float64
        For each window (centred, before, after) the x, y and z of the M points ``which``; NaN where
        the window is not usable, or (``sides: both``, the one-sided ones) not asked for.

    """
    _filterpy()  # refused first, whatever the windows
    result = np.full((3, COORDINATES, len(which)), np.nan)
    t_all, xyz = series.row(T), series.row(slice(X, X + 3))
    variance = 1 / series.row(WEIGHT)
    for m, k in enumerate(which.tolist()):
        for window, others in _windows(series, k, parameters).items():
            t = (t_all[others] - t_all[k]) / SECOND
            of_others = variance[others]
            if len(others) < parameters.min_window or _is_singular(t, of_others, parameters.order):
                continue
            relative = xyz[:, others].T - xyz[:, k]
            z_p, q = predict(t, relative, of_others, parameters.order)
            result[window, :, m] = -z_p / sqrt(variance[k] + q)
    return result


def _windows(series: Series, k: int, parameters: AlphaBetaGamma) -> dict[int, list[int]]:
    """Return the points of each window of the point k, itself not among them."""
    before, after = parameters.before, parameters.after
    front, behind = _walk(series.before, k, before), _walk(series.after, k, after)
    # What overhangs one end of the segment is added at the other.
    longer_front = _walk(series.before, k, before + after - len(behind))
    longer_behind = _walk(series.after, k, after + before - len(front))
    if parameters.sides == 'both':
        return {CENTRED: longer_front + longer_behind}
    return {CENTRED: longer_front + longer_behind, BEFORE: front, AFTER: behind}


def _walk(link: NDArray[np.int64], k: int, reach: int) -> list[int]:
    """Follow the links from the point k for up to ``reach`` points."""
    found: list[int] = []
    i = int(link[k])
    while i >= 0 and len(found) < reach:
        found.append(i)
        i = int(link[i])
    return found


def _is_singular(t: Floats, variance: Floats, order: int) -> bool:
    """Return whether the window's normal matrix (14) cannot be inverted."""
    width = np.max(np.abs(t))
    if width == 0:
        return True
    design = np.vander(t / width, order + 1, increasing=True)
    normal = design.T @ (design / variance[:, None])
    return bool(np.linalg.det(normal) <= SINGULAR * np.prod(np.diag(normal)))


def predict(t: Floats, z: Floats, variance: Floats, order: int) -> tuple[Floats, float]:
    """Predict the tested point from the others of its window: equations (15) and (16).

    Parameters
    ----------
    t : (n,) float64, seconds relative to the tested point, in any order, with ties; at least
        ``order + 1`` different times.
    z : (n, 3) float64, metres. The nearer to zero, the fewer digits are lost.
    variance : (n,) float64, of each coordinate of each point, m² (or any common unit).
    order : 2 for position, velocity, acceleration; 1 for position, velocity.

    Returns
    -------
    z_p : (3,) float64, metres.
    q : variance of each coordinate of z_p, in the unit of ``variance``: equation (16) without its
        first term, the tested point's own variance.
    """
    sort = np.argsort(t, kind='stable')
    # In units of the window's half-width every state weighs alike; otherwise seconds of 1e-6 to
    # the power of four spoil the digits of the covariance. The position has no unit of time.
    width = float(np.max(np.abs(t)))
    origin = z[sort[0]]
    position, q = _smooth(t[sort] / width, z[sort] - origin, variance[sort], order)
    return position + origin, q


def _smooth(t: Floats, z: Floats, variance: Floats, order: int) -> tuple[Floats, float]:
    """Filter forwards over sorted times, smooth backwards; return position and variance at 0."""
    asked = int(np.searchsorted(t, 0.0))
    times = np.insert(t, asked, 0.0)
    fixed = _fixing_points(t, order)
    measured: list[int | None] = [None if i in fixed else i for i in range(len(t))]
    measured.insert(asked, None)

    kalman = _start(t[fixed] - times[0], z[fixed], variance[fixed])
    steps = [_transition(dt, order) for dt in np.diff(times, prepend=times[0])]
    means, covariances = [], []
    for step, i in zip(steps, measured, strict=True):
        kalman.predict(F=step)
        if i is None:
            kalman.update(None)
        else:
            kalman.update(z[i].reshape(COORDINATES, 1), R=variance[i] * np.eye(COORDINATES))
        means.append(kalman.x)
        covariances.append(kalman.P)

    mean, covariance, _, _ = kalman.rts_smoother(
        np.array(means), np.array(covariances), Fs=steps, Qs=[kalman.Q] * len(steps)
    )
    return mean[asked].reshape(COORDINATES, order + 1)[:, 0], float(covariance[asked][0, 0])


def _start(t: Floats, z: Floats, variance: Floats) -> Any:
    """Make the filter whose state at time 0 is the one that exactly fits ``order + 1`` points."""
    size = len(t)
    design = np.array([[dt**c / factorial(c) for c in range(size)] for dt in t])
    solve = np.linalg.inv(design)
    kalman = _filterpy().KalmanFilter(dim_x=COORDINATES * size, dim_z=COORDINATES)
    kalman.x = (solve @ z).T.reshape(-1, 1)
    kalman.P = _per_coordinate(solve @ np.diag(variance) @ solve.T)
    kalman.H = _per_coordinate(np.eye(1, size))
    kalman.Q = np.zeros((COORDINATES * size, COORDINATES * size))
    return kalman


def _transition(dt: float, order: int) -> Floats:
    """State equations (1) to (3) over ``dt`` for x, y, z: dt, and half of its square."""
    one = np.zeros((order + 1, order + 1))
    for row in range(order + 1):
        for column in range(row, order + 1):
            one[row, column] = dt ** (column - row) / factorial(column - row)
    return _per_coordinate(one)


def _per_coordinate(block: Floats) -> Floats:
    """Repeat a block on the diagonal, for x, y and z, which know nothing of each other."""
    return np.kron(np.eye(COORDINATES), block).astype(np.float64)


def _fixing_points(t: Floats, order: int) -> list[int]:
    """Choose ``order + 1`` of the sorted times, as far from each other as there are."""
    if order == 1:
        return [0, len(t) - 1]
    between = int(np.argmax((t - t[0]) * (t[-1] - t)))
    return [0, between, len(t) - 1]


def _filterpy() -> Any:
    """Import filterpy's Kalman filters, or say what is missing."""
    try:
        return import_module('filterpy.kalman')
    except ImportError as err:
        raise ParameterError(
            'alpha_beta_gamma.engine',
            "'kernel' where the Python package filterpy is not installed",
            "'filterpy'",
        ) from err
