# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Weather, put into a sensor's own cloud: what falls, hangs or drifts, and what it hides.

Every beam is asked, those without a return too. Its surface loses light to what is in the way; and
what sends back more than is left of that is measured instead, if it is above the noise. Of the
same cloud, the same weather and the same seed, the same is made.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.simulation.scene import Cause
from lidar_outlier_filter.simulation.weather import drops, mirrors, plumes
from lidar_outlier_filter.simulation.weather.beams import Optics

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from lidar_outlier_filter.simulation.weather.beams import Beams

    Floats = NDArray[np.float64]
    Weather = Callable[['_Sweep'], 'WeatherEchoes']

RETURNS = ('strongest', 'first', 'last')
BESIDE_EDGES = 0.35  # share of the beams at edges that are mixed
MIRRORED = (0.15, 0.6)  # share of the beams at a pane that are, at least and most


@dataclass(frozen=True)
class WeatherEchoes:
    """What N beams measure.

    Attributes
    ----------
    distance : (N,) float64
        Metres; inf where nothing comes back.
    power : (N,) float64
        Reflectance ÷ m², what is lost on the way taken off.
    cause : (N,) uint8
        :class:`Cause`; 0 where it is the surface.

    """

    distance: Floats
    power: Floats
    cause: NDArray[np.uint8]


class _Sweep(NamedTuple):
    """What a weather is made for, and all chances."""

    beams: Beams
    optics: Optics
    rng: np.random.Generator
    returns: str


def make(
    weather: str,
    beams: Beams,
    seed: int,
    optics: Optics | None = None,
    returns: str = 'strongest',
) -> WeatherEchoes:
    """Let beams go through a weather.

    Parameters
    ----------
    weather : one of ``WEATHERS``
    beams : of one sweep, sorted by ring and time
    seed : from 0
    optics : of the sensor; None: the usual
    returns : which echo is measured, one of ``RETURNS``

    Raises
    ------
    FilterError
        If there is no such weather or return, or the seed is negative.

    """
    if weather not in WEATHERS:
        raise FilterError('the weather', f'one of {", ".join(WEATHERS)}', weather)
    if returns not in RETURNS:
        raise FilterError('the return', f'one of {", ".join(RETURNS)}', returns)
    if seed < 0:
        raise FilterError('the seed', 'at least 0', seed)
    rng = np.random.default_rng([seed, list(WEATHERS).index(weather)])
    return WEATHERS[weather](_Sweep(beams, optics or Optics(), rng, returns))


def _surface(beams: Beams, extinction: float = 0.0) -> WeatherEchoes:
    """Give what the surfaces alone send back."""
    echo = drops.power(beams.range, beams.reflectance, extinction)
    return WeatherEchoes(beams.range.copy(), echo, np.zeros(len(beams), np.uint8))


def _compete(
    sweep: _Sweep,
    surface: WeatherEchoes,
    distance: Floats,
    power: Floats,
    cause: Cause,
) -> WeatherEchoes:
    """Choose between the surface and what is before it; neither above the noise: nothing."""
    there = np.isfinite(surface.distance) & (surface.power >= sweep.optics.floor)
    before = np.isfinite(distance) & (power >= sweep.optics.floor)
    if sweep.returns == 'strongest':
        taken = before & (~there | (power > surface.power))
    elif sweep.returns == 'first':
        taken = before & (~there | (distance < surface.distance))
    else:
        taken = before & ~there
    nothing = ~taken & ~there
    far = np.where(taken, distance, surface.distance)
    echo = np.where(taken, power, surface.power)
    causes = np.where(taken, np.uint8(cause), surface.cause)
    return WeatherEchoes(
        np.where(nothing, np.inf, far),
        np.where(nothing, 0.0, echo),
        np.where(nothing, 0, causes).astype(np.uint8),
    )


