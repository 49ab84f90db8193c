# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the trees are trained on: real recordings in all weathers, and simulated streets."""

import itertools
import zlib
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Floats, Progress, Singles
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.scan_pattern.scan_pattern import find_pattern
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.recordings.recorded_clouds import RecordedClouds
from lidar_outlier_lab.simulation import presets
from lidar_outlier_lab.simulation.scenes.spinning_streets import dry_turn
from lidar_outlier_lab.simulation.weather import chances, scatterers, waveforms
from lidar_outlier_lab.simulation.weather.beams import Beams, Optics, find_beams
from lidar_outlier_lab.simulation.weather.echoes import BothEchoes, WeatherEchoes, measured
from lidar_outlier_lab.simulation.weather.kinds import WEATHERS, make_both
from lidar_outlier_lab.simulation.weather.labelled_cloud import Brightness
from lidar_outlier_lab.simulation.world.recording import to_message
from lidar_outlier_lab.simulation.world.sensors import SpinningScanner
from lidar_outlier_lab.training.held_out import CLEAN, STREET
from lidar_outlier_lab.training.single_sweeps import read_more_sweeps, read_single_sweeps
from lidar_outlier_lab.training.train import Sweep

# Clean recordings of spinning sensors in a folder of real data, and how they are read. Their order,
# and that of the others behind them, makes the folds.
RECORDINGS: Mapping[str, tuple[str, Mapping[str, object]]] = {
    'HDL-32E': ('hdl32_mrpt_mcap', {}),
    'OS1-128': ('os1_128_db3', {}),
    'lidar_link': ('cloudini_lidar_link_mcap', {}),
    'VLP-32C': ('vlp32_nebula_db3', {}),
    'VLP-16': ('vlp16_mrpt_mcap', {}),
    'XT32': ('hesai_xt32_nebula_mcap', {'time_field': 'stamp'}),
    'OS0-32': ('os0_32.bag', {}),
}
STREETS = ('street-128', 'street-64', 'street-16', 'street-32')
STREET_SEEDS, STREET_SEED_HELD_OUT = (11, 12), 101
MAX_CLEAN_SWEEPS = 4  # sweeps of a recording that are taken as they are
OF_EACH = 3  # sweeps with each weather
RETURNS = ('strongest', 'last', 'dual')  # that they measure, by turns
# Other laws of weather than that of the simulator's own; no two of them share one.
LAWS = {
    'chances': chances.make_both,
    'waveforms': waveforms.make_both,
    'scatterers': scatterers.make_both,
}
TRAINED = ('chances', 'waveforms')  # `scatterers` judges, only
OF_LAW = 2  # sweeps with each weather of another law
MAX_DRAWS = 6  # of a weather, until it is as dense as weather is
MIN_OUTLIERS = 200
MAX_SHARE = {'snow': 0.2, 'rain': 0.08, 'fog': 0.8, 'spray': 0.3, 'dust': 0.4}  # of outliers
# Standard deviations of the logarithm of the intensity of particles
OF_SWEEP, OF_EACH_PARTICLE = 0.8, 0.5
TABLE_SEEDS = (21, 22)  # of streets that sensors with published rings pass through
DOMES = ('Bpearl',)  # rings up to the zenith, where beams cannot be followed: no weather
FIRST = 2  # turn of a street from which on turns are taken


class CleanRecording(NamedTuple):
    """A recording in dry air, and the filter's parameters that it is read with."""

    sensor: str
    path: Path
    values: Mapping[str, object]


def known_recordings(folder: Path) -> list[CleanRecording]:
    """List the recordings of ``RECORDINGS`` that a folder has."""
    return [
        CleanRecording(sensor, folder / name, values)
        for sensor, (name, values) in RECORDINGS.items()
        if (folder / name).exists()
    ]


def read_sweeps(recording: CleanRecording, most: int = MAX_CLEAN_SWEEPS) -> list[Points]:
    """Read up to so many clouds, evenly spread: every second of them, every fourth and so on.

    Raises
    ------
    RecordingError
        If it has no clouds.

    """
    parameters = FilterParameters().changed(recording.values)
    kept: list[Points] = []
    every = 1
    for taken in RecordedClouds(recording.path, parameters):
        if taken.number % every == 0:
            kept.append(taken.cloud.points)
        if len(kept) > most:
            kept, every = kept[::2], 2 * every
    if not kept:
        raise RecordingError(f'the clouds of {recording.path}', 'at least one', 'none')
    return kept


def read_recordings(folder: Path) -> list[tuple[str, Sequence[Points]]]:
    """Read all clean clouds that a folder of real data has, by sensor."""
    found = [(one.sensor, read_sweeps(one)) for one in known_recordings(folder / 'bags')]
    by_sensor: dict[str, list[Points]] = {}
    for sensor, clouds in (*found, *read_single_sweeps(folder), *read_more_sweeps(folder)):
        by_sensor.setdefault(sensor, []).extend(clouds)
    return [*by_sensor.items()]


