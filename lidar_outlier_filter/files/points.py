# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Columns of a file → Points: coordinates in metres, times, and scan lines.

LAS has no column with the number of a scan line. There, lines are found by the columns that record
the motion of the mirror.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Bools, Columns, Floats, Ints
from lidar_outlier_filter.core.engine.chain import uses_lines
from lidar_outlier_filter.core.engine.whole_cloud import check_chain
from lidar_outlier_filter.core.points.mask import mask_of, masked
from lidar_outlier_filter.core.points.points import (
    INTENSITY_NAMES,
    LINE_NAMES,
    TIME_NAMES,
    Points,
    check_sigma,
    guess_unit,
    returns,
    to_nanoseconds,
    too_coarse,
)
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files import cloud_file
from lidar_outlier_filter.files.cloud_file import CloudFile
from lidar_outlier_filter.parameters.filter import FilterParameters

GPS_TIME, CLASSIFICATION = 'gps_time', 'classification'
TIMES = (GPS_TIME, *TIME_NAMES)
INTENSITIES = (*INTENSITY_NAMES, 'scalar_intensity', 'i')  # CloudCompare writes scalar_…
EDGE, DIRECTION, RETURN = 'edge_of_flight_line', 'scan_direction_flag', 'return_number'
ANGLES = ('scan_angle', 'scan_angle_rank')
SOURCES = ('point_source_id', 'scanner_channel')
MIRROR = (EDGE, DIRECTION, *ANGLES)
LAS_COLUMNS = (*MIRROR, RETURN, *SOURCES)
ANGLE_NOISE = 12  # a step smaller than this part of the angle's span may be noise


@dataclass(frozen=True)
class Loaded:
    """Points that were read from a file.

    Attributes
    ----------
    points : Points
        All points in file order; time and line are 0 where there are no ``lines``.
    lines : str
        How scan lines were found; empty where the file has none.
    lack : str
        Why the file has no scan lines; empty if they were not requested.
    more : columns by name
        Further requested columns.

    """

    points: Points
    lines: str = ''
    lack: str = ''
    more: Columns = field(default_factory=dict)

    @property
    def rings(self) -> int:
        """The number of rings that were recovered from elevations; 0: none."""
        ring = self.points.ring
        return 0 if ring is None else int(ring.max()) + 1


def choose_coordinates(file: CloudFile, requested: Sequence[str]) -> tuple[str, ...]:
    """Return the columns with the coordinates: those requested, or x, y and z in either case."""
    lower = {name.lower(): name for name in reversed(list(file.columns))}
    has = f'the columns {", ".join(file.columns) or "none"}'
    if not requested and (lacks := [axis for axis in 'xyz' if axis not in lower]):
        columns = '1,2,3 (it has no header)' if '1' in file.columns else 'X,Y,Z'
        must_be = f'with numeric columns x, y and z, or read with --columns {columns}'
        raise CloudError(f'{file.path}', must_be, f'no numbers {" and ".join(lacks)} in {has}')
    names = tuple(requested) or tuple(lower[axis] for axis in 'xyz')
    for name in names:
        if name not in file.columns:
            raise CloudError(f'the coordinates {", ".join(names)}', f'columns of {file.path}', has)
    if len(names) not in {2, 3} or len(set(names)) < len(names):
        raise CloudError('the coordinates', 'two or three columns', ', '.join(names))
    return names


def say_coarse(
    file: CloudFile, coordinates: Sequence[str], points: Points, metres: Mapping[str, float]
) -> str:
    """Say that float32 coordinates are too far from the origin; empty: they are not."""
    single = [file.columns[name] == np.float32 for name in coordinates]
    single += [False] * (3 - len(single))
    return too_coarse(points.xyz, points.valid, single, metres.get(coordinates[0], 1.0))


def load(  # noqa: PLR0913  which columns, and where to
    file: CloudFile,
    coordinates: Sequence[str],
    parameters: FilterParameters,
    *,
    timed: bool | None = None,
    in_one_piece: bool = True,
    metres: Mapping[str, float] | None = None,
    more: Sequence[str] = (),
    allocate: Callable[[tuple[int, ...]], Floats] = np.empty,
    progress: Callable[[int], object] = bool,
) -> Loaded:
    """Read the points of a file, in metres; refuse a chain that needs scan lines it lacks.

    Parameters
    ----------
    file : CloudFile
    coordinates : two or three columns; z is 0 if there are two
    parameters : name the columns of time, line and standard deviation
    timed : whether times and scan lines are needed; None: where a detector uses them
    in_one_piece : whether more than ``max_points`` are refused before they are read
    metres : metres per unit of coordinates in other units; None: as the file says
    more : further columns to read
    allocate : returns the array for the coordinates, in memory or in a file
    progress : called with the number of points read so far

    """
    if timed is None:
        timed = uses_lines(parameters.chain)
    if in_one_piece and len(file) > parameters.max_points:
        # A few bytes of Parquet may be as many points as they like.
        must_be = f'at most max_points = {parameters.max_points}, to be judged in one piece'
        raise CloudError(f'the number of points of {file.path}', must_be, len(file))
    mask = mask_of(parameters)
    ring = [] if mask is None else [_line_column(file, parameters, 'where there is a mask')]
    others = list(dict.fromkeys([*_timing(file, parameters, timed=timed), *more, *ring]))
    sizes = file.metres if metres is None else metres
    xyz, columns = _read(file, coordinates, others, sizes, allocate, progress)
    kept = {name: columns[name] for name in more}
    zeros = np.zeros(len(file), np.int64)
    points = Points(xyz, zeros, zeros, returns(xyz))
    for name in ring:
        rings = _line_numbers(columns[name], points.valid, name)
        points = replace(masked(replace(points, line=rings), mask, parameters), line=zeros)
    found = Loaded(points)
    if timed:
        # A standard deviation has the unit of the coordinates beside it.
        size = sizes.get(coordinates[0], 1.0)
        found = _with_lines(file, points, columns, parameters, size)
    if found.lack:
        check_chain(parameters.chain, str(file.path), found.lack)
    return replace(found, more=kept)


