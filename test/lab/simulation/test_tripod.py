# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Scans from a tripod: range images of a room and of a street of houses."""

from __future__ import annotations

import numpy as np
import pytest

from lidar_outlier_filter.messages.truth import Cause
from lidar_outlier_lab.simulation.papers import tripod


@pytest.fixture(scope='module')
def room() -> tripod.RangeImage:
    """Scan a room, coarsely."""
    return tripod.room(1, rows=60, columns=360)


def test_pixels_are_directions(room: tripod.RangeImage) -> None:
    """Row 0 looks up, the middle column ahead; every shot in a room has a point."""
    assert len(room.points) == 60 * 360
    from_scanner = room.xyz - [-1.2, 0.0, 1.3]
    elevation = room.image(np.arcsin(from_scanner[:, 2] / np.linalg.norm(from_scanner, axis=1)))
    np.testing.assert_allclose(elevation[0], np.radians(30), atol=0.01)
    np.testing.assert_allclose(elevation[-1], np.radians(-30), atol=0.01)
    azimuth = room.image(np.arctan2(from_scanner[:, 1], from_scanner[:, 0]))
    assert abs(azimuth[30, 180]) < 0.03
    assert azimuth[30, 90] == pytest.approx(np.pi / 2, abs=0.03)


def test_a_street_from_three_positions() -> None:
    """Flakes and mixed points are in every scan; the same seed gives the same."""
    scans = tripod.facades(3, rows=40, columns=120)
    again = tripod.facades(3, rows=40, columns=120)
    assert len(scans) == 3
    for one, other in zip(scans, again, strict=True):
        np.testing.assert_array_equal(one.points, other.points)
        assert Cause.SNOW in one.points['label']
