# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Scanners without rings: where their prisms send the beams, and what a cloud of theirs holds."""

from dataclasses import replace

import numpy as np
import pytest

from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_lab.simulation.scenes.spinning_streets import dry_turn
from lidar_outlier_lab.simulation.weather.beams import beams_of
from lidar_outlier_lab.simulation.world.prisms import L2, MID_40, MID_360, FreeScanner, refract
from lidar_outlier_lab.simulation.world.recording import to_message

SCANNERS = {'Mid-40': MID_40, 'L2': L2, 'Mid-360': MID_360}
SHOTS = np.arange(100_000)


@pytest.mark.parametrize('angle', [0.0, 0.1, 0.6])
def test_refraction(angle: float) -> None:
    """A face bends as Snell's law says, within the plane of incidence; the way back undoes it."""
    beam = np.array([[np.cos(angle)], [np.sin(angle)], [0.0]])
    normal = np.array([[1.0], [0.0], [0.0]])
    bent = refract(beam, normal, 1.0 / 1.5)
    behind = np.arcsin(np.sin(angle) / 1.5)
    np.testing.assert_allclose(bent[:, 0], [np.cos(behind), np.sin(behind), 0.0], atol=1e-12)
    np.testing.assert_allclose(refract(bent, normal, 1.5), beam, atol=1e-12)


@pytest.mark.parametrize(
    ('name', 'level', 'upright'),
    [
        ('Mid-40', (-19.2, 19.2), (-19.2, 19.2)),
        ('L2', (-35.0, 35.0), (-37.2, 37.2)),
        ('Mid-360', (-180.0, 180.0), (-7.0, 52.0)),
    ],
)
def test_field_of_view(name: str, level: tuple[float, float], upright: tuple[float, float]) -> None:
    """Each sees as far to all sides as its maker says; beams have length one."""
    x, y, z = SCANNERS[name].directions(np.arange(500_000))
    np.testing.assert_allclose(x * x + y * y + z * z, 1.0, atol=1e-12)
    for angle, limits in ((np.arctan2(y, x), level), (np.arcsin(z), upright)):
        assert np.degrees([angle.min(), angle.max()]) == pytest.approx(limits, abs=0.1)


@pytest.mark.parametrize('name', SCANNERS)
def test_beams_of_a_cloud(name: str) -> None:
    """A cloud's points are on the beams of their times and lines; the others' beams are known."""
    scanner: FreeScanner = replace(SCANNERS[name], before=777, shots_per_line=3000)
    cloud = dry_turn(scanner, 3)
    points = Decoder(FilterParameters()).decode(to_message(cloud.stamp, cloud.points, cloud.frame))
    points = replace(points, t=points.t - cloud.stamp)
    assert 0 < len(points) < scanner.shots_per_line
    bright = np.linspace(0.1, 0.9, len(points))
    beams = beams_of(scanner, points, bright)
    assert len(beams) == scanner.shots_per_line
    there = np.flatnonzero(beams.source >= 0)
    of = beams.source[there]
    assert np.array_equal(np.sort(of), np.arange(len(points)))
    np.testing.assert_array_equal(beams.ring[there], points.line[of])
    np.testing.assert_array_equal(beams.t[there], points.t[of])
    np.testing.assert_array_equal(beams.reflectance[there], bright[of])
    position = beams.direction[there] * beams.range[there, None]
    np.testing.assert_allclose(position, points.xyz[of], atol=1e-4)
    assert np.isinf(np.delete(beams.range, there)).all()
    order = np.lexsort((beams.t, beams.ring))
    np.testing.assert_array_equal(order, np.arange(len(beams)))