def _read(  # noqa: PLR0913  which columns, and where to
    file: CloudFile,
    coordinates: Sequence[str],
    others: Sequence[str],
    metres: Mapping[str, float],
    allocate: Callable[[tuple[int, ...]], Floats],
    progress: Callable[[int], object],
) -> tuple[Floats, dict[str, NDArray[Any]]]:
    """Read coordinates, in metres, and other columns, which keep their types."""
    xyz = allocate((len(file), 3))
    columns: dict[str, NDArray[Any]] = {}
    done = 0
    for chunk in cloud_file.read(file, [*coordinates, *others], exact=True):
        part = slice(done, done + len(chunk[0]))
        xyz[part, len(coordinates) :] = 0.0
        for axis, name in enumerate(coordinates):
            xyz[part, axis] = cloud_file.filled(chunk[axis])
            if name in metres:
                xyz[part, axis] *= metres[name]
        for name, values in zip(others, chunk[len(coordinates) :], strict=True):
            if done == 0:
                columns[name] = np.ma.empty(len(file), values.dtype)
            elif values.dtype.kind == 'f' != columns[name].dtype.kind:
                columns[name] = columns[name].astype(np.float64)  # the first that is not whole
            columns[name][part] = values
        done = part.stop
        progress(done)
    return xyz, columns


def recovered(file: CloudFile, loaded: Loaded, found: Points) -> Loaded:
    """Take the rings that were found in a file without scan lines; read its intensities then."""
    if found.ring is None:
        return loaded
    name = _named(file, 'auto', 'the intensity', INTENSITIES)
    if name and file.columns[name].kind in 'iuf':
        parts = [values for (values,) in cloud_file.read(file, [name])]
        found = replace(found, intensity=np.concatenate(parts).astype(np.float32))
    return replace(loaded, points=found)


def _timing(file: CloudFile, parameters: FilterParameters, *, timed: bool) -> list[str]:
    """List the columns that may hold time, line and standard deviation."""
    if not timed:
        return []
    time = _named(file, parameters.time_field, 'time_field', TIMES)
    sigma = parameters.sigma_field
    named = [
        time,
        _named(file, parameters.line_field, 'line_field', LINE_NAMES),
        parameters.angle_field and _named(file, parameters.angle_field, 'angle_field', ()),
        sigma and _named(file, sigma, 'sigma_field', ()),
        *(name for name in LAS_COLUMNS if time and name in file.columns),
    ]
    return [name for name in named if name]


def _line_column(file: CloudFile, parameters: FilterParameters, where: str = '') -> str:
    """Name the column with the line or ring of each point; refuse a file without one."""
    name = _named(file, parameters.line_field, 'line_field', LINE_NAMES)
    if not name:
        must_be = f'one of {", ".join(LINE_NAMES)}, or line_field given'
        must_be += f', {where}' if where else ''
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
    """Add time, line and standard deviation (``size`` metres per unit) if the columns hold them."""
    time = _named(file, parameters.time_field, 'time_field', TIMES)
    if not time:
        return Loaded(points, lack='no column with the time of each point')
    values, unit = np.ma.getdata(columns[time]), parameters.time_unit
    if (points.valid & np.ma.getmaskarray(columns[time])).any():
        raise CloudError('the time of a point', 'finite and within 73 years', np.nan)
    if unit == 'auto':
        # A text table has no integer type.
        said = file.columns[time]
        kind = said if said.kind == 'f' else values.dtype
        sizes = np.abs(values[points.valid].astype(np.float64))
        unit = 's' if time.lower() == GPS_TIME else guess_unit(kind, sizes)
    t = to_nanoseconds(values, points.valid, unit)
    line, found_by = _lines(file, points.valid, t, columns, parameters)
    if line is None:
        return Loaded(points, lack='no column that says its scan lines')
    sigma = None
    if name := parameters.sigma_field:
        sigma = cloud_file.filled(columns[name]).astype(np.float64) * size
        check_sigma(sigma, points.valid, f'column {name!r}')
    timed = replace(points, t=t, line=line, sigma=sigma)
    return Loaded(timed, f'{time} ({unit}) and {found_by}')


