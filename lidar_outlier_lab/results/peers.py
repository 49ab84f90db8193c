# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What peers do on the same points: Open3D where it is installed, and their rules on scipy's tree.

A statistic is what a peer compares with its threshold: the larger, the more of an outlier.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial import cKDTree

from lidar_outlier_filter.core.kernels.threads import cores

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Bools, Floats


def has_open3d() -> bool:
    """Return whether Open3D is installed."""
    return find_spec('open3d') is not None


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
    found: Floats = np.asarray(distance)[:, 1:]
    return found


def searches() -> dict[str, Callable[[Floats, int], Floats]]:
    """Name the trees that are installed, each with what :func:`distances` does, on all cores."""
    every: dict[str, tuple[str, Callable[[Floats, int], Floats]]] = {
        "SciPy's cKDTree": ('scipy', lambda xyz, count: distances(xyz, count, workers=-1)),
        "scikit-learn's KDTree": ('sklearn', _sklearn),
        'pykdtree': ('pykdtree', _pykdtree),
        "small_gicp's KdTree": ('small_gicp', _small_gicp),
        "pynanoflann's KDTree": ('pynanoflann', _pynanoflann),
    }
    return {name: one for name, (module, one) in every.items() if find_spec(module) is not None}


def _sklearn(xyz: Floats, count: int) -> Floats:
    neighbours = import_module('sklearn.neighbors').NearestNeighbors(
        n_neighbors=count, algorithm='kd_tree', n_jobs=-1
    )
    return np.asarray(neighbours.fit(xyz).kneighbors()[0])


def _pykdtree(xyz: Floats, count: int) -> Floats:
    distance, _ = import_module('pykdtree.kdtree').KDTree(xyz).query(xyz, k=count + 1)
    return np.asarray(distance)[:, 1:]


def _small_gicp(xyz: Floats, count: int) -> Floats:
    module = import_module('small_gicp')
    tree = module.KdTree(module.PointCloud(xyz), num_threads=cores())
    _, square = tree.batch_knn_search(xyz, count + 1, num_threads=cores())
    found: Floats = np.sqrt(np.asarray(square, np.float64)[:, 1:])
    return found


def _pynanoflann(xyz: Floats, count: int) -> Floats:
    tree = import_module('pynanoflann').KDTree(n_neighbors=count + 1, leaf_size=10)
    tree.fit(xyz)
    distance, _ = tree.kneighbors(xyz, n_jobs=cores())
    return np.asarray(distance)[:, 1:]


def sor(xyz: Floats, count: int, deviations: float) -> Bools:
    """Return what SOR rejects; ``count`` neighbours, the point itself among them, as in Open3D."""
    mean = distances(xyz, count - 1, workers=-1).mean(axis=1)
    rejected: Bools = mean > mean.mean() + deviations * mean.std(ddof=1)
    return rejected


def lof(xyz: Floats, count: int) -> Floats:
    """Return the factors of scikit-learn's LOF."""
    found = import_module('sklearn.neighbors').LocalOutlierFactor(count, n_jobs=-1)
    found.fit(xyz)
    factor: Floats = -found.negative_outlier_factor_
    return factor


def dror(third: Floats, reach: NDArray[Any], least: float) -> Floats:
    """Return DROR's statistic: a distance ÷ range, 0 within the least radius, metres."""
    return np.where(third <= least, 0.0, third / reach)
