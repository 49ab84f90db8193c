# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What peers do on the same points: Open3D where it is installed, and their rules on scipy's tree.

A statistic is what a peer compares with its threshold: the larger, the more of an outlier.
"""

from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_outlier_filter.cli.terminal import say
from lidar_outlier_filter.core.annotations import Bools, Floats
from lidar_outlier_filter.core.kernels.threads import cores
from lidar_outlier_filter.errors import quote_error


@cache
def loads(module: str) -> bool:
    """Return whether a peer can be loaded; say once why not, where it is installed."""
    if find_spec(module) is None:
        return False
    try:
        import_module(module)
    except (ImportError, OSError) as err:  # as where a library of the system lacks
        say(f'{module} is left out: it is installed, but cannot be loaded ({quote_error(err)})')
        return False
    return True


def open3d_cloud(xyz: Floats) -> Any:
    """Give points (N, 3), metres, to Open3D."""
    open3d = import_module('open3d')
    return open3d.geometry.PointCloud(open3d.utility.Vector3dVector(xyz))


def rejected_but(kept: Any, count: int) -> Bools:
    """Return which of so many points are rejected, (count,), where Open3D names those it keeps."""
    rejected = np.ones(count, np.bool_)
    rejected[np.asarray(kept, np.intp)] = False
    return rejected


def distances(xyz: Floats, count: int, workers: int = 1) -> Floats:
    """Return the distances (N, count), metres, to so many nearest others, the nearest first."""
    distance, _ = cKDTree(xyz).query(xyz, count + 1, workers=workers)
    return np.asarray(distance)[:, 1:]


def sor(xyz: Floats, count: int, deviations: float) -> Bools:
    """Return what SOR rejects; ``count`` neighbours, the point itself among them, as in Open3D."""
    return _far(distances(xyz, count - 1, workers=-1), deviations)


def small_gicp_sor(xyz: Floats, count: int, deviations: float) -> Bools:
    """Return the same by the kd-tree of small_gicp."""
    tree = import_module('small_gicp').KdTree(xyz, cores())
    _, squared = tree.batch_knn_search(xyz, count, cores())
    return _far(np.sqrt(squared)[:, 1:], deviations)


def _far(others: Floats, deviations: float) -> Bools:
    mean = others.mean(axis=1)
    return mean > mean.mean() + deviations * mean.std(ddof=1)


def lof(xyz: Floats, count: int) -> Floats:
    """Return the factors of scikit-learn's LOF."""
    found = import_module('sklearn.neighbors').LocalOutlierFactor(count, n_jobs=-1)
    found.fit(xyz)
    return -found.negative_outlier_factor_


def dror(third: Floats, reach: NDArray[Any], least: float) -> Floats:
    """Return DROR's statistic: a distance ÷ range, 0 within the least radius, metres."""
    return np.where(third <= least, 0.0, third / reach)
