# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Weather against the equations of its sources, worked out by hand: no formula of the package.

Beer and Lambert: e^(-2αr) comes back. Fog is that of Hahner et al. (2021): α = ln 20 ÷ MOR and
β = 0.046 ÷ MOR. What falls is that of LISA (Kilic et al. 2021).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from lidar_outlier_lab.simulation.weather import drops, plumes
from lidar_outlier_lab.simulation.weather.beams import Beams, Optics, find_beams

if TYPE_CHECKING:
    from lidar_outlier_filter.core.annotations import Floats

# The receiver sees all of a beam, which is 1 cm wide everywhere, and almost no light suffices.
NARROW = Optics(divergence=0.0, aperture=0.01, nearest=1.0, farthest=1e6, blind=1e-6)


def sweep(distance: Floats | float, count: int = 2000, reflectance: float = 0.3) -> Beams:
    """Return beams all around at level, whose surfaces are at these distances."""
    azimuth = np.linspace(0.0, 2 * np.pi, count, endpoint=False)
    return Beams(
        np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(count)], axis=1),
        np.broadcast_to(np.asarray(distance, np.float64), count).copy(),
        np.full(count, reflectance),
        np.zeros(count, np.int64),
        50_000 * np.arange(count),
        np.arange(count),
    )


def fog(sight: float, uneven: float = 0.0) -> plumes.Plume:
    """Return fog of a meteorological optical range, whose echoes do not fluctuate."""
    return plumes.Plume(density=np.log(20) / sight, ratio=65.0, uneven=uneven, grains=1e9, cell=0.2)


@pytest.mark.parametrize(
    ('sight', 'distance', 'through'),
    [
        # 20^(-2r ÷ MOR)
        (25.0, 30.0, 7.543e-4),
        (50.0, 100.0, 6.25e-6),
        (150.0, 3.0, 0.8871),
        (30.0, 0.5, 0.9050),
    ],
)
def test_fog_dims_a_surface_on_the_whole_way(sight: float, distance: float, through: float) -> None:
    """At the optical range a twentieth is left one way, from the sensor to the surface."""
    beams = sweep(distance)
    _, _, left = plumes.strike(fog(sight), Optics(), beams, beams.range, np.random.default_rng(1))
    assert left == pytest.approx(np.full(len(beams), through), rel=1e-3)


def test_an_echo_of_fog_comes_from_before_the_surface() -> None:
    """However the cells lie, and none where the surface is nearer than anything is seen."""
    rng = np.random.default_rng(5)
    beams = sweep(rng.uniform(0.3, 6.0, 20_000), 20_000)
    for cloud in (
        replace(fog(10.0, 0.5), cell=0.25, grains=1.0),
        plumes.Plume((plumes.PlumePuff((0.0, 0.0, 0.0), (3.0, 3.0, 1.0), 1.0),), grains=0.5),
    ):
        far, power, _ = plumes.strike(cloud, Optics(), beams, beams.range, rng)
        met = np.isfinite(far)
        assert met.sum() > 10_000
        assert (far[met] < beams.range[met]).all()
        assert (far[met] >= 0.8).all()
        assert (power[~met] == 0.0).all()
        # Some lie in the last cell.
        assert (far[met] > beams.range[met] - 0.05).any()


@pytest.mark.parametrize('sight', [5.0, 20.0, 100.0])
def test_power_of_an_echo_of_fog(sight: float) -> None:
    """Hahner: π β ∫ e^(-2αr) ÷ r² dr over a pulse, in the unit of a white surface's 1 ÷ r²."""
    optics = Optics(nearest=5.0, blind=1e-6, pulse=1.0)
    alpha, beta = np.log(20) / sight, 0.046 / sight
    beams = sweep(50.0)
    cloud = replace(fog(sight), cell=0.01)
    far, power, _ = plumes.strike(cloud, optics, beams, beams.range, np.random.default_rng(1))
    r = np.linspace(5.0, 6.0, 10_001)
    expected = np.pi * beta * np.trapezoid(np.exp(-2 * alpha * r) / r**2, r)
    assert power == pytest.approx(np.full(len(beams), expected), rel=0.02)
    assert ((far > 5.0) & (far < 6.0)).all()


