# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Weather as waveforms in bins of range, which a receiver with a time-varying gain reads.

Rain has lognormal drops (Feingold and Levin 1986), snow exponential flakes (Sekhon and Srivastava
1970) of a low density. Each bin holds a Poisson number of particles, whose density is uneven by
random plane waves (Kraichnan 1970). Fog, dust and spray are soft targets convolved with a sin²
pulse (Rasshofer et al. 2011). Plumes are wakes that widen with the third root of the distance and
have a sharp edge, (1 - η^1.5)² (Schlichting 1930).
"""

from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import convolve1d

from lidar_outlier_filter.core.annotations import Singles
from lidar_outlier_lab.simulation.papers.aerial import log_uniform
from lidar_outlier_lab.simulation.weather.beams import Beams, Optics
from lidar_outlier_lab.simulation.weather.echoes import BothEchoes, WeatherEchoes, surfaces
from lidar_outlier_lab.simulation.weather.kinds import WeatherSite, survey

BIN_M, BINS = 0.25, 100
MIDDLE: Any = (BIN_M * (np.arange(BINS) + 0.5)).astype(np.float32)  # Singles; Optics takes Floats
AT_ONCE = 1 << 13  # beams
WAVES = 6
WAKE_M, WAKES = 18.0, (2, 7)  # length of a wake, and how many there are


class _Air(NamedTuple):
    """What is in the air.

    Attributes
    ----------
    number, size, spread, bright : particles per m³, metres, standard deviation of the logarithm of
        the size (0: exponential), reflectance
    extinction, ratio, speckle : of a soft target, per metre; extinction by backscatter, sr; shape
    wakes : (W, 6) start, heading, rad, first half width, extinction; empty: everywhere

    """

    number: float = 0.0
    size: float = 0.0
    spread: float = 0.0
    bright: float = 0.0
    extinction: float = 1.0
    ratio: float = 20.0
    speckle: float = 4.0
    wakes: tuple[tuple[float, ...], ...] = ()


def make_both(
    weather: str, beams: Beams, seed: int, optics: Optics, returns: str = 'strongest'
) -> BothEchoes:
    """Let beams go through one of ``chances.KINDS``; as :func:`.kinds.make_both`."""
    rng, site = np.random.default_rng(seed), survey(beams)
    air = _draw(weather, site, rng)
    uneven, phase = rng.uniform(0.1, 0.8), rng.uniform(0.0, 2.0 * np.pi, WAVES)
    waves = rng.standard_normal((WAVES, 3)) * 2.0 * np.pi / rng.uniform(0.4, 4.0)
    gain, pulse = rng.uniform(0.0, 2.0), int(rng.integers(2, 7))
    shape = np.sin(np.pi * (np.arange(pulse) + 0.5) / pulse) ** 2
    far, power, left = (np.full(len(beams), value) for value in (np.inf, 0.0, 1.0))
    for first in range(0, len(beams), AT_ONCE):
        some = slice(first, first + AT_ONCE)
        along, reach = beams.direction[some], beams.range[some]
        turned = np.einsum('ij,wj->iw', along, waves).astype(np.float32)
        lumps = np.zeros((len(along), BINS), np.float32)
        for k in range(WAVES):
            lumps += np.cos(turned[:, k, None] * MIDDLE + np.float32(phase[k]))
        dense = np.exp(np.float32(uneven) * lumps - np.float32(WAVES * uneven**2 / 4))
        if air.wakes:
            dense *= _wakes(air, along.astype(np.float32), site.ground)
        depth, echo = _bins(air, optics, dense, rng)
        passed = np.cumsum(depth, axis=1)
        rest = np.where(np.isfinite(reach), reach, 0.0) - BIN_M * BINS
        rest = np.maximum(rest, 0.0) * (0.0 if air.number or air.wakes else air.extinction)
        left[some] = np.exp(-2.0 * (passed[:, -1] + rest))
        echo *= np.exp(-2.0 * (passed - depth)) * optics.overlap(MIDDLE) / MIDDLE**2
        echo[reach[:, None] < MIDDLE + BIN_M] = 0.0
        echo[:, optics.nearest > MIDDLE] = 0.0
        seen = convolve1d(echo, shape / shape.max(), axis=1, mode='constant')
        # The gain rises with time, so that what is near does not blind the receiver.
        amplified = seen * (MIDDLE / MIDDLE[-1]) ** gain
        above = amplified > optics.floor * rng.uniform(0.2, 1.0)
        best = np.argmax(above if returns == 'first' else np.where(above, amplified, 0.0), axis=1)
        row, noise = np.arange(len(best)), rng.uniform(-0.5, 0.5, len(best))
        hit = above[row, best]
        far[some] = np.where(hit, MIDDLE[best] + BIN_M * noise, np.inf)
        power[some] = np.where(hit, seen[row, best], 0.0)
    surface = surfaces(beams)
    dimmed = WeatherEchoes(surface.distance, surface.power * left, surface.cause)
    met = (far >= optics.nearest) & (far < beams.range)
    before = WeatherEchoes(
        np.where(met, far, np.inf), np.where(met, power, 0.0), met.astype(np.uint8)
    )
    return BothEchoes(dimmed.above(optics.floor), before)


def _draw(weather: str, site: WeatherSite, rng: np.random.Generator) -> _Air:
    if weather == 'snow':
        rate = log_uniform(rng, 0.1, 4.0)
        slope = 2.29 * rate**-0.45
        size, bright = 1e-3 / slope * rng.uniform(1.5, 3.0), rng.uniform(0.3, 0.9)
        return _Air(2500.0 * rate**-0.94 / slope, size, bright=bright)
    if weather == 'rain':
        rate = log_uniform(rng, 4.0, 100.0)
        size, spread = 0.72e-3 * rate**0.23, np.log(1.43 - 3e-4 * rate)
        return _Air(172.0 * rate**0.22, size, spread, rng.uniform(0.02, 0.2))
    if weather == 'fog':
        return _Air(extinction=3.0 / log_uniform(rng, 20.0, 150.0))
    wakes, sprayed = [], weather == 'spray'
    for number in range(int(rng.integers(*WAKES))):
        far = rng.uniform(3.0, max(min(site.space, 25.0), 6.0))
        azimuth, heading = rng.uniform(-np.pi, np.pi, 2)
        heading = azimuth if number == 0 else heading
        low = site.ground + (0.15 if sprayed else 0.4)
        width = rng.uniform(0.15, 0.4) if sprayed else rng.uniform(0.3, 0.9)
        start = far * np.cos(azimuth), far * np.sin(azimuth), low
        wakes.append((*start, heading, width, log_uniform(rng, 0.05, 2.0)))
    speckle = rng.uniform(0.25, 1.0) if sprayed else rng.uniform(1.0, 8.0)
    return _Air(ratio=rng.uniform(18.0, 55.0), speckle=speckle, wakes=tuple(wakes))


def _wakes(air: _Air, direction: Singles, ground: float) -> Singles:
    """Return the extinction (N, BINS) of wakes along beams, per metre."""
    total = np.zeros((len(direction), BINS), np.float32)
    for x, y, z, heading, width, dense in air.wakes:
        cos, sin = np.float32(np.cos(heading)), np.float32(np.sin(heading))
        ahead = np.outer(direction[:, 0] * cos + direction[:, 1] * sin, MIDDLE)
        aside = np.outer(direction[:, 1] * cos - direction[:, 0] * sin, MIDDLE)
        ahead -= np.float32(x * cos + y * sin)
        aside -= np.float32(y * cos - x * sin)
        up = np.outer(direction[:, 2], MIDDLE)
        most = width * np.cbrt(1.0 + 4.0 * WAKE_M)
        inside = (ahead > 0) & (ahead < WAKE_M) & (up > ground) & (np.abs(aside) < most)
        at = np.nonzero(inside)
        half = width * np.cbrt(1.0 + 4.0 * ahead[at])
        off = np.minimum(np.hypot(aside[at], up[at] - z - 0.5 * half) / half, 1.0)
        total[at] += dense * width / half * (1.0 - off**1.5) ** 2
    return total


def _bins(
    air: _Air, optics: Optics, dense: Singles, rng: np.random.Generator
) -> tuple[Singles, Singles]:
    """Return the optical depth of bins (N, BINS), and the share of light that each sends back."""
    share = np.zeros(dense.shape, np.float32)
    if not air.number:
        depth = dense * np.float32(BIN_M * air.extinction)
        at = np.nonzero(depth)
        grain = rng.standard_gamma(air.speckle, len(at[0])) / air.speckle
        share[at] = np.pi / air.ratio * -np.expm1(-depth[at]) * grain
        return depth, share
    beam = np.pi / 4.0 * optics.diameter(MIDDLE) ** 2
    number = rng.poisson(air.number * beam * BIN_M * dense)
    at = np.nonzero(number)
    if air.spread:
        size = air.size * np.exp(air.spread * rng.standard_normal(len(at[0])))
        square = air.size**2 * np.exp(2.0 * air.spread**2)
    else:
        size, square = rng.exponential(air.size, len(at[0])), 2.0 * air.size**2
    covered = np.pi / 4.0 * size**2 * number[at] / beam[at[1]]
    share[at] = air.bright * np.minimum(covered, 1.0)
    return np.full(dense.shape, np.pi / 2.0 * air.number * square * BIN_M, np.float32), share
