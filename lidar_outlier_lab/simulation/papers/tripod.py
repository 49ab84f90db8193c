# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Scans from a tripod, as in Sotoodeh 2006, section 5.2 (a room) and 2007, section 4.2 (a facade).

A scan is a range image: a row for each elevation, a column for each azimuth. Points between two
surfaces are where a beam meets both: at the boundaries of occlusions.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Floats, Ints, Rows
from lidar_outlier_filter.evaluation.truth import Cause, Kind
from lidar_outlier_lab.simulation.scenes.random_streets import Town, birds, car, lay_out
from lidar_outlier_lab.simulation.world.drive import Disturbances, Drive, join, simulate
from lidar_outlier_lab.simulation.world.particles import ThinFall
from lidar_outlier_lab.simulation.world.scene import Air, Scene, Surface, box, ground, tube
from lidar_outlier_lab.simulation.world.sensors import SpinningScanner
from lidar_outlier_lab.simulation.world.trajectory import Route

NOTHING_ELSE = Disturbances(reflection=0.0, near_surface=0.0)
DARK, BRIGHT = 0.08, 0.7  # reflectances


class RangeImage(NamedTuple):
    """A scan from one position.

    Attributes
    ----------
    points : (N,) x, y, z (metres), intensity, label and surface
    row, column : (N,) int64, index of each point in the image; row 0 is the highest
    shape : (rows, columns)

    """

    points: Rows
    row: Ints
    column: Ints
    shape: tuple[int, int]

    @property
    def xyz(self) -> Floats:
        """Coordinates (N, 3), metres."""
        return np.stack([self.points[axis] for axis in 'xyz'], axis=1).astype(np.float64)

    def image(self, values: Floats) -> Floats:
        """Put a value of each point into its pixel; NaN where no echo came."""
        pixels = np.full(self.shape, np.nan)
        pixels[self.row, self.column] = values
        return pixels


def scan(
    surfaces: Sequence[Surface],
    position: tuple[float, float, float],
    shape: tuple[int, int],
    seed: int,
    air: tuple[Air, ...] = (),
) -> RangeImage:
    """Scan a scene from a position, all around and 30° up and down."""
    rows, columns = shape
    x, y, z = position
    stands = Route(((0.0, 0.0, 0.0),), (x, y, 0.0), bump=0.0, tremble=0.0, mount=(0.0, 0.0, z))
    sensor = SpinningScanner(
        elevation=tuple(np.radians(np.linspace(30.0, -30.0, rows))),
        columns=columns,
        column_time=200 * rows,
        noise=0.002,
        resolution=0.0,
        nearest=0.4,
        divergence=0.0006,
        # A phase scanner measures one mean of all that its beam meets.
        pulse=8.0,
        aperture=0.002,
    )
    drive = Drive(
        Scene(tuple(surfaces), air),
        lines=1,
        sensor=sensor,
        trajectory=stands,
        disturbances=NOTHING_ELSE,
        seed=seed,
    )
    shot, points = join([returns for _, returns in simulate(drive)])
    return RangeImage(points, shot % rows, shot // rows, shape)


def room(seed: int, rows: int = 240, columns: int = 1440) -> RangeImage:
    """Scan a room: a table with two screens, chairs with thin legs, a dark frame on the wall."""
    rng = np.random.default_rng([seed, rows])
    x, y, tall = 3.4, 2.8, 2.6
    wall, wide = Kind.FACADE, 0.1
    surfaces: list[Surface] = [
        ground(-x, x, y, kind=Kind.ROAD),
        box((-x, -y, tall), (x, y, tall + wide), wall, BRIGHT),
        *(box((s * x, -y, 0.0), (s * x + wide, y, tall), wall, BRIGHT) for s in (-1.03, 1)),
        *(box((-x, s * y, 0.0), (x, s * y + wide, tall), wall, BRIGHT) for s in (-1.03, 1)),
        box((1.3, -1.3, 0.70), (2.1, 1.3, 0.74), Kind.SIGN, 0.5),
        box((x - 0.05, -0.2, 1.4), (x, 0.9, 2.1), Kind.GLASS, DARK),
    ]
    for side in (-0.7, 0.5):
        turn = rng.uniform(-0.1, 0.1)
        surfaces += [
            box((1.7 + turn, side, 0.85), (1.76 + turn, side + 0.5, 1.2), Kind.SIGN, 0.3),
            tube((1.73, side + 0.25, 0.7), (1.73, side + 0.25, 0.9), 0.03, Kind.POLE),
        ]
    legs = [(1.35, -1.2), (1.35, 1.2), (2.0, -1.2), (2.0, 1.2)]
    for middle in (-1.9, 1.7):
        x, y = 0.9 + rng.uniform(-0.1, 0.1), middle
        surfaces += [
            box((x, y, 0.44), (x + 0.42, y + 0.42, 0.47), Kind.SIGN, 0.4),
            box((x, y, 0.55), (x + 0.03, y + 0.42, 0.95), Kind.SIGN, 0.4),
        ]
        legs += [(x + a, y + b) for a in (0.03, 0.39) for b in (0.03, 0.39)]
    surfaces += [tube((a, b, 0.0), (a, b, 0.46), 0.015, Kind.POLE, BRIGHT) for a, b in legs]
    return scan(surfaces, (-1.2, 0.0, 1.3), (rows, columns), seed)


def facades(seed: int, rows: int = 200, columns: int = 1200) -> list[RangeImage]:
    """Scan a street from three positions: birds and flakes in the air, cars in the way."""
    rng = np.random.default_rng([seed, columns])
    found = []
    for number, x in enumerate((-14.0, 0.0, 17.0)):
        things = (*birds((x + 4.0, 2.0), 8, rng), *car(x + 7.0, 2.5, rng, (0.0, 0.0, 0.0)))
        surfaces = lay_out(Town(trees=False, things=things, start=-45.0, end=45.0), rng)
        position = (x, rng.uniform(-1.0, 1.0), 1.7)
        air = (ThinFall(Cause.SNOW, 0.0005, 15.0),)
        found.append(scan(surfaces, position, (rows, columns), seed + number, air))
    return found
