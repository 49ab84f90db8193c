# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Columns of a file → Points: which are the coordinates, the time and the scan line."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from lidar_outlier_filter.core.detectors.registry import sigma_field
from lidar_outlier_filter.core.engine.whole_cloud import with_rings
from lidar_outlier_filter.core.points.mask import mask_of, masked
from lidar_outlier_filter.core.points.points import Points, check_sigma, returns, too_coarse
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files import cloud_file
from lidar_outlier_filter.files.cleaning import scan
from lidar_outlier_filter.messages.decoder import (
    INTENSITY_NAMES,
    LINE_NAMES,
    TIME_NAMES,
    guess_unit,
    to_nanoseconds,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Columns
    from lidar_outlier_filter.files.cloud_file import CloudFile
    from lidar_outlier_filter.parameters.filter import FilterParameters

GPS_TIME = 'gps_time'
INTENSITIES = (*INTENSITY_NAMES, 'scalar_intensity', 'i')  # the third name is CloudCompare's
DIMENSIONS = (2, 3)


@dataclass(frozen=True)
class Loaded:
    """What was read of a file.

    Attributes
    ----------
    points : Points
        All of the file, in its order; time and line are 0 where there are no ``lines``.
    lines : str
        What the scan lines were found by; empty where the file has none.
    lack : str
        What the file lacks, so that it has no lines; empty where they were not asked for.
    more : columns by name
        What else was asked for.

    """

    points: Points
    lines: str
    lack: str
    more: Columns = field(default_factory=dict)

    @property
    def rings(self) -> int:
        """The number of rings that were recovered from elevations; 0: none."""
        ring = self.points.ring
        return 0 if ring is None else int(ring.max()) + 1


def choose_coordinates(file: CloudFile, wanted: Sequence[str]) -> tuple[str, ...]:
    """Return the columns that are the coordinates: those wanted, or x, y and z in either case.

    Raises
    ------
    CloudError
        If x, y or z is no column of numbers, or what is wanted are not two or three columns.

    """
    lower = {name.lower(): name for name in reversed(list(file.columns))}
    has = f'the columns {", ".join(file.columns) or "none"}'
    if not wanted and (lacks := [axis for axis in 'xyz' if axis not in lower]):
        must_be = 'with the numbers x, y and z, or clean --columns given'
        raise CloudError(f'{file.path}', must_be, f'no numbers {" and ".join(lacks)} in {has}')
    names = tuple(wanted) or tuple(lower[axis] for axis in 'xyz')
    for name in names:
        if name not in file.columns:
            raise CloudError(f'the coordinates {", ".join(names)}', f'columns of {file.path}', has)
    if len(names) not in DIMENSIONS or len(set(names)) < len(names):
        raise CloudError('the coordinates', 'two or three columns', ', '.join(names))
    return names


def say_coarse(
    file: CloudFile, coordinates: Sequence[str], points: Points, metres: Mapping[str, float]
) -> str:
    """Say that coordinates of a file are too far away for float32; empty: they are not."""
    kinds = [file.columns[name] for name in coordinates]
    single = [kind.kind == 'f' and kind.itemsize == 4 for kind in kinds]  # noqa: PLR2004  bytes
    single += [False] * (3 - len(single))
    return too_coarse(points.xyz, points.valid, single, metres.get(coordinates[0], 1.0))


def load(  # noqa: PLR0913  which columns, and where to
    file: CloudFile,
    coordinates: Sequence[str],
    parameters: FilterParameters,
    *,
    timed: bool,
    metres: Mapping[str, float] | None = None,
    more: Sequence[str] = (),
    allocate: Callable[[tuple[int, ...]], NDArray[np.float64]] = np.empty,
    progress: Callable[[int], object] = bool,
) -> Loaded:
    """Read the points of a file, in metres.

    Parameters
    ----------
    file : CloudFile
    coordinates : two or three columns; of two, z is 0
    parameters : name the columns of time, line and standard deviation
    timed : whether time and lines are wanted
    metres : of coordinates in other units, the metres that one of them is; None: as the file says
    more : other columns that are wanted
    allocate : gives the array for the coordinates, in memory or in a file
    progress : is called with how many points have been read

    Raises
    ------
    CloudError
        If the file cannot be read, has not the columns that the parameters name, or holds a point
        farther away than ``FARTHEST``.

    """
    of_lines = _others(file, parameters) if timed else []
    mask = mask_of(parameters)
    ring = [] if mask is None else [_ring(file, parameters)]
    others = list(dict.fromkeys([*of_lines, *more, *ring]))
    sizes = file.metres if metres is None else metres
    xyz = allocate((len(file), 3))
    columns: dict[str, NDArray[Any]] = {}
    done = 0
    for chunk in cloud_file.read_exact(file, [*coordinates, *others]):
        part = slice(done, done + len(chunk[0]))
        for axis in range(3):
            xyz[part, axis] = cloud_file.filled(chunk[axis]) if axis < len(coordinates) else 0.0
            if axis < len(coordinates) and coordinates[axis] in sizes:
                xyz[part, axis] *= sizes[coordinates[axis]]
        for name, values in zip(others, chunk[len(coordinates) :], strict=True):
            if done == 0:
                columns[name] = np.ma.empty(len(file), values.dtype)
            elif values.dtype.kind == 'f' != columns[name].dtype.kind:
                columns[name] = columns[name].astype(np.float64)  # the first that is not whole
            columns[name][part] = values
        done = part.stop
        progress(done)
    zeros = np.zeros(len(file), np.int64)
    points = Points(xyz, zeros, zeros, returns(xyz))
    for name in ring:
        rings = _numbers_of_lines(columns[name], points.valid, name)
        points = replace(masked(replace(points, line=rings), mask, parameters), line=zeros)
    found = Loaded(points, '', '')
    if timed:
        # A standard deviation has the unit of the coordinates beside it.
        size = sizes.get(coordinates[0], 1.0)
        found = _with_lines(file, found.points, columns, parameters, size)
    return replace(found, more={name: columns[name] for name in more})


def recovered(file: CloudFile, loaded: Loaded, parameters: FilterParameters) -> Loaded:
    """Recover the rings of a file without scan lines, and read its intensities, if it has rings."""
    found = with_rings(loaded.points, parameters)
    if found.ring is None:
        return loaded
    name = _named(file, 'auto', 'the intensity', INTENSITIES)
    if name and file.columns[name].kind in 'iuf':
        parts = [values for (values,) in cloud_file.read_exact(file, [name])]
        found = replace(found, intensity=np.concatenate([_singles(part) for part in parts]))
    return replace(loaded, points=found)


def _singles(values: NDArray[Any]) -> NDArray[np.float32]:
    singles: NDArray[np.float32] = np.ma.filled(np.ma.asarray(values, np.float32), np.nan)
    return singles


def _others(file: CloudFile, parameters: FilterParameters) -> list[str]:
    """List the columns that may hold time, line and standard deviation."""
    named = [
        _named(file, parameters.time_field, 'time_field', (GPS_TIME, *TIME_NAMES)),
        _named(file, parameters.line_field, 'line_field', LINE_NAMES),
    ]
    if parameters.angle_field:
        named.append(_named(file, parameters.angle_field, 'angle_field', ()))
    sigma, parameter = sigma_field(parameters)
    if sigma:
        named.append(_named(file, sigma, parameter, ()))
    if named[0]:
        named += [name for name in scan.COLUMNS if name in file.columns]
    return list(dict.fromkeys(name for name in named if name))


def _ring(file: CloudFile, parameters: FilterParameters) -> str:
    """Name the column with the ring of each point, which a mask needs."""
    name = _named(file, parameters.line_field, 'line_field', LINE_NAMES)
    if not name:
        must_be = f'one of {", ".join(LINE_NAMES)}, or line_field given, where there is a mask'
        raise CloudError('the line column', must_be, f'the columns {", ".join(file.columns)}')
    return name


def _named(file: CloudFile, name: str, parameter: str, usual: Sequence[str]) -> str:
    """Return the column that a parameter names; under 'auto' the first usual one, or none."""
    if name == 'auto':
        lower = {column.lower(): column for column in reversed(list(file.columns))}
        return next((lower[one] for one in usual if one in lower), '')
    if name not in file.columns:
        must_be = f'a column of {file.path}: {", ".join(file.columns) or "none"}'
        raise CloudError(parameter, must_be, repr(name))
    return name


def _with_lines(
    file: CloudFile, points: Points, columns: Columns, parameters: FilterParameters, size: float
) -> Loaded:
    """Add time, line and standard deviation, of ``size`` metres, if the columns hold them."""
    time = _named(file, parameters.time_field, 'time_field', (GPS_TIME, *TIME_NAMES))
    if not time:
        return Loaded(points, '', 'no column with the time of each point')
    values, unit = np.ma.getdata(columns[time]), parameters.time_unit
    if (points.valid & np.ma.getmaskarray(columns[time])).any():
        raise CloudError('the time of a point', 'finite and within 73 years', np.nan)
    if unit == 'auto':
        sizes = np.abs(values[points.valid].astype(np.float64))
        # A table that is text does not say that its numbers are whole.
        said = file.columns[time]
        kind = said if said.kind == 'f' else values.dtype
        unit = 's' if time.lower() == GPS_TIME else guess_unit(kind, sizes)
    t = to_nanoseconds(values, points.valid, unit)
    found = _lines(file, points.valid, t, columns, parameters)
    if found is None:
        return Loaded(points, '', 'no column that says its scan lines')
    sigma = _sigma(columns, points.valid, sigma_field(parameters)[0], size)
    timed = replace(points, t=t, line=found.line, sigma=sigma)
    return Loaded(timed, f'{time} ({unit}) and {found.found_by}', '')


def _lines(
    file: CloudFile,
    valid: NDArray[np.bool_],
    t: NDArray[np.int64],
    columns: Columns,
    parameters: FilterParameters,
) -> scan.ScanLines | None:
    """Find the scan lines in the way that ``line_source`` says."""
    source = parameters.line_source
    if source not in {'auto', 'field', 'angle'}:
        raise CloudError('line_source', "'auto', 'field' or 'angle' for a file", repr(source))
    field = _named(file, parameters.line_field, 'line_field', LINE_NAMES)
    if source == 'field' and not field:
        must_be = f'one of {", ".join(LINE_NAMES)}, or line_field given'
        raise CloudError('the line column', must_be, f'the columns {", ".join(file.columns)}')
    if field and source != 'angle':
        return scan.ScanLines(_numbers_of_lines(columns[field], valid, field), field)
    angle = parameters.angle_field
    if source == 'angle' and not angle:
        angle = next((name for name in scan.ANGLES if name in columns), '')
        if not angle:
            must_be = f'one of {", ".join(scan.ANGLES)}, or angle_field given'
            raise CloudError('the angle column', must_be, f'the columns {", ".join(file.columns)}')
    plain = {name: cloud_file.filled(values) for name, values in columns.items()}
    return scan.find(t, plain, angle)


def _numbers_of_lines(line: NDArray[Any], valid: NDArray[np.bool_], name: str) -> NDArray[np.int64]:
    """Return the line of each point; 0 for a missing return that has none."""
    values = np.ma.getdata(line)
    whole = ~np.ma.getmaskarray(line)
    if values.dtype.kind == 'f':
        whole &= np.isfinite(values) & (values == np.floor(values))
    if not whole[valid].all():
        raise CloudError(f'column {name!r}', 'of whole numbers', 'others')
    return np.where(whole, values, 0).astype(np.int64)


def _sigma(
    columns: Columns, valid: NDArray[np.bool_], name: str, size: float
) -> NDArray[np.float64] | None:
    if not name:
        return None
    sigma = cloud_file.filled(columns[name]).astype(np.float64) * size
    check_sigma(sigma, valid, f'column {name!r}')
    return sigma