def _lines(
    file: CloudFile, valid: Bools, t: Ints, columns: Columns, parameters: FilterParameters
) -> tuple[Ints | None, str]:
    """Find the scan lines as ``line_source`` says; return them, and the column that shows them."""
    source = parameters.line_source
    if source not in {'auto', 'field', 'angle'}:
        raise CloudError('line_source', "'auto', 'field' or 'angle' for a file", repr(source))
    field = _named(file, parameters.line_field, 'line_field', LINE_NAMES)
    if source == 'field' or (field and source != 'angle'):
        field = _line_column(file, parameters)
        return _line_numbers(columns[field], valid, field), field
    angle = parameters.angle_field
    if source == 'angle' and not angle:
        angle = next((name for name in ANGLES if name in columns), '')
        if not angle:
            must_be = f'one of {", ".join(ANGLES)}, or angle_field given'
            raise CloudError('the angle column', must_be, f'the columns {", ".join(file.columns)}')
    plain = {name: cloud_file.filled(values) for name, values in columns.items()}
    return find_lines(t, plain, angle)


def _line_numbers(line: NDArray[Any], valid: Bools, name: str) -> Ints:
    """Return the line of each point; 0 for a missing return that has none."""
    values = np.ma.getdata(line)
    whole = ~np.ma.getmaskarray(line)
    if values.dtype.kind == 'f':
        whole &= np.isfinite(values) & (values == np.floor(values))
    if not whole[valid].all():
        raise CloudError(f'column {name!r}', 'of whole numbers', 'others')
    return np.where(whole, values, 0).astype(np.int64)


def find_lines(t: Ints, columns: Columns, angle: str = '') -> tuple[Ints | None, str]:
    """Find the scan lines of points by the columns of LAS.

    Parameters
    ----------
    t : (N,) int64, nanoseconds
        In any order.
    columns : (N,) each, by name
        Those of :data:`LAS_COLUMNS` that exist, and the one that ``angle`` names.
    angle : str
        Column with the scan angle, any unit. If empty, the first of these that occurs ends lines:
        a point marked as edge of the flight line; a change of the scan direction flag; a step
        of a source's angle by more than half of its span or, if the angle mostly steps one way,
        a step back by more than a twelfth of its span.

    Returns
    -------
    line : (N,) int64 or None
        Numbers of the lines; first, second and later returns have separate lines. None if no column
        ends lines.
    found_by : str
        The column whose changes end the lines.

    """
    sources = [columns[name] for name in SOURCES if name in columns]
    order = np.lexsort((t, *reversed(sources)))
    t = t[order]
    source_begins = np.zeros(len(t), np.bool_)
    for source in sources:
        source_begins[1:] |= source[order][1:] != source[order][:-1]
    for name in (angle,) if angle else MIRROR:
        if name not in columns:
            continue
        begins = _begins(columns[name][order], name, t, source_begins) & ~source_begins
        if begins.any():
            line = np.empty(len(order), np.int64)
            line[order] = np.cumsum(begins | source_begins, dtype=np.int64)
            if RETURN in columns:
                number = columns[RETURN].astype(np.int64)
                line = line * (int(number.max(initial=0)) + 1) + number
            return line, name
    return None, ''


def _begins(values: NDArray[Any], name: str, t: Ints, source_begins: Bools) -> Bools:
    """Return where a line begins by a column, whose values are in order."""
    if name == EDGE:
        return _behind_edges(values, t)
    if name == DIRECTION:
        return np.append([False], values[1:] != values[:-1])[: len(values)]
    parts = np.split(values.astype(np.float64), np.flatnonzero(source_begins))
    return np.concatenate([_turns(part) for part in parts if len(part)] or [source_begins])


def _behind_edges(edge: NDArray[Any], t: Ints) -> Bools:
    """Return where a line begins: at the shot after one with a return that is marked."""
    begins = np.zeros(len(t), np.bool_)
    begins[1:] = t[1:] != t[:-1]
    shot = np.cumsum(begins)
    marked = np.zeros(len(t), np.bool_)
    marked[shot[edge != 0]] = True
    begins &= marked[shot - 1] & (shot > 0)
    return begins


def _turns(angle: Floats) -> Bools:
    """Return where the angle jumps back, of the points of one source, in order."""
    begins = np.zeros(len(angle), np.bool_)
    step, span = np.diff(angle), angle.max() - angle.min()
    begins[1:] = np.abs(step) > span / 2
    small = step[np.abs(step) <= span / ANGLE_NOISE]
    net = small.sum()
    if abs(net) > np.abs(small).sum() / 2:
        # The mirror turns one way: it does not swing.
        begins[1:] |= np.sign(net) * step < -span / ANGLE_NOISE
    return begins