def _falling(fall: drops.Precipitation, cause: Cause, sweep: _Sweep) -> WeatherEchoes:
    beams, optics = sweep.beams, sweep.optics
    surface = _surface(beams, fall.extinction)
    least = surface.power if sweep.returns == 'strongest' else np.zeros(len(beams))
    where, far, echo = drops.strike(fall, optics, beams.range, least, sweep.rng)
    # Of several drops, that which is measured.
    rank = np.lexsort((far if sweep.returns == 'first' else -echo, where))
    first = rank[np.flatnonzero(np.diff(where[rank], prepend=-1))]
    distance, power = np.full(len(beams), np.inf), np.zeros(len(beams))
    distance[where[first]], power[where[first]] = far[first], echo[first]
    return _compete(sweep, surface, distance, power, cause)


def _hanging(cloud: plumes.Plume, cause: Cause, sweep: _Sweep) -> WeatherEchoes:
    beams = sweep.beams
    distance, power, left = plumes.strike(cloud, sweep.optics, beams, beams.range, sweep.rng)
    surface = _surface(beams)
    surface = WeatherEchoes(surface.distance, surface.power * left, surface.cause)
    return _compete(sweep, surface, distance, power, cause)


def _rain(sweep: _Sweep) -> WeatherEchoes:
    rng = sweep.rng
    fall = drops.rain(float(np.exp(rng.uniform(np.log(5.0), np.log(80.0)))))
    return _falling(fall, Cause.RAIN, sweep)


def _light_snow(sweep: _Sweep) -> WeatherEchoes:
    rng = sweep.rng
    fall = drops.snow(float(np.exp(rng.uniform(np.log(0.05), np.log(0.4)))))
    return _falling(fall, Cause.SNOW, sweep)


def _heavy_snow(sweep: _Sweep) -> WeatherEchoes:
    rng = sweep.rng
    fall = drops.snow(float(np.exp(rng.uniform(np.log(0.6), np.log(5.0)))))
    return _falling(fall, Cause.SNOW, sweep)


def _fog(sweep: _Sweep) -> WeatherEchoes:
    """Hang fog: meteorological optical range MOR = ln 20 ÷ α (Hahner et al. 2021, eq. 4)."""
    rng = sweep.rng
    sight = float(np.exp(rng.uniform(np.log(25.0), np.log(150.0))))
    cloud = plumes.Plume(
        density=np.log(20.0) / sight,
        ratio=65.0,
        lump=rng.uniform(2.0, 8.0),
        uneven=rng.uniform(0.3, 0.9),
        grains=rng.uniform(1.0, 4.0),
        cell=0.25,
    )
    return _hanging(cloud, Cause.FOG, sweep)


def _spray(sweep: _Sweep) -> WeatherEchoes:
    """Whirl water up behind the wheels of vehicles."""
    beams, rng = sweep.beams, sweep.rng
    ground = _ground(beams)
    puffs: list[plumes.PlumePuff] = []
    for start, heading in _vehicles(beams, ground, rng):
        for side in (-0.8, 0.8):
            wheel = (
                start[0] - side * np.sin(heading),
                start[1] + side * np.cos(heading),
                ground + 0.1,
            )
            puffs += plumes.trail(wheel, heading, rng.uniform(3.0, 9.0), rng.uniform(0.3, 2.0), rng)
    cloud = plumes.Plume(
        tuple(puffs),
        ratio=20.0,
        lump=rng.uniform(0.4, 1.0),
        uneven=rng.uniform(1.0, 1.7),
        grains=rng.uniform(0.4, 1.2),
        bottom=ground,
    )
    return _hanging(cloud, Cause.SPRAY, sweep)