def test_a_puff_takes_light_there_and_back() -> None:
    """A normal puff of density k and width s takes e^(-2 k s √(2π)) of a beam through its middle.

    Where it begins before the sensor can see, what is lost there counts, too.
    """
    for centre, optics in ((10.0, Optics()), (3.0, Optics(nearest=4.0))):
        puff = plumes.PlumePuff((centre, 0.0, 0.0), (0.8, 0.8, 0.8), 0.5)
        cloud = plumes.Plume((puff,), uneven=0.0, cell=0.05)
        beams = sweep(20.0)
        _, _, left = plumes.strike(cloud, optics, beams, beams.range, np.random.default_rng(1))
        # Within 3 standard deviations: all but 0.3 %.
        assert left[0] == pytest.approx(np.exp(-2 * 0.5 * 0.8 * np.sqrt(2 * np.pi)), rel=0.02)
        assert left[1000] == 1.0


def test_rain_and_snow_of_the_papers() -> None:
    """N(D) = 8000 e^(-4.1 R^-0.21 D) and 7600 R^-0.87 e^(-2.55 R^-0.48 D); water's ρ at 1.328."""
    rain, snow = drops.rain(10.0), drops.snow(0.5)
    assert (rain.number, snow.number) == pytest.approx((8000.0, 13_890.2), rel=1e-5)
    assert (rain.slope, snow.slope) == pytest.approx((2.52804, 3.55660), rel=1e-5)
    assert (rain.reflectance, snow.reflectance) == pytest.approx((0.0198508, 0.9), rel=1e-5)
    # α = 2 ∫ π/4 D² N(D) dD = π N0 ÷ Λ³, mm² per m³.
    assert (rain.extinction, snow.extinction) == pytest.approx((1.55558e-3, 9.6995e-4), rel=1e-4)


def test_as_many_drops_as_a_beam_holds() -> None:
    """N0 ÷ Λ = 4000 drops a m³ in a beam of 78.54 mm²: 0.31416 a metre, 3.1416 in 10 m."""
    count = 20_000
    fall = drops.Precipitation(8000.0, 2.0, 0.9, 1000.0)
    where, far, _ = drops.strike(
        fall, NARROW, np.full(count, 11.0), np.zeros(count), np.random.default_rng(1)
    )
    assert len(where) / count == pytest.approx(3.1416, rel=0.01)
    assert far.mean() == pytest.approx(6.0, abs=0.05)


def test_least_drop_through_rain() -> None:
    """It is b √(P r² e^(2αr) ÷ ρ): at 10 m with α = 0.0785, 10 mm × √(1e-4 × 4.811 ÷ 0.9)."""
    fall = drops.Precipitation(2e5, 2.0, 0.9, 1000.0)
    found = drops.least_diameter(fall, NARROW, np.array([10.0]), np.array([1e-6]))
    assert found == pytest.approx([0.23120], rel=1e-3)


@pytest.mark.parametrize('way', [1.0, -1.0])
def test_beams_at_the_ends_of_a_ring_are_found(way: float) -> None:
    """As many as are missing there, where they are missing, whichever way the head turns."""
    columns, rings = 900, 4
    step = way * 2 * np.pi / columns
    azimuth = np.tile(0.3 + step * np.arange(columns), rings)
    ring, column = np.repeat(np.arange(rings), columns), np.tile(np.arange(columns), rings)
    up = np.radians(np.array([-6.0, -2.0, 2.0, 6.0]))[ring]
    xyz = 9.0 * np.stack(
        [np.cos(up) * np.cos(azimuth), np.cos(up) * np.sin(azimuth), np.sin(up)], axis=1
    )
    gone = ((ring == 1) & (column >= 870)) | ((ring == 2) & (column < 40))
    t = 111_111 * column
    every = np.ones(len(ring), np.bool_)
    found = find_beams(
        xyz[~gone], t[~gone], ring[~gone], np.full(len(ring), 0.3)[~gone], every[~gone]
    )
    for number, first, count in ((1, 870, 30), (2, 0, 40)):
        new = (found.ring == number) & (found.source < 0)
        assert new.sum() == count
        direction = found.direction[new]
        angle = 0.3 + step * (first + np.arange(count))
        off = np.arctan2(direction[:, 1], direction[:, 0]) - angle
        assert np.abs(np.angle(np.exp(1j * off))) == pytest.approx(0.0, abs=1e-6)
        assert np.abs(found.t[new] - 111_111 * (first + np.arange(count))).max() <= 111_111
