# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Weather in a cloud: statistics are those of the equations; the same seed gives the same."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.messages.truth import Cause
from lidar_outlier_lab.simulation.weather import drops, kinds, plumes
from lidar_outlier_lab.simulation.weather.beams import Beams, Optics

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
