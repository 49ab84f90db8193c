# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Weather in a cloud: statistics are those of the equations; the same seed gives the same."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.messages.truth import Cause
from lidar_outlier_lab.simulation.weather import drops, kinds, plumes
from lidar_outlier_lab.simulation.weather.beams import Beams, Optics, find_beams

OPTICS = Optics()
RINGS, COLUMNS = 16, 900


def hall(distance: float = 30.0, reflectance: float = 0.3) -> Beams:
    """Return a sweep whose every beam meets a surface at one distance."""
    azimuth = np.tile(np.pi - 2 * np.pi * np.arange(COLUMNS) / COLUMNS, RINGS)
    ring = np.repeat(np.arange(RINGS), COLUMNS)
    up = np.radians(np.linspace(-15.0, 15.0, RINGS))[ring]
    direction = np.stack(
        [np.cos(up) * np.cos(azimuth), np.cos(up) * np.sin(azimuth), np.sin(up)], axis=1
    )
    count = len(ring)
    t = np.tile(np.arange(COLUMNS) * 111_111, RINGS)
    return Beams(
        direction,
        np.full(count, distance),
        np.full(count, reflectance),
        ring,
        t,
        np.arange(count),
    )


def room() -> Beams:
    """Return a sweep in a room with a ground, walls, a box and open sky above."""
    beams = hall()
    x, y, z = np.abs(beams.direction.T)
    walls = np.minimum(12.0 / np.maximum(x, 1e-9), 20.0 / np.maximum(y, 1e-9))
    down = np.where(beams.direction[:, 2] < 0, 1.8 / np.maximum(z, 1e-9), np.inf)
    box = (beams.direction[:, 0] > 0.9) & (np.abs(beams.direction[:, 2]) < 0.15)
    far = np.minimum(np.minimum(walls, down), np.where(box, 6.0, np.inf))
    far[beams.direction[:, 2] > 0.2] = np.inf
    return Beams(beams.direction, far, beams.reflectance, beams.ring, beams.t, beams.source)


@pytest.mark.parametrize('name', kinds.WEATHERS)
def test_same_seed_same_bytes(name: str) -> None:
    """And another seed gives another sweep; every outlier has a cause, and a range."""
    beams = room()
    one, same, other = (kinds.make(name, beams, seed) for seed in (3, 3, 4))
    assert one.distance.tobytes() == same.distance.tobytes()
    assert one.cause.tobytes() == same.cause.tobytes()
    assert one.distance.tobytes() != other.distance.tobytes()
    bad = one.cause > 0
    assert bad.any()
    assert np.isfinite(one.distance[bad]).all()
    # What is no outlier is where it was, or is not seen any more.
    left = ~bad & np.isfinite(one.distance)
    assert (one.distance[left] == beams.range[left]).all()


def test_fall_is_as_far_as_the_hazard_says() -> None:
    """Ranges of flakes follow the chance per metre, and so does their number."""
    fall, least = drops.snow(1.0), 4e-4
    count = 60_000
    rng = np.random.default_rng(1)
    where, far, echo = drops.strike(fall, OPTICS, np.full(count, 40.0), np.full(count, least), rng)
    edges = np.linspace(OPTICS.nearest, 40.0, 20_001)
    middle = (edges[1:] + edges[:-1]) / 2
    chance = drops.hazard(fall, OPTICS, middle, np.full(len(middle), least))
    total = np.concatenate([[0.0], np.cumsum(chance * np.diff(edges))])
    # Powers are tabulated in steps, a step is a few percent of the chance.
    assert len(where) == pytest.approx(count * total[-1], rel=0.08)
    found = stats.kstest(far, lambda d: np.interp(d, edges, total / total[-1]))
    assert found.statistic < 0.03
    assert (echo[far > 1.5] > 0.8 * least).all()
    assert np.bincount(where, minlength=count).var() == pytest.approx(total[-1], rel=0.1)


def test_hazard_has_its_peak_away_from_the_sensor() -> None:
    """Closed form without extinction: r² exp(-(r ÷ r0)²), r0² = D-scale × R √(ρp ÷ ρt) ÷ θ."""
    plain = Optics(divergence=0.003, aperture=0.0, blind=1e-6)
    fall = drops.Precipitation(8000.0, 2.0, 0.9, 1000.0)
    distance, wall = np.linspace(0.05, 15.0, 3000), 30.0
    least = np.full(len(distance), 0.3 / wall**2)
    clear = drops.hazard(fall, plain, distance, least)
    scale = wall * np.sqrt(0.9 / 0.3) / (fall.slope / 1e-3 * plain.divergence)
    expected = distance**2 * np.exp(-(distance**2) / scale)
    ratio = clear / expected
    assert distance[np.argmax(clear)] == pytest.approx(np.sqrt(scale), rel=0.03)
    near = distance < 2 * np.sqrt(scale)
    assert np.ptp(ratio[near]) / ratio[near].mean() < 0.1


