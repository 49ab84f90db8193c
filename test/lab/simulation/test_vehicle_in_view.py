# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A simulated vehicle in view of its sensor: a mask of one street finds it in another."""

from __future__ import annotations

import numpy as np
import pytest

from lidar_outlier_filter.core.points.mask import MaskLearner
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.messages.truth import Kind
from lidar_outlier_lab.simulation.scenes.own_vehicle import drive
from lidar_outlier_lab.simulation.world.recording import clouds


def points_of(rows: np.ndarray) -> Points:
    """Take all for valid points."""
    xyz = np.stack([rows[axis].astype(np.float64) for axis in 'xyz'], axis=1)
    nothing, valid = np.zeros(len(rows), np.int64), np.ones(len(rows), np.bool_)
    return Points(xyz, nothing, rows['ring'].astype(np.int64), valid)


@pytest.mark.slow
def test_a_mask_of_one_street_fits_in_another() -> None:
    """All that the sensor sees of its vehicle is found, and nothing else."""
    learner = MaskLearner(10.0)
    for _, rows in clouds(drive(24, 1, columns=250), 1):
        learner.add(points_of(rows))
    assert learner.taken >= 10
    mask, found, others = learner.learn(), [], []
    for _, rows in clouds(drive(3, 2, columns=250), 1):
        covered = mask.covers(points_of(rows), 0.1)
        own = rows['surface'] == Kind.OWN
        found.append(covered[own])
        others.append(covered[~own])
    assert np.concatenate(found).mean() > 0.995
    assert len(np.concatenate(found)) > 1000
    assert np.concatenate(others).mean() < 1e-4


def test_a_vehicle_that_stands_sees_one_scene() -> None:
    """Cars that pass are no motion of one's own."""
    learner = MaskLearner(10.0)
    for _, rows in clouds(drive(4, 1, speed=0.0, columns=250), 1):
        learner.add(points_of(rows))
    assert (learner.looks, learner.taken) == (4, 1)
