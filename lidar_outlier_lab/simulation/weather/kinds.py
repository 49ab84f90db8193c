# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Weather, put into a sensor's own cloud: what falls, hangs or drifts, and what it hides.

Every beam is simulated, also those without a return. Particles in its way take light from the
surface behind them. Where their echo is stronger than what is left of the surface's, and above the
noise, it is measured instead. The same cloud, weather and seed always give the same result.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation.truth import Cause
from lidar_outlier_lab.simulation.papers.aerial import log_uniform
from lidar_outlier_lab.simulation.weather import drops, echoes, mirrors, plumes
from lidar_outlier_lab.simulation.weather.beams import Beams, Optics
from lidar_outlier_lab.simulation.weather.echoes import BothEchoes, WeatherEchoes

MakeWeather = Callable[['_Sweep'], BothEchoes]
Position = tuple[float, float]  # level, metres
Trail = Callable[[Position, float], Sequence[plumes.PlumePuff]]

BESIDE_EDGES = 0.35  # share of the beams at edges that are mixed
MIRRORED = (0.15, 0.6)  # share of the beams at a pane that are, at least and most
LEFT = 0.3  # share of the light that is left after two mirrors


class WeatherSite(NamedTuple):
    """Where vehicles may be: the height of the ground, and how far 80 % of the surfaces are, m."""

    ground: float
    space: float


class _Sweep(NamedTuple):
    """What a weather is made for, and all chances.

    ``fixed`` draws what stays the same from sweep to sweep, ``rng`` all else.
    """

    beams: Beams
    optics: Optics
    fixed: np.random.Generator
    rng: np.random.Generator
    returns: str
    around: WeatherSite


def make_both(  # noqa: PLR0913  what a weather depends on
    weather: str,
    beams: Beams,
    seed: int,
    optics: Optics | None = None,
    returns: str = 'dual',
    sweep: Sequence[int] = (),
    around: WeatherSite | None = None,
) -> BothEchoes:
    """Let beams go through a weather, and give what surfaces and particles send back, both.

    Of several particles in a beam it is the nearest for the first return, the farthest for the
    last, and the strongest otherwise. With ``strongest`` drops that the surface outshines are not
    made.

    Parameters
    ----------
    weather : one of ``WEATHERS``
    beams : of one sweep, sorted by ring and time
    seed : from 0
    optics : of the sensor; None: the usual
    returns : which echo is measured: strongest, first, last, or dual for two
    sweep : its numbers in its recording: the particles of each are others, the weather is the same
    around : the site of the first sweep; None: those of this one

    Raises
    ------
    FilterError
        If there is no such weather, or the seed is negative.

    """
    check(weather, seed)
    optics, number = optics or Optics(), list(WEATHERS).index(weather)
    fixed = np.random.default_rng([seed, number])
    rng = np.random.default_rng([seed, number, 1, *sweep])
    around = around or survey(beams)
    return WEATHERS[weather](_Sweep(beams, optics, fixed, rng, returns, around))


def check(weather: str, seed: int) -> None:
    """Refuse a weather that there is not, and a negative seed."""
    if weather not in WEATHERS:
        raise FilterError('the weather', f'one of {", ".join(WEATHERS)}', weather)
    if seed < 0:
        raise FilterError('the seed', 'at least 0', seed)


def survey(beams: Beams) -> WeatherSite:
    """Find the ground, and how much space there is."""
    known = np.isfinite(beams.range)
    up, far = beams.direction[known, 2], beams.range[known]
    ground = float(np.percentile(up * far, 2.0))
    return WeatherSite(ground, float(np.percentile(far * np.sqrt(1.0 - up**2), 80.0)))