@pytest.mark.parametrize('fall', [drops.rain(20.0), drops.snow(0.2), drops.snow(3.0)])
def test_extinction_of_a_fall(fall: drops.Precipitation) -> None:
    """Twice the cross-section of all drops: the integral of 2 π/4 D² N(D), whatever the rate."""
    size = np.linspace(0.0, 60.0 / fall.slope, 200_001)
    number = fall.number * np.exp(-fall.slope * size)
    whole = np.trapezoid(2.0 * np.pi / 4.0 * (size * 1e-3) ** 2 * number, size)
    assert fall.extinction == pytest.approx(whole, rel=1e-4)


def test_least_diameter() -> None:
    """Closed form without extinction: D = θ r² √(ρt ÷ ρp) ÷ R."""
    plain = Optics(divergence=0.003, aperture=0.0, blind=1e-6)
    fall = drops.Precipitation(1e-6, 2.0, 0.9, 1000.0)
    distance, wall, target = np.linspace(1.0, 25.0, 50), 40.0, 0.3
    least = drops.power(np.full(50, wall), np.full(50, target), 0.0)
    found = drops.least_diameter(fall, plain, distance, least) * 1e-3
    np.testing.assert_allclose(found, 0.003 * distance**2 * np.sqrt(target / 0.9) / wall, rtol=1e-6)


@pytest.mark.parametrize(
    ('name', 'fall', 'cause'),
    [('heavy_snow', drops.snow, Cause.SNOW), ('rain', drops.rain, Cause.RAIN)],
)
def test_share_of_beams_without_a_surface(
    name: str, fall: Callable[[float], drops.Precipitation], cause: Cause
) -> None:
    """It is 1 - e^(-H), H the sum of the chances along the beam, for the rate that is drawn."""
    beams = hall()
    beams = replace(beams, range=np.full(len(beams), np.inf))
    number = list(kinds.WEATHERS).index(name)
    low, high = {'heavy_snow': (0.6, 5.0), 'rain': (5.0, 80.0)}[name]
    drawn = np.random.default_rng([7, number]).uniform(np.log(low), np.log(high))
    edges = np.linspace(OPTICS.nearest, drops.REACH, 100_001)
    noise = np.full(len(edges), OPTICS.floor)
    chance = drops.hazard(fall(float(np.exp(drawn))), OPTICS, edges, noise)
    share = float(-np.expm1(-np.trapezoid(chance, edges)))
    site = kinds.WeatherSite(-1.8, 20.0)
    found = kinds.make(name, beams, 7, around=site)
    met = found.cause == cause
    assert met.any()
    assert met.mean() == pytest.approx(share, abs=float(5 * np.sqrt(share / len(beams))))
    # The first return is as far as the chances say.
    first = kinds.make(name, beams, 7, returns='first', around=site)
    total = np.concatenate([[0.0], np.cumsum((chance[1:] + chance[:-1]) / 2 * np.diff(edges))])
    far = first.distance[first.cause == cause]
    law = stats.kstest(far, lambda d: np.interp(d, edges, -np.expm1(-total) / share))
    assert law.statistic < 0.02 + 1.6 / np.sqrt(len(far))


def test_what_snow_leaves_of_a_surface() -> None:
    """Beer and Lambert: ρ e^(-2αR) ÷ R² comes back; far surfaces fall below the noise."""
    near, far = hall(30.0, 0.3), hall(90.0, 0.55)
    drawn = np.random.default_rng([2, 1]).uniform(np.log(0.6), np.log(5.0))
    alpha = drops.snow(float(np.exp(drawn))).extinction
    one = kinds.make('heavy_snow', near, 2, returns='last')
    np.testing.assert_allclose(one.power, 0.3 / 900.0 * np.exp(-2 * alpha * 30.0))
    assert 0.55 / 90.0**2 > OPTICS.floor > 0.55 / 90.0**2 * np.exp(-2 * alpha * 90.0)
    assert not (np.abs(kinds.make('heavy_snow', far, 2).distance - 90.0) < 1.0).any()


