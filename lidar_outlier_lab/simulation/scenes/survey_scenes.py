# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Surveyed clouds of random measures, with errors: what the trees for them are trained on.

No preset is among them: flights over towns and mountains, clouds from images, walls, tracks, scans
from a tripod, and plain pieces of surfaces.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from lidar_outlier_filter.core.annotations import Bytes, Floats
from lidar_outlier_filter.core.neighbours.typical import K
from lidar_outlier_filter.evaluation.truth import Kind
from lidar_outlier_lab.simulation.papers import tripod
from lidar_outlier_lab.simulation.papers.aerial import Flight, fly, log_uniform, look_down
from lidar_outlier_lab.simulation.papers.bus_tracks import Line, track
from lidar_outlier_lab.simulation.scenes.survey_errors import add_errors
from lidar_outlier_lab.simulation.world.landscape import Plants

STREAM = 2309  # of random numbers, which no preset uses
MAX_POINTS = 80_000  # good points of a scene, about
SHARE = (1e-4, 0.02)  # of errors; none in some scenes
FEW, SHARE_OF_FEW = 10_000, 0.15  # small clouds may have more
CLEAN = 0.15  # share of the scenes without errors
ROUNDED = 0.3  # share of the scenes whose coordinates are rounded to millimetres or centimetres
SINGLE = 0.25  # share of those from the air in single precision: northings in steps to 0.5 m
LINED = 0.5  # share of those from the air that are of lines far from each other
APART, WIDTH = (2.0, 10.0), (0.05, 0.4)  # of lines: spacings between them, and share of that
ISLANDS = 0.5  # share of those of country that have gaps around some parts of the ground
PARTS, LOWER = (5, 80), 0.4  # tried; those are taken whose middle is in this lower part around it
ISLAND, MOAT = (1.0, 5.0), (2.5, 12.0)  # of these: half as wide, and the gaps around, spacings
THINNED = 0.3  # share of those from the air that are thinned


class SurveyScene(NamedTuple):
    """A cloud with its truth.

    Attributes
    ----------
    name : str
    xyz : (N, 3) metres, z up
    cause : (N,) uint8, a :class:`Cause`; 0 of good points

    """

    name: str
    xyz: Floats
    cause: Bytes


def training_scene(seed: int) -> SurveyScene:
    """Draw a scene; seeds from 0. The kinds take turns."""
    name, maker = KINDS[seed % len(KINDS)]
    rng = np.random.default_rng([seed, STREAM])
    xyz, cause = maker(seed, rng)
    if len(xyz) > 2 * MAX_POINTS:
        xyz, cause = _window(xyz, cause, rng)
    if rng.random() >= CLEAN:
        most = SHARE[1] if len(xyz) > FEW else SHARE_OF_FEW
        share = log_uniform(rng, SHARE[0], most)
        known = cause
        xyz, cause = add_errors(xyz, max(share, 10 / len(xyz)), rng)
        cause[: len(known)] = known
    xyz = _rounded(xyz, name, rng)
    order = rng.permutation(len(xyz))
    return SurveyScene(f'{name} {seed}', xyz[order], cause[order])


def _rounded(xyz: Floats, name: str, rng: np.random.Generator) -> Floats:
    """Round coordinates as files do: to decimals, or to single precision in a country's grid."""
    if rng.random() < ROUNDED:
        step = float(rng.choice([0.001, 0.01]))
        xyz = np.round(xyz / step) * step
    if name in FLOWN and rng.random() < SINGLE:
        origin = np.array([rng.uniform(3e5, 7e5), rng.uniform(1e6, 7e6), 0.0])
        xyz = (xyz + origin).astype(np.float32) - origin
    return xyz


def _good(xyz: Floats) -> tuple[Floats, Bytes]:
    return xyz, np.zeros(len(xyz), np.uint8)


def _window(xyz: Floats, cause: Bytes, rng: np.random.Generator) -> tuple[Floats, Bytes]:
    """Cut a stretch out of a large cloud, along its longer side on the map."""
    axis = int(np.argmax(np.ptp(xyz[:, :2], axis=0)))
    rank = np.argsort(xyz[:, axis], kind='stable')
    begin = int(rng.integers(len(xyz) - MAX_POINTS))
    some = rank[begin : begin + MAX_POINTS]
    return xyz[some], cause[some]


def _thin(xyz: Floats, rng: np.random.Generator) -> Floats:
    if rng.random() >= THINNED:
        return xyz
    return xyz[rng.random(len(xyz)) < rng.uniform(0.1, 0.8)]


