# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Echoes of N beams: of the surfaces, of what is before them, and which of both is measured."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Bytes, Floats
from lidar_outlier_lab.simulation.weather.beams import Beams
from lidar_outlier_lab.simulation.weather.drops import power


class WeatherEchoes(NamedTuple):
    """What N beams measure.

    Attributes
    ----------
    distance : (N,) metres; inf where nothing comes back
    power : (N,) reflectance ÷ m², what is lost on the way taken off
    cause : (N,) uint8, :class:`Cause`; 0 where it is the surface

    """

    distance: Floats
    power: Floats
    cause: Bytes

    def above(self, noise: float) -> WeatherEchoes:
        """Leave out what is not above the noise."""
        seen = np.isfinite(self.distance) & (self.power >= noise)
        return WeatherEchoes(
            np.where(seen, self.distance, np.inf),
            np.where(seen, self.power, 0.0),
            np.where(seen, self.cause, 0).astype(np.uint8),
        )


class BothEchoes(NamedTuple):
    """The echoes of the surfaces, and of what is before them; inf: none."""

    surface: WeatherEchoes
    before: WeatherEchoes


def surfaces(beams: Beams, extinction: float = 0.0) -> WeatherEchoes:
    """Give what the surfaces alone send back."""
    echo = power(beams.range, beams.reflectance, extinction)
    return WeatherEchoes(beams.range.copy(), echo, np.zeros(len(beams), np.uint8))


def nothing(count: int) -> WeatherEchoes:
    """Give no echoes."""
    return WeatherEchoes(np.full(count, np.inf), np.zeros(count), np.zeros(count, np.uint8))


def choose(both: BothEchoes, returns: str) -> WeatherEchoes:
    """Choose between the surface and what is before it, as a sensor with one return does."""
    surface, before = both
    there, other = np.isfinite(surface.distance), np.isfinite(before.distance)
    if returns == 'strongest':
        taken = other & (~there | (before.power > surface.power))
    elif returns == 'first':
        taken = other & (~there | (before.distance < surface.distance))
    else:
        taken = other & ~there
    pairs: Any = zip(before, surface, strict=True)
    return WeatherEchoes(*(np.where(taken, mine, its) for mine, its in pairs))


def measured(both: BothEchoes, returns: str) -> list[WeatherEchoes]:
    """List what a sensor measures: one echo of each beam, or two of those that have two."""
    if returns != 'dual':
        return [choose(both, returns)]
    two = np.isfinite(both.surface.distance) & np.isfinite(both.before.distance)
    distance = np.where(two, both.before.distance, np.inf)
    second = WeatherEchoes(distance, both.before.power, both.before.cause)
    return [choose(both, 'last'), second]
