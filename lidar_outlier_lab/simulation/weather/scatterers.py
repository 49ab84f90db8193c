# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Weather whose particles are in space: several beams, and rings, meet the same one.

Flakes fall in clusters (Thomas 1949), drops evenly and, where they splash, above the ground. A
particle's share of a Gaussian beam is (D / b)² exp(-8 θ² / b²) (Roy et al. 2020). Fog is what a
photon counter sees of it: the first photon, a chance per metre that falls with e^(-2αr) ÷ r². Dust
and spray are parcels that walk at random in the wind (Langevin 1908), and grow.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_lab.simulation.papers.aerial import log_uniform
from lidar_outlier_lab.simulation.weather.beams import Beams, Optics
from lidar_outlier_lab.simulation.weather.echoes import BothEchoes, WeatherEchoes, surfaces
from lidar_outlier_lab.simulation.weather.kinds import WeatherSite, survey

REACH_M = 20.0
MAX_COUNT = 60_000  # particles
STEPS_M = np.linspace(0.1, REACH_M, 200)
WALK_STEPS, KEPT = 40, 0.85  # of a parcel, and what is left of its speed after one
START_M = 0.2  # above the ground, where parcels begin
NEAREST_M = 0.2


def make_both(
    weather: str, beams: Beams, seed: int, optics: Optics, returns: str = 'strongest'
) -> BothEchoes:
    """Let beams go through one of ``chances.KINDS``; as :func:`.kinds.make_both`."""
    rng, site, surface = np.random.default_rng(seed), survey(beams), surfaces(beams)
    left = np.ones(len(beams))
    if weather in {'snow', 'rain'}:
        far, power = _falling(weather, beams, optics, returns, rng)
    else:
        if weather == 'fog':
            far, left = _photons(beams, optics, rng)
        else:
            far, left = _parcels(weather, beams, site, rng)
        bright = rng.uniform(0.02, 0.2) * rng.gamma(2.0, 0.5, len(beams))
        near = np.where(np.isfinite(far), far, 1.0)
        power = bright * np.exp(-near / rng.uniform(3.0, 20.0)) / near**2
    stopped = np.isfinite(far) & (far >= optics.nearest) & (far < beams.range)
    left = surface.power * left
    if weather not in {'snow', 'rain'}:  # what stops a beam is the stronger
        left = np.where(stopped, np.minimum(left, power / 2.0), left)
    dimmed = WeatherEchoes(surface.distance, left, surface.cause)
    before = WeatherEchoes(
        np.where(stopped, far, np.inf), np.where(stopped, power, 0.0), stopped.astype(np.uint8)
    )
    return BothEchoes(dimmed.above(optics.floor), before)


