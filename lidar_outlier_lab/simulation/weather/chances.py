# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Weather without optics: the chance that a beam is stopped, and where.

Snow stops beams at lognormal ranges (Michaud et al. 2015), rain at Gamma ones, more in one
direction than in others; fog by its optical depth, as far as it is seen. Dust and spray are unions
of balls (Boolean model, Matheron 1975), in which a beam goes an exponential way. Brightness is a
Gamma variate. No law and no constant is that of other weather.
"""

import numpy as np

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_lab.simulation.papers.aerial import log_uniform
from lidar_outlier_lab.simulation.weather.beams import Beams, Optics
from lidar_outlier_lab.simulation.weather.echoes import BothEchoes, WeatherEchoes, surfaces
from lidar_outlier_lab.simulation.weather.kinds import WeatherSite, survey

KINDS = ('snow', 'rain', 'fog', 'spray', 'dust')
FREE_M = 60.0  # how far a beam without a return is followed
BEFORE_M = 0.1  # least distance before the surface
FLIGHT_M = 12.0  # of what a wheel throws up


def make_both(
    weather: str, beams: Beams, seed: int, optics: Optics, _returns: str = ''
) -> BothEchoes:
    """Let beams go through one of ``KINDS``; each return of a beam is listed, whatever is measured.

    As :func:`.kinds.make_both`, of another law.
    """
    rng, count = np.random.default_rng(seed), len(beams)
    reach = np.minimum(beams.range, FREE_M)
    kept = rng.uniform(0.4, 1.0, 1).repeat(count)
    if weather in {'spray', 'dust'}:
        far = _balls(weather == 'spray', beams, survey(beams), rng)
    elif weather == 'fog':
        extinction = 3.0 / log_uniform(rng, 20.0, 150.0)
        share = -np.expm1(-rng.uniform(1.0, 3.0) * extinction * np.minimum(reach, 30.0))
        far = _gamma(rng, rng.uniform(1.5, 6.0), rng.uniform(2.0, 9.0), count)
        far[rng.random(count) > share] = np.inf
        kept[rng.random(count) > np.exp(-extinction * np.maximum(reach - 10.0, 0.0))] = 0.0
    else:
        azimuth = np.arctan2(beams.direction[:, 1], beams.direction[:, 0])
        wind = 1.0 + rng.uniform(0.0, 0.8) * np.cos(azimuth - rng.uniform(-np.pi, np.pi))
        share = wind * (
            log_uniform(rng, 0.01, 0.35) if weather == 'snow' else log_uniform(rng, 0.003, 0.08)
        )
        if weather == 'snow':
            far = rng.lognormal(np.log(rng.uniform(2.5, 9.0)), rng.uniform(0.35, 0.8), count)
        else:
            far = _gamma(rng, rng.uniform(1.0, 3.0), rng.uniform(2.0, 12.0), count)
        far[rng.random(count) > share] = np.inf
    far[(far < optics.nearest) | (far > reach - BEFORE_M)] = np.inf
    # Chance says which of two returns is the stronger: most often the nearer one.
    stopped = np.isfinite(far) & (rng.random(count) < rng.uniform(0.6, 1.0))
    bright = rng.uniform(0.0, 0.2) * rng.gamma(rng.uniform(0.4, 4.0), 1.0, count)
    power = np.where(stopped, bright / np.where(stopped, far, 1.0) ** 2, 0.0)
    surface = surfaces(beams)
    left = np.where(stopped, np.minimum(surface.power, power / 2.0), kept * surface.power)
    return BothEchoes(
        WeatherEchoes(np.where(kept > 0, surface.distance, np.inf), left, surface.cause),
        WeatherEchoes(np.where(stopped, far, np.inf), power, stopped.astype(np.uint8)),
    )


def _balls(sprayed: bool, beams: Beams, site: WeatherSite, rng: np.random.Generator) -> Floats:  # noqa: FBT001
    """Return how far (N,) beams come in clouds of balls; inf: through."""
    far = np.full(len(beams), np.inf)
    for _ in range(int(rng.integers(1, 5))):
        away = rng.uniform(3.0, max(min(site.space, 25.0), 6.0))
        azimuth, heading = rng.uniform(-np.pi, np.pi, 2)
        start = np.array([away * np.cos(azimuth), away * np.sin(azimuth), site.ground])
        free = log_uniform(rng, 0.3, 8.0)
        for _ in range(int(rng.integers(10, 60))):
            way = rng.uniform(0.0, FLIGHT_M)
            if sprayed:  # flies as a stone does
                radius, up = rng.uniform(0.08, 0.5), 0.15 * way * (1.0 - way / FLIGHT_M)
            else:
                radius, up = rng.uniform(0.3, 1.8), rng.uniform(0.0, 0.15) * way
            aside = rng.normal(0.0, 0.25 * radius) + rng.normal(0.0, 0.05 * way)
            turned = np.array(
                [[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]]
            )
            centre = start + np.append(turned @ (way, aside), up + 0.5 * radius)
            stopped = _stop(beams, centre, radius, free * rng.uniform(0.5, 2.0), rng)
            far = np.minimum(far, stopped)
    far[np.where(np.isfinite(far), far, 0.0) * beams.direction[:, 2] < site.ground] = np.inf
    return far


def _stop(
    beams: Beams, centre: Floats, radius: float, free: float, rng: np.random.Generator
) -> Floats:
    """Return how far (N,) beams come that a ball stops, after an exponential way in it."""
    far, (along, square) = np.full(len(beams), np.inf), beams.through(centre, radius)
    met = np.flatnonzero((square > 0) & (along > 0) & (np.sum(centre**2) > (radius + 0.5) ** 2))
    depth, half = rng.exponential(free, len(met)), np.sqrt(square[met])
    far[met] = np.where(depth < 2.0 * half, along[met] - half + depth, np.inf)
    return far


def _gamma(rng: np.random.Generator, shape: float, mean: float, count: int) -> Floats:
    return rng.gamma(shape, mean / shape, count)