def has_pattern(points: Points) -> bool:
    """Return whether trees judge a cloud, and can be trained on it."""
    return find_pattern(points, spins=True) is not None


def recorded_sweeps(
    sensor: str,
    clouds: Sequence[Points],
    seed: int,
    laws: Collection[str] = TRAINED,
    weathers: Collection[str] = tuple(WEATHERS),
) -> list[Sweep]:
    """Take clouds as they are, and put every weather into some of them.

    Of these, some measure the strongest return of each beam, some the last, and some two.
    """
    sweeps = [
        Sweep(f'{sensor} {CLEAN} {k}', sensor, CLEAN, points, np.zeros(len(points), np.bool_))
        for k, points in enumerate(clouds)
    ]
    for number, weather in enumerate(() if sensor in DOMES else WEATHERS):
        for k in range(OF_EACH if weather in weathers else 0):
            name, cloud = f'{sensor} {weather} {k}', clouds[(number + k) % len(clouds)]
            chances, returns = [seed, _number(name)], RETURNS[k % len(RETURNS)]
            points, outlier = put_weather(cloud, weather, chances, returns)
            sweeps.append(Sweep(name, sensor, weather, points, outlier))
    for law in () if sensor in DOMES else laws:
        sweeps += _sweeps_of_law(law, sensor, clouds, seed)
    return sweeps


def _sweeps_of_law(law: str, sensor: str, clouds: Sequence[Points], seed: int) -> list[Sweep]:
    """Put the weather of another law into some; what is too thin or too dense is drawn again."""
    sweeps = []
    for turn, (k, weather) in enumerate(itertools.product(range(OF_LAW), MAX_SHARE)):
        kind = f'{law} {weather}'
        name = f'{sensor} {kind} {k}'
        cloud, returns = clouds[turn % len(clouds)], RETURNS[turn % len(RETURNS)]
        for draw in range(MAX_DRAWS):
            chances = [seed, _number(name), draw]
            points, outlier = put_weather(cloud, weather, chances, returns, make=LAWS[law])
            if outlier.sum() >= MIN_OUTLIERS and outlier.mean() <= MAX_SHARE[weather]:
                sweeps.append(Sweep(name, sensor, kind, points, outlier))
                break
    return sweeps


def _number(name: str) -> int:
    return zlib.crc32(name.encode())


def _turning_beams(points: Points, reflectance: Floats) -> Beams:
    return find_beams(points.xyz, points.t, points.line, reflectance, points.valid)


def put_weather(  # noqa: PLR0913  what a weather depends on
    points: Points,
    weather: str,
    seed: Sequence[int],
    returns: str = 'strongest',
    find: Callable[[Points, Floats], Beams] = _turning_beams,
    make: Callable[[str, Beams, int, Optics, str], BothEchoes] = make_both,
) -> tuple[Points, np.ndarray[tuple[int], np.dtype[np.bool_]]]:
    """Let the beams of a cloud go through a weather; optics are drawn.

    Reflectances are those that the intensities show, or drawn without intensities. ``returns``
    says which echo of a beam is measured: strongest, first, last, or dual for two. ``find`` gives
    all beams of a cloud, those without a return too. ``make`` is the law of the weather.

    Returns
    -------
    points : of the beams that measure something
    outlier : (N,) bool

    """
    rng = np.random.default_rng([*seed, 0])
    reflectance = np.clip(0.25 * np.exp(0.5 * rng.standard_normal(len(points))), 0.02, 1.0)
    # Sensors differ.
    optics = Optics(
        divergence=rng.uniform(0.001, 0.005),
        nearest=rng.uniform(0.3, 1.0),
        farthest=rng.uniform(60.0, 200.0),
        blind=rng.uniform(0.5, 4.0),
        pulse=rng.uniform(0.3, 1.8),
    )
    distance, intensity, curve = points.range, points.intensity, None
    if intensity is not None:
        values = intensity.astype(np.float64)
        curve = Brightness(distance, values)
        # What came back was above the noise.
        least = optics.floor * distance**2
        reflectance = np.maximum(curve.reflectance(distance, values), least)
    beams = find(points, reflectance)
    both = make(weather, beams, int(rng.integers(1 << 31)), optics, returns)
    xyz, source, cause, bright = [], [], [], []
    for echoes in measured(both, returns):
        there = np.flatnonzero(np.isfinite(echoes.distance))
        xyz.append(beams.direction[there] * echoes.distance[there, None])
        source.append(there)
        cause.append(echoes.cause[there])
        if intensity is not None and curve is not None:
            bright.append(_intensities(intensity, curve, beams, echoes, rng)[there])
    single, of = np.concatenate(xyz).astype(np.float32), np.concatenate(source)
    seen = np.ones(len(of), np.bool_)
    found = Points(single.astype(np.float64), beams.t[of], beams.ring[of], seen)
    if bright:
        found = replace(found, intensity=np.concatenate(bright))
    return found, np.concatenate(cause) > 0