def _in_lines(xyz: Floats, rng: np.random.Generator) -> Floats:
    """Keep what one or two flights see whose lines are farther apart than their points."""
    if rng.random() >= LINED:
        return xyz
    spacing = np.sqrt(np.prod(np.ptp(xyz[:, :2], axis=0)) / len(xyz))
    seen = np.zeros(len(xyz), np.bool_)
    for _ in range(int(rng.integers(1, 3))):
        way = rng.uniform(0.0, np.pi)
        across = np.cos(way) * xyz[:, 1] - np.sin(way) * xyz[:, 0]
        step = spacing * log_uniform(rng, *APART)
        seen |= across % step < step * rng.uniform(*WIDTH)
    return xyz[seen]


def _with_islands(xyz: Floats, rng: np.random.Generator) -> Floats:
    """Leave gaps around some parts of the ground, as between houses, or amidst water."""
    if rng.random() >= ISLANDS:
        return xyz
    tree, kept = cKDTree(xyz), np.ones(len(xyz), np.bool_)
    on_map = cKDTree(xyz[:, :2])
    for middle in xyz[rng.integers(len(xyz), size=int(rng.integers(*PARTS)))]:
        spacing = float(np.median(tree.query(middle, K + 1)[0][1:]))
        within = spacing * log_uniform(rng, *ISLAND)
        beyond = within + spacing * log_uniform(rng, *MOAT)
        around = xyz[on_map.query_ball_point(middle[:2], 2.0 * beyond), 2]
        if middle[2] > np.quantile(around, LOWER):
            continue
        near = np.array(tree.query_ball_point(middle, beyond))
        kept[near[np.linalg.norm(xyz[near] - middle, axis=1) > within]] = False
    return xyz[kept]


def _flight(_seed: int, rng: np.random.Generator, *, houses: bool) -> tuple[Floats, Bytes]:
    """Scan a town or mountains from the air."""
    lines = int(rng.integers(120, 300))
    how = Flight(
        lines,
        MAX_POINTS // lines,
        spacing=rng.uniform(0.3, 1.6),
        height=rng.uniform(250.0, 900.0),
        steep=rng.uniform(0.0, 0.05) if houses else rng.uniform(0.05, 0.5),
        plants=Plants(
            int(rng.integers(50, 400)) if houses else int(rng.integers(0, 10)),
            int(rng.integers(100, 1500)) if houses else int(rng.integers(500, 4000)),
            tall=(rng.uniform(3.0, 6.0), rng.uniform(8.0, 28.0)),
            wide=(rng.uniform(1.0, 1.8), rng.uniform(2.5, 5.0)),
            pointed=rng.uniform(0.0, 1.0),
        ),
        outliers=0,
    )
    leaves = (rng.uniform(0.1, 0.9), rng.uniform(0.5, 4.0))
    flown = fly(how, rng, leaves)
    distance = flown.distance + rng.uniform(0.005, 0.06) * rng.standard_normal(len(flown.distance))
    xyz = (flown.origin + distance * flown.direction).T
    xyz = _in_lines(np.ascontiguousarray(xyz), rng)
    return _good(_with_islands(_thin(xyz, rng), rng))


def _images(_seed: int, rng: np.random.Generator) -> tuple[Floats, Bytes]:
    """Match images of a country: a grid that is not quite even, rough where plants are."""
    density = log_uniform(rng, 4.0, 200.0)
    step, rows = 1.0 / np.sqrt(density), int(np.sqrt(MAX_POINTS))
    side = rows * step + 1.0
    area = side * side / 1e4
    plants = Plants(
        int(rng.integers(0, 6)),
        int(rng.uniform(10.0, 300.0) * max(area, 0.2)),
        tall=(rng.uniform(3.0, 8.0), rng.uniform(9.0, 26.0)),
        wide=(1.2, rng.uniform(2.0, 4.0)),
        pointed=rng.uniform(0.0, 1.0),
    )
    steep, cell = rng.uniform(0.0, 0.3), max(step, 0.1)
    x, y, view = look_down(rows**2, step, 1.0, cell, steep, plants, rng)
    smooth, rough = rng.uniform(0.005, 0.06), rng.uniform(0.03, 0.25)
    noise = np.where(view.kind == Kind.FOLIAGE, rough, smooth)
    xyz = np.stack([x, y, view.height + noise * rng.standard_normal(len(x))], axis=1)
    return _good(_with_islands(xyz, rng))


