# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Spinning scanners: rings, times, the frame, what they see; each figure measured in the points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lidar_outlier_filter.messages.truth import Kind
from lidar_outlier_lab.simulation.scenes.spinning_streets import SENSORS, rings
from lidar_outlier_lab.simulation.world.drive import Disturbances, Drive, Returns, simulate
from lidar_outlier_lab.simulation.world.recording import messages
from lidar_outlier_lab.simulation.world.scene import Scene
from lidar_outlier_lab.simulation.world.sensors import SpinningScanner
from lidar_outlier_lab.simulation.world.surfaces import Box, Ground
from lidar_outlier_lab.simulation.world.trajectory import Route

QUIET = Disturbances(reflection=0.0, near_surface=0.0)
FLAT = Scene((Ground(-500.0, 500.0, 500.0),))
STANDING = Route(((0.0, 0.0, 0.0),), (0.0, 0.0, 0.0), bump=0.0, tremble=0.0, mount=(0.0, 0.0, 1.9))
SMALL = SpinningScanner(elevation=rings(-20.0, 4.0, 4), columns=500, column_time=200_000)


def drive(scene: Scene = FLAT, sensor: SpinningScanner = SMALL, turns: int = 2) -> Drive:
    """Stand in a scene."""
    return Drive(scene, turns, sensor, STANDING, QUIET, in_own_frame=True)


def returns(some: Drive) -> Returns:
    """Cast a whole drive."""
    blocks = [block for _, block in simulate(some)]
    return Returns(*(np.concatenate(parts) for parts in zip(*blocks, strict=True)))


@pytest.mark.parametrize('count', SENSORS)
def test_sensors_have_their_rings(count: int) -> None:
    """Each sensor has as many rings as its name says, and turns ten times a second."""
    sensor = SENSORS[count]
    assert sensor.rings == count
    assert sensor.lines_per_second == pytest.approx(10.0, rel=0.01)
    assert sensor.shots_per_line == count * sensor.columns
    # Above and below a plain all lasers that look down see it, and no other.
    points = returns(replace(drive(sensor=replace(sensor, farthest=1e6, weakest=0.0)), lines=1))
    below = np.flatnonzero(np.array(sensor.elevation) < 0.0)
    np.testing.assert_array_equal(np.unique(points.points['ring']), below)


def test_points_lie_in_their_rings() -> None:
    """A ring's points have its elevation, and come in the order in which the head turns."""
    box = Box((-9.0, -9.0, -9.0), (9.0, 9.0, 9.0), Kind.FACADE)
    walls = tuple(
        replace(box, low=low, high=high)
        for low, high in (
            ((8.0, -9.0, -9.0), (9.0, 9.0, 9.0)),
            ((-9.0, -9.0, -9.0), (-8.0, 9.0, 9.0)),
            ((-9.0, 8.0, -9.0), (9.0, 9.0, 9.0)),
            ((-9.0, -9.0, -9.0), (9.0, -8.0, 9.0)),
        )
    )
    shot, points = returns(drive(Scene(walls), turns=1))
    assert len(shot) == SMALL.shots_per_line
    x, y, z = (points[axis].astype(np.float64) for axis in 'xyz')
    for ring, elevation in enumerate(SMALL.elevation):
        some = points['ring'] == ring
        up = np.arctan2(z, np.hypot(x, y))[some]
        np.testing.assert_allclose(up, elevation, atol=1e-6)
        azimuth = np.unwrap(np.arctan2(y, x)[some])
        assert (np.diff(azimuth) < 0.0).all()  # clockwise
        steps = np.diff(azimuth) / (2.0 * np.pi / SMALL.columns)
        np.testing.assert_allclose(steps, -1.0, atol=1e-3)
    # The first laser of the first column looks straight back.
    assert (x[0], y[0]) == pytest.approx((-8.0, 0.0), abs=0.06)
    np.testing.assert_array_equal(points['ring'], shot % 4)


def test_time_of_each_point() -> None:
    """Every point has its own time; along a ring they are a column apart."""
    some = drive(turns=3)
    shot, _ = returns(some)
    clouds = list(messages(some, simulate(some), 1))
    assert [cloud.frame for cloud in clouds] == ['lidar'] * 3
    turn = SMALL.columns * SMALL.column_time
    assert np.diff([cloud.stamp for cloud in clouds]).tolist() == [turn] * 2
    assert [cloud.sent - cloud.stamp for cloud in clouds] == [turn] * 3
    times = np.concatenate([cloud.stamp + cloud.points['t'].astype(np.int64) for cloud in clouds])
    ring = np.concatenate([cloud.points['ring'] for cloud in clouds])
    assert (np.diff(times) > 0).all()
    np.testing.assert_array_equal(times - clouds[0].stamp, shot * 50_000)
    for number in np.unique(ring):
        assert set(np.diff(times[ring == number])) == {SMALL.column_time}