def _falling(fall: drops.Precipitation, cause: Cause, sweep: _Sweep) -> BothEchoes:
    beams, optics = sweep.beams, sweep.optics
    surface = echoes.surfaces(beams, fall.extinction)
    least = surface.power if sweep.returns == 'strongest' else np.zeros(len(beams))
    where, far, echo = drops.strike(fall, optics, beams.range, least, sweep.rng)
    # The drop that is measured, of several.
    requested = {'first': far, 'last': -far}.get(sweep.returns, -echo)
    rank = np.lexsort((requested, where))
    chosen = rank[np.flatnonzero(np.diff(where[rank], prepend=-1))]
    before = echoes.nothing(len(beams))
    before.distance[where[chosen]], before.power[where[chosen]] = far[chosen], echo[chosen]
    before.cause[where[chosen]] = cause
    return BothEchoes(surface.above(optics.floor), before.above(optics.floor))


def _hanging(cloud: plumes.Plume, cause: Cause, sweep: _Sweep) -> BothEchoes:
    beams, noise = sweep.beams, sweep.optics.floor
    distance, power, left = plumes.strike(cloud, sweep.optics, beams, beams.range, sweep.rng)
    surface = echoes.surfaces(beams)
    surface = WeatherEchoes(surface.distance, surface.power * left, surface.cause)
    before = WeatherEchoes(distance, power, np.full(len(beams), cause, np.uint8))
    return BothEchoes(surface.above(noise), before.above(noise))


def _falls(
    law: Callable[[float], drops.Precipitation], low: float, high: float, cause: Cause
) -> MakeWeather:
    """Let it rain or snow at a rate that is drawn between two, mm/h."""
    return lambda sweep: _falling(law(log_uniform(sweep.fixed, low, high)), cause, sweep)


def _fog(sweep: _Sweep) -> BothEchoes:
    """Hang fog: meteorological optical range MOR = ln 20 ÷ α (Hahner et al. 2021, eq. 4)."""
    rng = sweep.fixed
    sight = log_uniform(rng, 25.0, 150.0)
    cloud = plumes.Plume(
        density=np.log(20.0) / sight,
        ratio=65.0,
        lump=rng.uniform(2.0, 8.0),
        uneven=rng.uniform(0.3, 0.9),
        grains=rng.uniform(1.0, 4.0),
        cell=0.25,
    )
    return _hanging(cloud, Cause.FOG, sweep)


def _behind_vehicles(
    sweep: _Sweep, trail: Trail, ranges: Mapping[str, Position], cause: Cause, cell: float = 0.15
) -> BothEchoes:
    """Let vehicles leave plumes behind; ``trail`` makes those of one.

    ``ranges`` are the least and the most of what a :class:`.plumes.Plume` is drawn from, in order.
    """
    around, rng = sweep.around, sweep.fixed
    puffs = [puff for start, heading in _vehicles(around, rng) for puff in trail(start, heading)]
    drawn = {name: rng.uniform(low, high) for name, (low, high) in ranges.items()}
    cloud = plumes.Plume(tuple(puffs), **drawn, cell=cell, bottom=around.ground)
    return _hanging(cloud, cause, sweep)


def _spray(sweep: _Sweep) -> BothEchoes:
    """Whirl water up behind the wheels of vehicles."""
    ground, rng = sweep.around.ground, sweep.fixed

    def trail(start: Position, heading: float) -> list[plumes.PlumePuff]:
        puffs: list[plumes.PlumePuff] = []
        for side in (-0.8, 0.8):
            x, y = start[0] - side * np.sin(heading), start[1] + side * np.cos(heading)
            length, density = rng.uniform(2.0, 14.0), log_uniform(rng, 0.1, 3.0)
            puffs += plumes.trail((x, y, ground + 0.1), heading, length, density, rng)
        return puffs

    ranges = {
        'ratio': (12.0, 50.0),
        'lump': (0.25, 1.5),
        'uneven': (0.5, 1.8),
        'grains': (0.4, 4.0),
    }
    return _behind_vehicles(sweep, trail, ranges, Cause.SPRAY)


