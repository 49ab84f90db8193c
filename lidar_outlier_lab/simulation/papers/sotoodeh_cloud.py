# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The cloud of :mod:`.sotoodeh_clusters` as one message, with its truth."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.messages.truth import Cause, Kind
from lidar_outlier_lab.simulation.papers import sotoodeh_clusters
from lidar_outlier_lab.simulation.world.recording import START, Cloud
from lidar_outlier_lab.simulation.world.sensors import FIRST, TRUTH

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

SINGLES = sotoodeh_clusters.STRAY + sotoodeh_clusters.NEAR_STRAY  # the first of the outliers


def cloud(seed: int, share: float | None, progress: Callable[[float], object]) -> Iterator[Cloud]:
    """Simulate Sotoodeh's cloud, all of one instant (t = 0); its share of outliers is fixed."""
    if share is not None:
        raise FilterError('the share', 'left as it is in this preset', share)
    scene = sotoodeh_clusters.simulate(seed)
    points = np.zeros(len(scene.xyz), np.dtype([*FIRST, *TRUTH]))
    for axis, name in enumerate('xyz'):
        points[name] = scene.xyz[:, axis]
    rank = np.cumsum(scene.outlier)
    cause = np.where(rank <= SINGLES, Cause.SINGLE, Cause.CLUSTER)
    points['label'] = np.where(scene.outlier, cause, Cause.GOOD)
    points['surface'] = np.where(scene.outlier, Kind.AIR, Kind.FACADE)
    progress(1.0)
    yield Cloud(START, START, points)