def _intensities(
    known: Singles,
    curve: Brightness,
    beams: Beams,
    echoes: WeatherEchoes,
    rng: np.random.Generator,
) -> Singles:
    """Return the intensities (N,) of what beams measure; of those that measure nothing, any.

    Surfaces keep what the weather leaves of theirs. How bright particles look differs from sensor
    to sensor, and from particle to particle: more than optics tell.
    """
    far = np.where(np.isfinite(echoes.distance), echoes.distance, 1.0)
    kept = (beams.source >= 0) & np.isfinite(beams.range) & (echoes.cause == 0)
    clear = np.where(kept, beams.reflectance, 1.0) / np.where(kept, beams.range, 1.0) ** 2
    left = known[beams.source] * np.minimum(echoes.power / clear, 1.0)
    spread = rng.standard_normal() * OF_SWEEP + rng.standard_normal(len(far)) * OF_EACH_PARTICLE
    new = curve.intensity(far, echoes.power * far**2) * np.exp(spread)
    bright: Singles = np.where(kept, left, new)
    return np.clip(np.rint(bright), 0.0, known.max()).astype(np.float32)


def street_sweeps(name: str) -> list[Sweep]:
    """Simulate a street: some turns of two seeds to train on, and of a third to judge."""
    found = []
    for seed in (*STREET_SEEDS, STREET_SEED_HELD_OUT):
        clouds = list(presets.make(name, seed))
        decoder = Decoder(FilterParameters())
        for turn in (FIRST, len(clouds) // 2, len(clouds) - FIRST):
            cloud = clouds[turn]
            points = decoder.decode(to_message(cloud.stamp, cloud.points, cloud.frame))
            outlier = cloud.points['label'][points.valid] > 0
            judged = seed == STREET_SEED_HELD_OUT
            title = f'{name} seed {seed} turn {turn}'
            some = points.take(points.valid)
            found.append(Sweep(title, name, STREET, some, outlier, not judged, judged))
    return found


def simulated_sweeps(sensor: str, scanner: SpinningScanner, seed: int) -> list[Sweep]:
    """Simulate streets with the rings of a sensor: as they are, and dry ones with every weather.

    They train, and are not judged: the real sensors are.
    """
    decoder = Decoder(FilterParameters())
    sweeps = []
    clean = []
    for street in TABLE_SEEDS:
        cloud = dry_turn(scanner, street)
        points = decoder.decode(to_message(cloud.stamp, cloud.points, cloud.frame))
        outlier = cloud.points['label'][points.valid] > 0
        some = points.take(points.valid)
        name = f'{sensor} simulated seed {street}'
        sweeps.append(Sweep(name, sensor, STREET, some, outlier, judged=False))
        clean.append(some.take(~outlier))
    for number, weather in enumerate(WEATHERS):
        name = f'{sensor} simulated {weather}'
        chances, returns = [seed, _number(name)], RETURNS[number % len(RETURNS)]
        points, outlier = put_weather(clean[number % len(clean)], weather, chances, returns)
        sweeps.append(Sweep(name, sensor, weather, points, outlier, judged=False))
    return sweeps


def make_sweeps(  # noqa: PLR0913  what sweeps depend on
    recordings: Sequence[tuple[str, Sequence[Points]]],
    scanners: Mapping[str, SpinningScanner],
    seed: int,
    progress: Progress = lambda _done, _total, _what: None,
    *,
    laws: Collection[str] = TRAINED,
    weathers: Collection[str] = tuple(WEATHERS),
) -> list[Sweep]:
    """Make everything that trees are trained on and judged by.

    Parameters
    ----------
    recordings : names of sensors, and clean clouds of each
    scanners : simulated sensors with published rings, by the names of real ones
    seed : of the weather, from 0
    progress : is called before every sensor: how many of how many are done, and of what
    laws : other laws that there is weather of, too
    weathers : those put into recordings

    """
    total = len(recordings) + len(scanners) + len(STREETS)
    sweeps = []
    for number, (sensor, clouds) in enumerate(recordings):
        progress(number, total, f'weather for {sensor}')
        sweeps += recorded_sweeps(sensor, clouds, seed, laws, weathers)
    for number, (sensor, scanner) in enumerate(scanners.items(), len(recordings)):
        progress(number, total, f'streets for {sensor}')
        sweeps += simulated_sweeps(sensor, scanner, seed)
    for number, name in enumerate(STREETS, len(recordings) + len(scanners)):
        progress(number, total, name)
        sweeps += street_sweeps(name)
    return sweeps