def _dust(sweep: _Sweep) -> BothEchoes:
    """Whirl dust up: broad plumes behind vehicles."""
    ground, rng = sweep.around.ground, sweep.fixed
    density = log_uniform(rng, 0.1, 2.5)

    def trail(start: Position, heading: float) -> Sequence[plumes.PlumePuff]:
        length, width = rng.uniform(4.0, 14.0), rng.uniform(0.5, 1.0)
        growth = rng.uniform(0.1, 0.25)
        return plumes.trail((*start, ground), heading, length, density, rng, width, growth)

    ranges = {'ratio': (15.0, 60.0), 'lump': (0.4, 2.5), 'uneven': (0.4, 1.6), 'grains': (0.6, 6.0)}
    return _behind_vehicles(sweep, trail, ranges, Cause.DUST)


def _exhaust(sweep: _Sweep) -> BothEchoes:
    """Let pipes smoke: small, dense clouds near the ground."""
    ground, rng = sweep.around.ground, sweep.fixed

    def trail(start: Position, heading: float) -> Sequence[plumes.PlumePuff]:
        length, density = rng.uniform(0.8, 3.0), rng.uniform(0.8, 3.0)
        position = (*start, ground + 0.25)
        return plumes.trail(position, heading, length, density, rng, width=0.15, growth=0.2)

    ranges = {'ratio': (20.0, 45.0), 'lump': (0.3, 0.8), 'uneven': (0.6, 1.2), 'grains': (1.0, 4.0)}
    return _behind_vehicles(sweep, trail, ranges, Cause.EXHAUST, cell=0.1)


def _mixed(sweep: _Sweep) -> BothEchoes:
    far, mixed = mirrors.mix(sweep.beams, BESIDE_EDGES, sweep.rng)
    return _moved(sweep.beams, far, mixed, Cause.MIXED, 1.0)


def _ghosts(sweep: _Sweep) -> BothEchoes:
    share = sweep.fixed.uniform(*MIRRORED)
    far, mirrored = mirrors.mirror(sweep.beams, sweep.optics, share, sweep.rng)
    return _moved(sweep.beams, far, mirrored, Cause.GHOST, LEFT)


def _moved(
    beams: Beams, far: Floats, moved: NDArray[np.bool_], cause: Cause, share: float
) -> BothEchoes:
    """Put surfaces elsewhere, with a share of their light."""
    echo = drops.power(far, beams.reflectance * np.where(moved, share, 1.0), 0.0)
    causes = np.where(moved, cause, 0).astype(np.uint8)
    return BothEchoes(WeatherEchoes(far, echo, causes), echoes.nothing(len(beams)))


def _vehicles(
    around: WeatherSite, rng: np.random.Generator
) -> list[tuple[tuple[float, float], float]]:
    """Put vehicles where there is space: the point that a plume begins at, and where it goes."""
    found = []
    for number in range(int(rng.integers(1, 5))):
        # The first is the vehicle that carries the sensor.
        far = rng.uniform(3.0, max(min(around.space, 25.0), 5.0))
        far = max(2.0, -1.5 * around.ground) if number == 0 else far
        azimuth, turn = rng.uniform(-np.pi, np.pi, 2)
        heading = azimuth + 0.2 * turn if number == 0 else turn
        found.append(((float(far * np.cos(azimuth)), float(far * np.sin(azimuth))), float(heading)))
    return found


WEATHERS: dict[str, MakeWeather] = {
    'light_snow': _falls(drops.snow, 0.05, 0.4, Cause.SNOW),
    'heavy_snow': _falls(drops.snow, 0.6, 5.0, Cause.SNOW),
    'rain': _falls(drops.rain, 5.0, 80.0, Cause.RAIN),
    'fog': _fog,
    'spray': _spray,
    'dust': _dust,
    'exhaust': _exhaust,
    'mixed': _mixed,
    'ghosts': _ghosts,
}
