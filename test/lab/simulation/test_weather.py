# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Weather in a cloud: by the equations of its sources, worked out by hand; a seed is a weather.

Beer and Lambert: e^(-2αr) comes back. Fog is that of Hahner et al. (2021): α = ln 20 ÷ MOR and
β = 0.046 ÷ MOR. What falls is that of LISA (Kilic et al. 2021).
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation.truth import Cause
from lidar_outlier_lab.simulation.weather import chances, drops, echoes, kinds, plumes
from lidar_outlier_lab.simulation.weather.beams import Beams, Optics, find_beams
from lidar_outlier_lab.training.scenes import LAWS

OPTICS = Optics()
# The receiver sees all of a beam, which is 1 cm wide everywhere, and almost no light suffices.
NARROW = Optics(divergence=0.0, aperture=0.01, nearest=1.0, farthest=1e6, blind=1e-6)
RINGS, COLUMNS = 16, 900


def turn(
    distance: Floats | float, columns: int = COLUMNS, rings: int = RINGS, high: float = 15.0
) -> Beams:
    """Return a turn whose beams meet surfaces at these distances; ``high`` is in degrees."""
    count = rings * columns
    azimuth = np.tile(np.pi - 2 * np.pi * np.arange(columns) / columns, rings)
    ring = np.repeat(np.arange(rings), columns)
    up = np.radians(np.linspace(-high, high, rings))[ring] if rings > 1 else np.zeros(count)
    level = np.cos(up)
    return Beams(
        np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(up)], axis=1),
        np.broadcast_to(np.asarray(distance, np.float64), count).copy(),
        np.full(count, 0.3),
        ring,
        np.tile(np.arange(columns) * 111_111, rings),
        np.arange(count),
    )


def level(distance: Floats | float, count: int = 2000) -> Beams:
    """Return level beams all around."""
    return turn(distance, count, 1)


def room() -> Beams:
    """Return a turn in a room with a ground, walls, a box and open sky above."""
    beams = turn(30.0)
    x, y, z = np.abs(beams.direction.T)
    walls = np.minimum(12.0 / np.maximum(x, 1e-9), 20.0 / np.maximum(y, 1e-9))
    down = np.where(beams.direction[:, 2] < 0, 1.8 / np.maximum(z, 1e-9), np.inf)
    box = (beams.direction[:, 0] > 0.9) & (np.abs(beams.direction[:, 2]) < 0.15)
    far = np.minimum(np.minimum(walls, down), np.where(box, 6.0, np.inf))
    far[beams.direction[:, 2] > 0.2] = np.inf
    return replace(beams, range=far)


def fog(sight: float, uneven: float = 0.0) -> plumes.Plume:
    """Return fog of a meteorological optical range, whose echoes do not fluctuate."""
    return plumes.Plume(density=np.log(20) / sight, ratio=65.0, uneven=uneven, grains=1e9, cell=0.2)


def struck(
    cloud: plumes.Plume, beams: Beams, optics: Optics = OPTICS, seed: int = 1
) -> tuple[Floats, Floats, Floats]:
    """Send beams through a cloud."""
    return plumes.strike(cloud, optics, beams, beams.range, np.random.default_rng(seed))


def make(
    name: str,
    beams: Beams,
    seed: int,
    returns: str = 'strongest',
    around: kinds.WeatherSite | None = None,
) -> echoes.WeatherEchoes:
    """Let beams go through a weather, and measure one return of each."""
    return echoes.choose(kinds.make_both(name, beams, seed, None, returns, (), around), returns)


@pytest.mark.parametrize('name', kinds.WEATHERS)
def test_same_seed_same_bytes(name: str) -> None:
    """And another seed gives another sweep; every outlier has a cause, and a range."""
    beams = room()
    one, same, other = (make(name, beams, seed) for seed in (3, 3, 4))
    assert one.distance.tobytes() == same.distance.tobytes() != other.distance.tobytes()
    assert one.cause.tobytes() == same.cause.tobytes()
    bad = one.cause > 0
    assert bad.any()
    assert np.isfinite(one.distance[bad]).all()
    # What is no outlier is where it was, or is not seen any more.
    left = ~bad & np.isfinite(one.distance)
    assert (one.distance[left] == beams.range[left]).all()


# What falls ---------------------------------------------------------------------------------------


