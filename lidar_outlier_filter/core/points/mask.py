# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What a sensor sees of its own vehicle: ranges by ring and azimuth, an image that is a file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.kernels.kernels import inner_kernel, kernel
from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.declaration import OFF

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Bools, Floats, Ints
    from lidar_outlier_filter.core.points.points import Points
    from lidar_outlier_filter.parameters.filter import FilterParameters

COLUMNS = 720  # of the image: half a degree each, the first from 0° on, against the clock
MOST_RINGS = 1024
FARTHEST = 100.0  # metres: no vehicle is longer
HEAD = f'# own vehicle, {COLUMNS} columns, metres'
NAMES = 'ring,column,near,far'
LARGEST_FILE = 32_000_000  # bytes
NEEDS_RINGS = 'the rings of the sensor, by a field or by rows, where there is a mask'


@dataclass(frozen=True, eq=False)
class Mask:
    """The own vehicle in the frame of its sensor.

    Attributes
    ----------
    near, far : (R, COLUMNS) float64
        Between which ranges, metres, it is seen; inf and -inf in directions where it is not.

    """

    near: Floats
    far: Floats

    @classmethod
    def nothing(cls, rings: int) -> Mask:
        """Return an image without a vehicle."""
        return cls(np.full((rings, COLUMNS), np.inf), np.full((rings, COLUMNS), -np.inf))

    @property
    def is_seen(self) -> Bools:
        """Where the vehicle is, (R, COLUMNS)."""
        return np.asarray(self.far >= self.near)

    def covers(self, points: Points, tolerance: float, *, rays: bool) -> Bools:
        """Return which of N valid points are of the vehicle; others are not.

        Parameters
        ----------
        points : in the sensor's own frame, whose lines are its rings
        tolerance : metres, in front of the nearest range and behind the farthest
        rays : whether all that lies behind is covered, too, but at the edges of the vehicle

        """
        return _cover(
            points.xyz, points.line, points.valid, self.near, self.far, tolerance, bool(rays)
        )


@kernel
def _cover(
    xyz: Floats,
    line: Ints,
    valid: Bools,
    near: Floats,
    far: Floats,
    tolerance: float,
    rays: bool,
) -> Bools:
    result = np.zeros(len(line), np.bool_)
    for i in range(len(line)):
        if valid[i] and 0 <= line[i] < len(near):
            column = _column(xyz[i, 0], xyz[i, 1])
            low, high = near[line[i], column] - tolerance, far[line[i], column] + tolerance
            distance = _range(xyz[i])
            # At its edges the scene is seen past the vehicle.
            left, right = near[line[i], column - 1], near[line[i], (column + 1) % COLUMNS]
            behind = rays and max(left, right) < np.inf
            result[i] = low <= distance and (behind or distance <= high)
    return result


@inner_kernel
def _column(x: float, y: float) -> int:
    return int(np.floor((np.arctan2(y, x) / (2 * np.pi)) * COLUMNS)) % COLUMNS


@inner_kernel
def _range(xyz: Floats) -> float:
    return float(np.sqrt(xyz[0] * xyz[0] + xyz[1] * xyz[1] + xyz[2] * xyz[2]))


@kernel
def look(xyz: Floats) -> tuple[Ints, Floats]:
    """Return the columns of N points, and their ranges, metres."""
    column, distance = np.empty(len(xyz), np.int64), np.empty(len(xyz))
    for i in range(len(xyz)):
        column[i], distance[i] = _column(xyz[i, 0], xyz[i, 1]), _range(xyz[i])
    return column, distance


def masked(points: Points, mask: Mask | None, parameters: FilterParameters) -> Points:
    """Take the own vehicle out of points: what is masked is not valid, and nobody's neighbour."""
    if mask is None:
        return points
    rays = parameters.mask_mode == 'ray'
    covered = mask.covers(points, parameters.mask_tolerance, rays=rays)
    return replace(points, valid=points.valid & ~covered, masked=covered)


def mask_of(parameters: FilterParameters) -> Mask | None:
    """Read the mask that the parameters name; None: it is off.

    Raises
    ------
    ParameterError
        If there is no such file, or it holds no mask.

    """
    return None if parameters.mask == OFF else read_mask(Path(parameters.mask))


def content_of(parameters: FilterParameters) -> str:
    """Hash the file of the mask, so that one that was learnt anew counts as another.

    ``off`` without one; of a file that cannot be read, its name: it is refused where it is read.
    """
    if parameters.mask == OFF:
        return OFF
    try:
        return sha256(Path(parameters.mask).read_bytes()).hexdigest()
    except OSError:
        return parameters.mask


def read_mask(path: Path) -> Mask:
    """Read a mask; a file that holds none is refused as a whole.

    Raises
    ------
    ParameterError
        If it cannot be read, or a line of it makes no sense.

    """
    try:
        with path.open('rb') as stream:
            data = stream.read(LARGEST_FILE + 1)
        lines = data.decode('ascii').splitlines()
    except (OSError, ValueError) as err:
        reason = getattr(err, 'strerror', None) or 'bytes that are no text'
        raise ParameterError(f'the mask {path}', 'a readable file', f'"{reason}"') from err
    if len(data) > LARGEST_FILE:
        raise ParameterError(f'the mask {path}', f'of at most {LARGEST_FILE} bytes', 'more')
    if lines[:2] != [HEAD, NAMES]:
        must_be = f'one that begins with {HEAD!r} and {NAMES!r}'
        raise ParameterError(f'the mask {path}', must_be, repr(' '.join(lines[:2])))
    cells = [_cell(path, number, line) for number, line in enumerate(lines[2:], 3)]
    mask = Mask.nothing(1 + max((int(ring) for ring, *_ in cells), default=-1))
    for number, (ring, column, near, far) in enumerate(cells, 3):
        cell = int(ring), int(column)
        if mask.far[cell] >= 0:
            raise ParameterError(f'line {number} of the mask {path}', 'another cell', cell)
        mask.near[cell], mask.far[cell] = near, far
    return mask


def _cell(path: Path, number: int, line: str) -> tuple[float, float, float, float]:
    """Read a line: ring, column, and between which ranges."""
    try:
        ring, column, near, far = map(float, line.split(','))
    except ValueError:
        ring = column = near = far = np.nan
    whole = ring in range(MOST_RINGS) and column in range(COLUMNS)
    if not (whole and 0 <= near <= far <= FARTHEST):
        must_be = (
            f'a ring below {MOST_RINGS}, a column below {COLUMNS}, and two ranges, the nearer '
            f'first, up to {FARTHEST:g} m'
        )
        raise ParameterError(f'line {number} of the mask {path}', must_be, repr(line))
    return ring, column, near, far


def as_text(mask: Mask) -> str:
    """Write a mask as :func:`read_mask` reads it, a line for each cell; ranges in millimetres."""
    lines = [HEAD, NAMES]
    for ring, column in np.argwhere(mask.is_seen).tolist():
        near, far = mask.near[ring, column], mask.far[ring, column]
        lines.append(f'{ring},{column},{near:.3f},{far:.3f}')
    return '\n'.join(lines) + '\n'