def _walls(_seed: int, rng: np.random.Generator) -> tuple[Floats, Bytes]:
    """Scan one to four bent surfaces one behind the other, in steps of their own."""
    parts = []
    for _ in range(int(rng.integers(1, 5))):
        step, across = log_uniform(rng, 0.02, 0.4), rng.uniform(0.4, 1.0)
        count = int(log_uniform(rng, 10, 90))
        u, v = (g.ravel() * step for g in np.meshgrid(np.arange(count), np.arange(count) * across))
        u, v = (g + rng.uniform(-0.3, 0.3, len(g)) * step for g in (u, v))
        length = count * step
        w = rng.uniform(0.0, 0.15) * length * np.sin(rng.uniform(1.0, 8.0) * u / length)
        w = w * np.cos(rng.uniform(1.0, 8.0) * v / length)
        xyz = np.stack([u, w + rng.uniform(-1.5, 1.5) * length, v], axis=1)
        xyz = xyz[rng.random(len(xyz)) < rng.uniform(0.8, 1.0)]
        parts.append(xyz + rng.uniform(0.0, 0.08) * step * rng.standard_normal(xyz.shape))
    return _good(np.concatenate(parts))


def _track(_seed: int, rng: np.random.Generator) -> tuple[Floats, Bytes]:
    """Note the positions of a bus, one a second, or the speed as well."""
    count = int(rng.integers(4000, 20_000))
    line = Line(
        count,
        int(rng.integers(20, 160)),
        int(rng.integers(6, 20)),
        rng.uniform(5.0, 15.0),
        rng.uniform(2.0, 7.0),
        rng.uniform(30.0, 600.0),
    )
    points = track(line, line.outliers, rng)
    xyz = np.stack([points[axis] for axis in 'xyz'], axis=1).astype(np.float64)
    if rng.random() < 0.5:  # noqa: PLR2004  half of them
        xyz[:, 2] = 0.0
    return xyz, points['label'].astype(np.uint8)


def _inside(seed: int, rng: np.random.Generator) -> tuple[Floats, Bytes]:
    """Scan a room or a street from a tripod."""
    shape = (int(rng.integers(90, 200)), int(rng.integers(400, 900)))
    scan = tripod.room(seed, *shape) if rng.random() < 0.5 else tripod.facades(seed, *shape)[0]  # noqa: PLR2004  half of them
    return scan.xyz, scan.points['label'].astype(np.uint8)


def _pieces(_seed: int, rng: np.random.Generator) -> tuple[Floats, Bytes]:
    """Measure plain things: planes, balls and tubes, evenly, in lines, or denser on one side."""
    count = int(log_uniform(rng, 2000, MAX_POINTS))
    u, v = rng.random((2, count))
    if rng.random() < 0.4:  # noqa: PLR2004  some of them
        lines = int(np.sqrt(count) * rng.uniform(0.2, 1.0))
        u = (np.floor(u * lines) + rng.uniform(0.0, 0.3, count)) / lines
    if rng.random() < 0.4:  # noqa: PLR2004  some of them
        v = v ** rng.uniform(1.0, 1.8)
    form, size = int(rng.integers(3)), np.exp(rng.uniform(-1.0, 4.0))
    if form == 0:
        xyz = np.stack([u, v, rng.uniform(-0.5, 0.5) * u], axis=1)
    elif form == 1:
        turn, z = 2.0 * np.pi * u, 2.0 * v - 1.0
        flat = np.sqrt(1.0 - z * z)
        xyz = np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)
    else:
        turn = np.pi * u
        xyz = np.stack([np.cos(turn), np.sin(turn), 3.0 * v], axis=1)
    spacing = size / np.sqrt(count)
    noise = np.exp(rng.uniform(-5.0, -1.2)) * spacing
    return _good(size * xyz + noise * rng.standard_normal(xyz.shape))


KINDS: tuple[tuple[str, Callable[[int, np.random.Generator], tuple[Floats, Bytes]]], ...] = (
    ('town', partial(_flight, houses=True)),
    ('mountains', partial(_flight, houses=False)),
    ('images', _images),
    ('walls', _walls),
    ('track', _track),
    ('tripod', _inside),
    ('images', _images),
    ('pieces', _pieces),
    ('mountains', partial(_flight, houses=False)),
    ('walls', _walls),
)
FLOWN = ('town', 'mountains')