def _dust(sweep: _Sweep) -> WeatherEchoes:
    """Whirl dust up: broad plumes behind vehicles."""
    beams, rng = sweep.beams, sweep.rng
    ground = _ground(beams)
    density = float(np.exp(rng.uniform(np.log(0.15), np.log(1.5))))
    puffs: list[plumes.PlumePuff] = []
    for start, heading in _vehicles(beams, ground, rng):
        puffs += plumes.trail(
            (*start, ground),
            heading,
            rng.uniform(4.0, 14.0),
            density,
            rng,
            width=rng.uniform(0.5, 1.0),
            growth=rng.uniform(0.1, 0.25),
        )
    cloud = plumes.Plume(
        tuple(puffs),
        ratio=rng.uniform(25.0, 55.0),
        lump=rng.uniform(0.6, 2.5),
        uneven=rng.uniform(0.6, 1.3),
        grains=rng.uniform(1.0, 4.0),
        bottom=ground,
    )
    return _hanging(cloud, Cause.DUST, sweep)


def _exhaust(sweep: _Sweep) -> WeatherEchoes:
    """Let pipes smoke: small, dense clouds near the ground."""
    beams, rng = sweep.beams, sweep.rng
    ground = _ground(beams)
    puffs: list[plumes.PlumePuff] = []
    for start, heading in _vehicles(beams, ground, rng):
        puffs += plumes.trail(
            (*start, ground + 0.25),
            heading,
            rng.uniform(0.8, 3.0),
            rng.uniform(0.8, 3.0),
            rng,
            width=0.15,
            growth=0.2,
        )
    cloud = plumes.Plume(
        tuple(puffs),
        ratio=rng.uniform(20.0, 45.0),
        lump=rng.uniform(0.3, 0.8),
        uneven=rng.uniform(0.6, 1.2),
        grains=rng.uniform(1.0, 4.0),
        cell=0.1,
        bottom=ground,
    )
    return _hanging(cloud, Cause.EXHAUST, sweep)


def _mixed(sweep: _Sweep) -> WeatherEchoes:
    far, mixed = mirrors.mix(sweep.beams, BESIDE_EDGES, sweep.rng)
    return _moved(sweep.beams, far, mixed, Cause.MIXED)


def _ghosts(sweep: _Sweep) -> WeatherEchoes:
    share = sweep.rng.uniform(*MIRRORED)
    far, mirrored = mirrors.mirror(sweep.beams, sweep.optics, share, sweep.rng)
    return _moved(sweep.beams, far, mirrored, Cause.GHOST)


def _moved(beams: Beams, far: Floats, moved: NDArray[np.bool_], cause: Cause) -> WeatherEchoes:
    surface = _surface(beams)
    return WeatherEchoes(far, surface.power, np.where(moved, cause, 0).astype(np.uint8))


def _ground(beams: Beams) -> float:
    """Return the height of the lowest surfaces, metres."""
    known = np.isfinite(beams.range)
    return float(np.percentile(beams.direction[known, 2] * beams.range[known], 2.0))


def _vehicles(
    beams: Beams, ground: float, rng: np.random.Generator
) -> list[tuple[tuple[float, float], float]]:
    """Place vehicles where there is room: the point that a plume begins at, and where it goes."""
    known = np.isfinite(beams.range)
    level = np.sqrt(1.0 - beams.direction[known, 2] ** 2)
    room = float(np.percentile(beams.range[known] * level, 80.0))
    found = []
    for number in range(int(rng.integers(1, 5))):
        # The first is the vehicle that carries the sensor.
        far = rng.uniform(3.0, max(min(room, 25.0), 5.0))
        far = max(2.0, -1.5 * ground) if number == 0 else far
        place, turn = rng.uniform(-np.pi, np.pi, 2)
        heading = place + 0.2 * turn if number == 0 else turn
        found.append(((float(far * np.cos(place)), float(far * np.sin(place))), float(heading)))
    return found


WEATHERS: dict[str, Weather] = {
    'light_snow': _light_snow,
    'heavy_snow': _heavy_snow,
    'rain': _rain,
    'fog': _fog,
    'spray': _spray,
    'dust': _dust,
    'exhaust': _exhaust,
    'mixed': _mixed,
    'ghosts': _ghosts,
}