def test_rain_and_snow_of_the_papers() -> None:
    """N(D) = 8000 e^(-4.1 R^-0.21 D) and 7600 R^-0.87 e^(-2.55 R^-0.48 D); water's ρ at 1.328."""
    rain, snow = drops.rain(10.0), drops.snow(0.5)
    assert (rain.number, snow.number) == pytest.approx((8000.0, 13_890.2), rel=1e-5)
    assert (rain.slope, snow.slope) == pytest.approx((2.52804, 3.55660), rel=1e-5)
    assert (rain.reflectance, snow.reflectance) == pytest.approx((0.0198508, 0.9), rel=1e-5)
    # α = 2 ∫ π/4 D² N(D) dD = π N0 ÷ Λ³, mm² per m³.
    assert (rain.extinction, snow.extinction) == pytest.approx((1.55558e-3, 9.6995e-4), rel=1e-4)


def test_least_drop_through_rain() -> None:
    """It is b √(P r² e^(2αr) ÷ ρ): at 10 m with α = 0.0785, 10 mm × √(1e-4 × 4.811 ÷ 0.9)."""
    fall = drops.Precipitation(2e5, 2.0, 0.9, 1000.0)
    found = drops.least_diameter(fall, NARROW, np.array([10.0]), np.array([1e-6]))
    assert found == pytest.approx([0.23120], rel=1e-3)


def test_as_many_drops_as_a_beam_holds() -> None:
    """N0 ÷ Λ = 4000 drops a m³ in a beam of 78.54 mm²: 0.31416 a metre, 3.1416 in 10 m."""
    count, fall = 20_000, drops.Precipitation(8000.0, 2.0, 0.9, 1000.0)
    rng = np.random.default_rng(1)
    where, far, _ = drops.strike(fall, NARROW, np.full(count, 11.0), np.zeros(count), rng)
    assert len(where) / count == pytest.approx(3.1416, rel=0.01)
    assert far.mean() == pytest.approx(6.0, abs=0.05)


@pytest.mark.parametrize(
    ('name', 'fall', 'cause', 'rates'),
    [
        ('heavy_snow', drops.snow, Cause.SNOW, (0.6, 5.0)),
        ('rain', drops.rain, Cause.RAIN, (5.0, 80.0)),
    ],
)
def test_share_of_beams_without_a_surface(
    name: str,
    fall: Callable[[float], drops.Precipitation],
    cause: Cause,
    rates: tuple[float, float],
) -> None:
    """It is 1 - e^(-H), H the sum of the chances along the beam, for the rate that is drawn."""
    beams = turn(np.inf)
    drawn = np.random.default_rng([7, list(kinds.WEATHERS).index(name)]).uniform(*np.log(rates))
    edges = np.linspace(OPTICS.nearest, drops.REACH, 100_001)
    noise = np.full(len(edges), OPTICS.floor)
    chance = drops.hazard(fall(float(np.exp(drawn))), OPTICS, edges, noise)
    total = np.concatenate([[0.0], np.cumsum((chance[1:] + chance[:-1]) / 2 * np.diff(edges))])
    share = float(-np.expm1(-total[-1]))
    site = kinds.WeatherSite(-1.8, 20.0)
    met = make(name, beams, 7, around=site).cause == cause
    assert met.any()
    assert met.mean() == pytest.approx(share, abs=float(5 * np.sqrt(share / len(beams))))
    # The first return is as far as the chances say.
    first = make(name, beams, 7, 'first', site)
    far = first.distance[first.cause == cause]
    law = stats.kstest(far, lambda d: np.interp(d, edges, -np.expm1(-total) / share))
    assert law.statistic < 0.02 + 1.6 / np.sqrt(len(far))


# What hangs ---------------------------------------------------------------------------------------


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
    beams = level(distance)
    _, _, left = struck(fog(sight), beams)
    assert left == pytest.approx(np.full(len(beams), through), rel=1e-3)