def _photons(beams: Beams, optics: Optics, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Return where (N,) the first photon of fog comes from, and what is left of the light."""
    alpha = 3.0 / log_uniform(rng, 20.0, 150.0)
    chance = optics.overlap(STEPS_M) * np.exp(-2.0 * alpha * STEPS_M) / STEPS_M**2
    chance *= 4.0 * rng.uniform(0.05, 2.0) * np.log10(1.0 + 20.0 * alpha)
    total = np.cumsum(chance) * (STEPS_M[1] - STEPS_M[0])
    far = np.interp(rng.exponential(1.0, len(beams)), total, STEPS_M, right=np.inf)
    reach = np.where(np.isfinite(beams.range), beams.range, 0.0)
    return far, np.exp(-2.0 * alpha * reach)


def _falling(
    weather: str, beams: Beams, optics: Optics, returns: str, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Return how far (N,) the particle is that each beam measures, and its echo; inf: none."""
    far, power = np.full(len(beams), np.inf), np.zeros(len(beams))
    xyz, size, bright = _particles(weather, survey(beams), rng)
    reach = np.sqrt((xyz**2).sum(axis=1))
    beam, particle, off = _meetings(beams, xyz, 0.6 * optics.diameter(reach) / reach)
    reach = reach[particle]
    wide = optics.diameter(reach)
    echo = bright * np.minimum((size[particle] / wide) ** 2, 1.0) * optics.overlap(reach)
    echo *= np.exp(-8.0 * (off * reach / wide) ** 2) / reach**2
    good = (echo > optics.floor) & (reach < beams.range[beam]) & (reach > optics.nearest)
    if returns == 'strongest':
        good &= echo > surfaces(beams).power[beam]
    beam, reach, echo = beam[good], reach[good], echo[good]
    order = np.lexsort((reach if returns == 'first' else -echo, beam))
    order = order[np.flatnonzero(np.diff(beam[order], prepend=-1))]
    far[beam[order]], power[beam[order]] = reach[order], echo[order]
    return far + rng.uniform(0.005, 0.03) * rng.standard_normal(len(beams)), power


def _particles(
    weather: str, site: WeatherSite, rng: np.random.Generator
) -> tuple[Floats, Floats, float]:
    """Return particles (N, 3), their diameters, metres, and their reflectance."""
    if weather == 'snow':
        mean, bright, least = rng.uniform(1.5e-3, 5e-3), rng.uniform(0.2, 0.9), 2000.0
        each = rng.uniform(1.0, 12.0)
    else:
        mean, bright, least = rng.uniform(0.7e-3, 2e-3), rng.uniform(0.1, 0.6), 6000.0
        each = 1.0
    many = int(log_uniform(rng, least, MAX_COUNT) / each)
    way = rng.standard_normal((many, 3)) * (1.0, 1.0, 0.5)
    way /= np.sqrt((way**2).sum(axis=1))[:, None]
    # More at near ranges than evenly in space: those far away are not seen.
    way *= (REACH_M * rng.random(many) ** (1.0 / rng.uniform(1.5, 3.0)))[:, None]
    xyz = np.repeat(way, rng.poisson(each, many), axis=0)
    if weather == 'snow':
        xyz += rng.uniform(0.1, 0.8) * rng.standard_normal(xyz.shape)
    else:
        splash = rng.random(len(xyz)) < rng.uniform(0.0, 0.2)
        xyz[splash, 2] = site.ground + rng.exponential(0.05, splash.sum())
    xyz = xyz[(xyz[:, 2] > site.ground) & ((xyz**2).sum(axis=1) > NEAREST_M**2)]
    return xyz, rng.exponential(mean, len(xyz)) + 0.3 * mean, bright


def _parcels(
    weather: str, beams: Beams, site: WeatherSite, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Return how far (N,) beams come among parcels, and the share of light that comes through."""
    xyz, radius = [], []
    for number in range(int(rng.integers(1, 5))):
        away = rng.uniform(3.0, max(min(site.space, 25.0), 6.0))
        azimuth, heading = rng.uniform(-np.pi, np.pi, 2)
        heading = azimuth + 0.2 * heading if number == 0 else heading
        many = int(rng.integers(300, 2500))
        step = rng.uniform(0.5, 1.0) * rng.uniform(4.0, 14.0) / WALK_STEPS
        eddy = rng.uniform(0.15, 0.6) * (0.5 if weather == 'spray' else 1.0)
        eddy *= np.sqrt(1.0 - KEPT**2)
        wind = np.array([np.cos(heading), np.sin(heading), 0.0])
        walk, speed = np.zeros((many, 3)), np.zeros((many, 3))
        age = rng.integers(1, WALK_STEPS, many)
        for k in range(WALK_STEPS):
            speed = KEPT * speed + eddy * rng.standard_normal(speed.shape)
            walk += np.where((k < age)[:, None], step * (speed + wind), 0.0)
        walk[:, 2] = np.abs(walk[:, 2])
        start = away * np.cos(azimuth), away * np.sin(azimuth), site.ground + START_M
        xyz.append(walk + np.array(start))
        grown = rng.uniform(0.02, 0.08) if weather == 'spray' else rng.uniform(0.04, 0.15)
        radius.append(grown * np.sqrt(1.0 + age * step))
    every, wide = np.concatenate(xyz), np.concatenate(radius)
    away_m = np.sqrt((every**2).sum(axis=1))
    fine = away_m > 1.0 + wide
    every, wide, away_m = every[fine], wide[fine], away_m[fine]
    beam, parcel, _ = _meetings(beams, every, wide / away_m)
    dense = rng.uniform(0.02, 0.5)
    hit = rng.random(len(beam)) < dense
    reach = away_m[parcel] + 0.7 * wide[parcel] * rng.standard_normal(len(parcel))
    far = np.full(len(beams), np.inf)
    np.minimum.at(far, beam[hit], reach[hit])
    return far, np.exp(-dense * np.bincount(beam, minlength=len(beams)))


def _meetings(
    beams: Beams, xyz: Floats, angle: Floats
) -> tuple[NDArray[np.intp], NDArray[np.intp], Floats]:
    """Return which beams pass which particles (N, 3) within an angle (N,), rad, and at which."""
    direction = xyz / np.sqrt((xyz**2).sum(axis=1))[:, None]
    tree = cKDTree(beams.direction)
    found = tree.query_ball_point(direction, angle, return_sorted=True)
    sizes = np.array([len(one) for one in found], np.intp)
    beam = np.array([number for one in found for number in one], np.intp)
    particle = np.repeat(np.arange(len(xyz)), sizes)
    off = beams.direction[beam] - direction[particle]
    return beam, particle, np.sqrt((off**2).sum(axis=1))