def test_fog_is_a_soft_target() -> None:
    """As Hahner et al. (2021): β = 0.046 ÷ MOR, and the echo is the pulse on e^(-2αr) ÷ r²."""
    sight = 60.0
    alpha = np.log(20.0) / sight
    assert alpha / 65.0 == pytest.approx(0.046 / sight, rel=0.005)
    beams = hall(100.0)
    cloud = plumes.Plume(density=alpha, ratio=65.0, uneven=0.0, grains=1e9, cell=0.02)
    rng = np.random.default_rng(1)
    distance, power, _ = plumes.strike(cloud, OPTICS, beams, beams.range, rng)
    middle = np.arange(OPTICS.nearest, plumes.FARTHEST, 0.001)
    echo = np.pi / 65.0 * alpha * OPTICS.overlap(middle) * np.exp(-2 * alpha * middle)
    echo /= middle**2
    half = int(OPTICS.pulse / 0.001 / 2)
    sums = np.cumsum(echo) * 0.001
    pulse = sums[2 * half :] - sums[: -2 * half]
    best = int(np.argmax(pulse))
    assert power == pytest.approx(np.full(len(beams), pulse[best]), rel=0.03)
    assert distance == pytest.approx(np.full(len(beams), middle[best + half]), abs=0.3)


def test_heavier_fall_is_more() -> None:
    """Shares grow with the rate, and light snow is less than heavy."""
    beams = hall()
    shares = []
    for rate in (0.05, 0.5, 5.0):
        where, _, _ = drops.strike(
            drops.snow(rate),
            OPTICS,
            beams.range,
            drops.power(beams.range, beams.reflectance, 0.0),
            np.random.default_rng(1),
        )
        shares.append(len(np.unique(where)) / len(beams))
    assert shares[0] < shares[1] < shares[2]


def test_extinction_of_an_even_cloud() -> None:
    """Beer and Lambert: what is left of the surface is e^(-2αR), whatever the cells."""
    beams = hall(8.0)
    cloud = plumes.Plume(density=0.1, uneven=0.0, grains=1e6, cell=0.05)
    _, _, left = plumes.strike(cloud, OPTICS, beams, beams.range, np.random.default_rng(1))
    expected = np.exp(-2 * 0.1 * 8.0)
    assert left == pytest.approx(np.full(len(beams), expected), rel=0.02)


def test_plumes_hang_together() -> None:
    """Beside a beam that a plume answers, most are answered by it, too; elsewhere none."""
    beams = room()
    puffs = (plumes.PlumePuff((6.0, 3.0, 0.0), (1.0, 1.0, 0.7), 1.5),)
    cloud = plumes.Plume(puffs, ratio=20.0)
    far, power, left = plumes.strike(cloud, OPTICS, beams, beams.range, np.random.default_rng(2))
    met = np.isfinite(far) & (power > OPTICS.floor)
    position = beams.direction[met] * far[met, None]
    assert (np.abs(position - np.array(puffs[0].centre)) < 3.6).all()
    beside = met[1:] & met[:-1]
    assert beside.sum() > 0.7 * met.sum()
    assert (left[~np.isfinite(far)] == 1.0).all()


@pytest.mark.parametrize('lost', [0.0, 0.2])
def test_missing_beams_are_found(lost: float) -> None:
    """Of a sweep of which returns are lost, the pattern is completed: where, and how many."""
    beams = hall()
    rng = np.random.default_rng(4)
    kept = rng.random(len(beams)) >= lost
    xyz = beams.direction * beams.range[:, None]
    found = find_beams(
        xyz[kept],
        beams.t[kept],
        beams.ring[kept],
        beams.reflectance[kept],
        np.ones(int(kept.sum()), np.bool_),
    )
    assert abs(len(found) - len(beams)) <= RINGS
    new = found.source < 0
    assert not np.isfinite(found.range[new]).any()
    off = angles(found.direction[new], beams.direction[~kept])
    assert (off < np.radians(0.3)).all() or not new.any()


def angles(some: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angle of each to the nearest of others."""
    return np.arccos(np.clip((some @ others.T).max(axis=1), -1, 1)) if len(some) else np.zeros(0)


def test_returns() -> None:
    """The first return finds more flakes than the strongest; the last is the surface."""
    beams = hall()
    first, strongest, last = (
        kinds.make('heavy_snow', beams, 1, returns=which)
        for which in ('first', 'strongest', 'last')
    )
    assert (first.cause == Cause.SNOW).sum() > (strongest.cause == Cause.SNOW).sum()
    assert not (last.cause == Cause.SNOW).any()


@pytest.mark.parametrize(
    ('name', 'seed', 'returns', 'words'),
    [
        ('hail', 1, 'first', 'the weather must be'),
        ('rain', -1, 'first', 'the seed must be'),
        ('rain', 1, 'second', 'the return must be'),
    ],
)
def test_refused(name: str, seed: int, returns: str, words: str) -> None:
    """In one sentence."""
    with pytest.raises(FilterError, match=words):
        kinds.make(name, hall(), seed, returns=returns)