def test_an_echo_of_fog_comes_from_before_the_surface() -> None:
    """However the cells lie, and none where the surface is nearer than anything is seen."""
    beams = level(np.random.default_rng(5).uniform(0.3, 6.0, 20_000), 20_000)
    for cloud in (
        replace(fog(10.0, 0.5), cell=0.25, grains=1.0),
        plumes.Plume((plumes.PlumePuff((0.0, 0.0, 0.0), (3.0, 3.0, 1.0), 1.0),), grains=0.5),
    ):
        far, power, _ = struck(cloud, beams, seed=5)
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
    beams = level(50.0)
    far, power, _ = struck(replace(fog(sight), cell=0.01), beams, optics)
    r = np.linspace(5.0, 6.0, 10_001)
    expected = np.pi * beta * np.trapezoid(np.exp(-2 * alpha * r) / r**2, r)
    assert power == pytest.approx(np.full(len(beams), expected), rel=0.02)
    assert ((far > 5.0) & (far < 6.0)).all()


@pytest.mark.parametrize(('centre', 'nearest'), [(10.0, OPTICS.nearest), (3.0, 4.0)])
def test_a_puff_takes_light_there_and_back(centre: float, nearest: float) -> None:
    """A normal puff of density k and width s takes e^(-2 k s √(2π)) of a beam through its middle.

    Where it begins before the sensor can see, what is lost there counts, too.
    """
    puff = plumes.PlumePuff((-centre, 0.0, 0.0), (0.8, 0.8, 0.8), 0.5)
    _, _, left = struck(
        plumes.Plume((puff,), uneven=0.0, cell=0.05), level(20.0), Optics(nearest=nearest)
    )
    # Within 3 standard deviations: all but 0.3 %. The first beam points along -x.
    assert left[0] == pytest.approx(np.exp(-2 * 0.5 * 0.8 * np.sqrt(2 * np.pi)), rel=0.02)
    assert left[1000] == 1.0


# Beams --------------------------------------------------------------------------------------------


@pytest.mark.parametrize('way', [1.0, -1.0])
def test_beams_at_the_ends_of_a_ring_are_found(way: float) -> None:
    """As many as are missing there, where they are missing, whichever way the head turns."""
    columns, rings = 900, 4
    whole = turn(9.0, columns, rings, 6.0)
    azimuth = np.tile(0.3 + way * 2 * np.pi * np.arange(columns) / columns, rings)
    flat, up = np.hypot(*whole.direction[:, :2].T), whole.direction[:, 2]
    xyz = 9.0 * np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), up], axis=1)
    ring, column = whole.ring, np.tile(np.arange(columns), rings)
    kept = ~(((ring == 1) & (column >= 870)) | ((ring == 2) & (column < 40)))
    bright, every = whole.reflectance[kept], np.ones(int(kept.sum()), np.bool_)
    found = find_beams(xyz[kept], whole.t[kept], ring[kept], bright, every)
    for number, first, count in ((1, 870, 30), (2, 0, 40)):
        new = (found.ring == number) & (found.source < 0)
        assert new.sum() == count
        angle = azimuth[first : first + count]
        off = np.arctan2(*found.direction[new][:, 1::-1].T) - angle
        assert np.abs(np.angle(np.exp(1j * off))) == pytest.approx(0.0, abs=1e-6)
        assert np.abs(found.t[new] - 111_111 * (first + np.arange(count))).max() <= 111_111


@pytest.mark.parametrize(
    ('name', 'seed', 'words'),
    [('hail', 1, 'the weather must be'), ('rain', -1, 'the seed must be')],
)
def test_refused(name: str, seed: int, words: str) -> None:
    """In one sentence."""
    with pytest.raises(FilterError, match=words):
        kinds.make_both(name, turn(30.0), seed)


@pytest.mark.parametrize('name', chances.KINDS)
@pytest.mark.parametrize('law', LAWS)
def test_weather_of_other_laws(law: str, name: str) -> None:
    """Some beams are stopped before their surface, and what stops them is above the noise."""
    beams = room()
    both, same = (LAWS[law](name, beams, 5, OPTICS, 'last') for _ in range(2))
    surface, before = both
    np.testing.assert_array_equal(before.distance, same.before.distance)
    there = np.isfinite(before.distance)
    assert 9 < there.sum() < 0.9 * len(beams)
    assert (OPTICS.nearest <= before.distance[there]).all()
    assert (before.distance[there] < beams.range[there]).all()
    least = surface.power if law == 'chances' else np.zeros(len(beams))
    assert (before.power[there] > least[there]).all()
    assert np.isfinite(surface.distance).any()
