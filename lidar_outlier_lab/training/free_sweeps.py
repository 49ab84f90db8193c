# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the trees of scanners without rings are trained on: drawn scanners, and thin recordings.

Simulated streets have foliage as sparse as such scanners see it, but nothing near the sensor, and
no rooms: trees trained on them alone reject up to half of a recording. So clean recordings of
spinning sensors are thinned out, without their rings, and train, too.
"""

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Progress
from lidar_outlier_filter.core.points.points import SECOND, Points
from lidar_outlier_filter.core.scan_pattern.recovered_rings import in_bands
from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_lab.simulation.scenes.spinning_streets import dry_turn
from lidar_outlier_lab.simulation.weather.beams import beams_of
from lidar_outlier_lab.simulation.world.prisms import (
    MINUTE,
    FreeScanner,
    NoddingScanner,
    Prism,
    PrismScanner,
)
from lidar_outlier_lab.simulation.world.recording import to_message
from lidar_outlier_lab.training.held_out import CLEAN, STREET
from lidar_outlier_lab.training.scenes import RETURNS, put_weather, recorded_sweeps
from lidar_outlier_lab.training.train import BAD_COUNTS, GOOD_COUNTS, Recipe, Sweep

WEATHER = ('light_snow', 'heavy_snow', 'rain', 'fog', 'spray', 'dust', 'exhaust')
SCANNERS, STREETS = 36, 3  # drawn, and streets that each scans
FIRST_STREET = 900  # seed
CLOUD_S = 0.1  # seconds
SHOTS = (50e3, 450e3)  # a second
THINNED = (4e3, 5e4)  # points of a recording's cloud that are kept
CLEAN_OF_EACH = 3  # times that a clean one is thinned out
# Points of a clean cloud that end on the way, and how far along it: a twig is not all there is.
STRAYS, STRAY_SHARE, ON_THE_WAY = 'strays', (0.002, 0.1), (0.1, 0.9)
# Streets alone have mixed points and ghosts, and few of them. Plumes and dense snow are hard to
# see, strays easy.
BAD = {STREET: 3.0, 'heavy_snow': 1.5, 'spray': 2.0, 'dust': 1.5, STRAYS: 0.8}
RECIPE = Recipe(folds=4, bad_counts={**BAD_COUNTS, **BAD}, good_counts={**GOOD_COUNTS, CLEAN: 8.0})


def draw(number: int) -> FreeScanner:
    """Draw a scanner: every third has prisms, the others look all around."""
    rng = np.random.default_rng([FIRST_STREET, number])
    rate, lasers = np.exp(rng.uniform(*np.log(SHOTS))), int(rng.choice([1, 1, 2, 3, 4, 4, 6]))
    times = {'interval': round(SECOND / rate), 'shots_per_line': round(rate * CLOUD_S)}
    if number % 3:
        low, high = np.radians([rng.uniform(-40.0, -5.0), rng.uniform(10.0, 60.0)])
        turns, nods = MINUTE * rng.uniform([40.0, 2.0], [300.0, 25.0])
        apart = rng.uniform(0.01, 0.12) * (high - low)
        return NoddingScanner(
            low=low, high=high, turns=turns, nods=nods, rings=lasers, apart=apart, **times
        )
    angles = np.radians(rng.uniform([7.0, 7.0, 1.0], [27.0, 27.0, 8.0]))
    speeds = np.exp(rng.uniform(np.log(500.0), np.log(9000.0), 3))
    speeds *= (1.0, -1.0, rng.choice([-1, 1]))
    prisms = tuple(map(Prism, angles.tolist(), speeds.tolist()))[: rng.integers(2, 4)]
    half = rng.uniform(0.003, 0.05) if lasers > 1 else 0.0
    fan = tuple(np.linspace(-half, half, lasers).tolist())
    return PrismScanner(prisms=prisms, fan=fan, **times)


def street(scanner: FreeScanner, seed: int) -> tuple[Points, Points, Bools]:
    """Return a cloud in dry air: its good points, all of them, and which are outliers."""
    cloud = dry_turn(scanner, seed)
    decoded = Decoder(FilterParameters()).decode(to_message(cloud.stamp, cloud.points, cloud.frame))
    points = replace(decoded, t=decoded.t - cloud.stamp)
    bad = cloud.points['label'] > 0
    return points.take(~bad), points, bad


def scanner_sweeps(
    name: str,
    scanner: FreeScanner,
    seed: int,
    weathers: Sequence[str],
    returns: Sequence[str] = ('strongest',),
) -> Iterator[Sweep]:
    """Simulate clouds of a scanner in the street of a seed, in order of time.

    They are in dry air, as mirrors, edges and birds spoil it, and in each weather. ``returns`` are
    measured by turns.
    """
    rng = np.random.default_rng([seed, scanner.rings])
    scanner = replace(scanner, before=int(rng.integers(100 * scanner.shots_per_line)))
    good, every, bad = street(scanner, seed)
    yield Sweep(f'{name} {CLEAN} {seed}', name, CLEAN, good, np.zeros(len(good), np.bool_))
    yield Sweep(f'{name} {STREET} {seed}', name, STREET, every, bad)
    find = partial(beams_of, scanner)
    for number, weather in enumerate(weathers):
        measured = returns[(seed + number) % len(returns)]
        points, outlier = put_weather(good, weather, [seed, number], measured, find)
        order = np.argsort(points.t, kind='stable')
        title = f'{name} {weather} {seed}'
        yield Sweep(title, name, weather, points.take(order), outlier[order])


def thin_out(sweep: Sweep, number: int) -> Sweep:
    """Keep as many points of a sweep, at random, as a scanner without rings has."""
    rng = np.random.default_rng([zlib.crc32(sweep.name.encode()), number])
    count = len(sweep.outlier)
    kept = rng.random(count) * count < np.exp(rng.uniform(*np.log(THINNED)))
    points, outlier = sweep.points.take(kept), sweep.outlier[kept]
    return sweep._replace(name=f'{sweep.name} thinned {number}', points=points, outlier=outlier)


def with_strays(sweep: Sweep) -> Sweep:
    """Let some beams of a clean sweep end on their way."""
    rng = np.random.default_rng(zlib.crc32(sweep.name.encode()))
    outlier = rng.random(len(sweep.outlier)) < np.exp(rng.uniform(*np.log(STRAY_SHARE)))
    part = np.where(outlier, rng.uniform(*ON_THE_WAY, len(outlier)), 1.0)
    points = replace(sweep.points, xyz=sweep.points.xyz * part[:, None])
    return sweep._replace(
        name=f'{sweep.name} {STRAYS}', kind=STRAYS, points=points, outlier=outlier
    )


def make_sweeps(
    recordings: Sequence[tuple[str, Sequence[Points]]], seed: int, progress: Progress
) -> list[Sweep]:
    """Make everything that the trees are trained on and judged by, in bands.

    Parameters
    ----------
    recordings : names of spinning sensors, and clean clouds of each
    seed : of the weather in recordings, from 0
    progress : is called before every sensor: how many of how many are done, and of what

    """
    total, sweeps = len(recordings) + SCANNERS, []
    for done, (sensor, clouds) in enumerate(recordings):
        progress(done, total, f'weather for {sensor}')
        for sweep in recorded_sweeps(sensor, clouds, seed, (), WEATHER):
            times = CLEAN_OF_EACH if sweep.kind == CLEAN else 1
            sweeps += [thin_out(sweep, number) for number in range(times)]
    for number in range(SCANNERS):
        name, scanner = f'scanner {number}', draw(number)
        progress(len(recordings) + number, total, name)
        for k in range(STREETS):
            place = FIRST_STREET + STREETS * number + k
            sweeps += scanner_sweeps(name, scanner, place, WEATHER, RETURNS)
    made = [sweep._replace(points=in_bands(sweep.points)) for sweep in sweeps]
    return made + [with_strays(sweep) for sweep in made if sweep.kind == CLEAN]


def about(sensors: Sequence[str]) -> dict[str, Any]:
    """Say what the trees are trained on, for their file: recordings of these sensors, and more."""
    return {
        'recordings': [*sensors],
        'weather': [*WEATHER],
        'scanners': SCANNERS,
        'street_seeds': [FIRST_STREET, FIRST_STREET + SCANNERS * STREETS - 1],
    }
