# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Drops and flakes that fall, one by one: which of them outshine the surface behind them.

LISA is Kilic et al. 2021 (arXiv 2107.07004), Hahner that of 2022 (arXiv 2203.15118). A beam meets
drops of diameter D at range r with the density A(r) N(D), A the beam's cross-section and
N(D) = N0 exp(-Λ D) (Marshall and Palmer 1948; LISA, eq. 5 and 6). Its echo is
ρ e^(-2αr) min((D / b)², 1) ÷ r², b the beam's diameter (LISA, eq. 7). It counts if it is above the
noise and, where the strongest return is asked for, above the surface's echo: so D must be at least
D₁(r), and the chance per metre of such a drop is A N0 / Λ exp(-Λ D₁).
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid

from lidar_outlier_filter.core.annotations import Floats, Ints
from lidar_outlier_lab.simulation.weather.beams import Optics

MILLIMETRE = 1e-3
LEVELS = 64  # of the power to outshine, that chances are tabulated for
STEPS = 400  # of range
REACH = 60.0  # metres: no drop is seen from farther
ACCURACY = 0.09  # metres: range resolution (LISA, ΔR)
WORST = 0.05  # metres: largest standard deviation of a drop's range


@dataclass(frozen=True)
class Precipitation:
    """What falls.

    Attributes
    ----------
    number : drops per m³ and mm of diameter, N0
    slope : Λ, per mm
    reflectance : ρ
    largest : diameter, mm

    """

    number: float
    slope: float
    reflectance: float
    largest: float

    @property
    def extinction(self) -> float:
        """α, per metre: twice the drops' cross-section (LISA, eq. 3, efficiency 2)."""
        return 2.0 * np.pi / 4.0 * self.number * 2.0 / self.slope**3 * MILLIMETRE**2


def rain(rate: float) -> Precipitation:
    """Return rain of ``rate`` mm/h: N0 = 8000, Λ = 4.1 R^-0.21; ρ of water (LISA)."""
    return Precipitation(8000.0, 4.1 * rate**-0.21, _fresnel(1.328), 6.0)


def snow(rate: float) -> Precipitation:
    """Return snow of ``rate`` mm/h: N0 = 7600 R^-0.87, Λ = 2.55 R^-0.48 (LISA).

    Flakes are discs of reflectance 0.9, at most 2 cm (Hahner, section 3).
    """
    return Precipitation(7600.0 * rate**-0.87, 2.55 * rate**-0.48, 0.9, 20.0)


def _fresnel(index: float) -> float:
    return ((index - 1.0) / (index + 1.0)) ** 2


def power(distance: Floats, reflectance: Floats, extinction: float) -> Floats:
    """Return the echo of a surface, ρ e^(-2αR) ÷ R²; 0 of what is infinitely far."""
    near = np.where(np.isfinite(distance), distance, 1.0)
    echo = reflectance * np.exp(-2.0 * extinction * near) / near**2
    return np.where(np.isfinite(distance), echo, 0.0)


def least_diameter(fall: Precipitation, optics: Optics, distance: Floats, least: Floats) -> Floats:
    """Return D₁ in mm, of what is to outshine a power; inf where no drop does."""
    bright = fall.reflectance * np.exp(-2.0 * fall.extinction * distance) / distance**2
    bright = bright * optics.overlap(distance)
    share = least / bright
    size = optics.diameter(distance) * np.sqrt(np.minimum(share, 1.0)) / MILLIMETRE
    return np.where((share <= 1.0) & (size < fall.largest), size, np.inf)


def hazard(fall: Precipitation, optics: Optics, distance: Floats, least: Floats) -> Floats:
    """Return the chance per metre of a drop that outshines ``least``, at a range."""
    size = least_diameter(fall, optics, distance, least)
    known = np.isfinite(size)
    number = np.exp(-fall.slope * np.where(known, size, 0.0)) - np.exp(-fall.slope * fall.largest)
    cross = np.pi / 4.0 * optics.diameter(distance) ** 2
    return np.where(known, cross * fall.number / fall.slope * number, 0.0)


def strike(
    fall: Precipitation,
    optics: Optics,
    reach: Floats,
    least: Floats,
    rng: np.random.Generator,
) -> tuple[Ints, Floats, Floats]:
    """Let drops fall through beams.

    Parameters
    ----------
    fall, optics : what falls, and through which beams
    reach : (N,) metres that each beam goes; inf: until nothing is seen any more
    least : (N,) power that a drop must outshine

    Returns
    -------
    beam : (M,) number of the beam that met a drop; a beam may meet several
    distance : (M,) metres, as measured
    power : (M,) of the drops' echoes

    """
    edges = np.geomspace(optics.nearest, REACH, STEPS)
    end = np.minimum(reach, REACH)
    low, high = np.log(optics.floor), np.log(max(float(least.max(initial=0.0)), 2 * optics.floor))
    levels = np.exp(np.linspace(low, high, LEVELS))
    level = np.searchsorted(levels, np.maximum(least, optics.floor) * (1.0 - 1e-9)).clip(
        0, LEVELS - 1
    )
    beam, distance = [], []
    for number in range(LEVELS):
        mine = np.flatnonzero((level == number) & (end > optics.nearest))
        if not len(mine):
            continue
        chance = hazard(fall, optics, edges, np.full(STEPS, levels[number]))
        total = cumulative_trapezoid(chance, edges, initial=0.0)
        count = rng.poisson(np.interp(end[mine], edges, total))
        which = np.repeat(mine, count)
        depth = rng.random(len(which)) * np.interp(end[which], edges, total)
        # Where no drop outshines, the sum stands still: its inverse is not unique, and not asked.
        rising = np.concatenate([[True], np.diff(total) > 0])
        beam.append(which)
        distance.append(np.interp(depth, total[rising], edges[rising]))
    index = np.concatenate(beam) if beam else np.zeros(0, np.int64)
    far = np.concatenate(distance) if distance else np.zeros(0)
    smallest = least_diameter(fall, optics, far, levels[level[index]])
    smallest = np.where(np.isfinite(smallest), smallest, fall.largest)
    size = np.minimum(smallest + rng.exponential(1.0 / fall.slope, len(far)), fall.largest)
    share = np.minimum((size * MILLIMETRE / optics.diameter(far)) ** 2, 1.0)
    echo = power(far, fall.reflectance * share * optics.overlap(far), fall.extinction)
    sigma = np.minimum(ACCURACY / np.sqrt(2.0 * np.maximum(echo / optics.floor, 1.0)), WORST)
    measured = np.maximum(far + sigma * rng.standard_normal(len(far)), optics.nearest)
    return index, measured, echo
