# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Columns of a file → Points: coordinates in metres, times, and scan lines."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Bools, Columns, Floats, Ints
from lidar_outlier_filter.core.detectors.registry import read_field, reads
from lidar_outlier_filter.core.engine.chain import along_lines, uses_lines
from lidar_outlier_filter.core.engine.stream_lines import line_period
from lidar_outlier_filter.core.engine.whole_cloud import check_chain
from lidar_outlier_filter.core.points import columns as usual
from lidar_outlier_filter.core.points.line_recovery import MAX_HEADS, Claim, settle_lines
from lidar_outlier_filter.core.points.mask import mask_of, masked
from lidar_outlier_filter.core.points.points import Points, check_sigma, returns, too_coarse
from lidar_outlier_filter.errors import CloudError, ParameterError
from lidar_outlier_filter.files import cloud_file
from lidar_outlier_filter.files.cloud_file import CloudFile
from lidar_outlier_filter.files.mirror_lines import (
    ANGLE_FIELDS,
    LAS_COLUMNS,
    SCANNERS,
    SOURCES,
    USER_DATA,
    find_lines,
)
from lidar_outlier_filter.parameters.filter import FilterParameters

GPS_TIME, CLASSIFICATION = 'gps_time', 'classification'
SCAN_COLUMN, GRID = 'scan', ('column', 'row')  # of E57
MAX_TABLE = 1 << 20  # entries of a table of numbers, far fewer than points whose sorting takes long
GRID_SHOT_NS = 1000  # between rows of a grid: how long a shot took is not known


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
    note : str
        What is unusual about its columns; empty: nothing.
    more : columns by name
        Further requested columns.

    """

    points: Points
    lines: str = ''
    lack: str = ''
    note: str = ''
    more: Columns = field(default_factory=dict)

    def noted(self, *notes: str) -> 'Loaded':
        """Return it with further notes, those that are not empty."""
        return replace(self, note='; '.join(filter(None, (self.note, *notes))))

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
    ring = [] if mask is None else _line_columns(file, parameters, 'where there is a mask')
    if parameters.mask_shadow and (file.crs or file.grids):
        must_be = f'false for {file.path}, which does not say where its sensor was'
        raise ParameterError('mask_shadow', must_be, 'true')
    field_name = read_field(parameters)
    fields = _usual(file, (field_name,))[:1] if field_name else ()
    others = list(dict.fromkeys([*_timing(file, parameters, timed=timed), *more, *ring, *fields]))
    sizes = file.metres if metres is None else metres
    xyz, columns = _read(file, coordinates, others, sizes, allocate, progress)
    kept = {name: columns[name] for name in more}
    zeros = np.zeros(len(file), np.int64)
    points = Points(xyz, zeros, zeros, returns(xyz))
    for name in fields:
        points = replace(points, field=cloud_file.filled(columns[name]).astype(np.float64))
    if ring:
        name, _ = usual.choose(ring, usual.LINES, _fraction_in(columns, points.valid))
        name = name or ring[0]
        rings = usual.whole_numbers(columns[name], points.valid, f'column {name!r}')
        points = replace(masked(replace(points, line=rings), mask, parameters), line=zeros)
    found = Loaded(points)
    if timed:
        # A standard deviation has the unit of the coordinates beside it.
        size = sizes.get(coordinates[0], 1.0)
        found = _with_lines(file, points, columns, parameters, size)
    if found.lack:
        check_chain(parameters.chain, str(file.path), found.lack)
    if field_name and not fields:
        found = found.noted(usual.missing(field_name))
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
    for name in _usual(file, usual.INTENSITIES)[:1]:
        parts = [values for (values,) in cloud_file.read(file, [name])]
        found = replace(found, intensity=np.concatenate(parts).astype(np.float32))
    return replace(loaded, points=found)


def _timing(file: CloudFile, parameters: FilterParameters, *, timed: bool) -> list[str]:
    """List the columns that may hold time, line, standard deviation and intensity."""
    if not timed:
        return []
    times = _named(file, parameters.time_field, 'time_field', usual.TIMES)
    others = ((parameters.angle_field, 'angle_field'), (parameters.sigma_field, 'sigma_field'))
    return [
        *times,
        *_named(file, parameters.line_field, 'line_field', usual.LINES),
        *(_named(file, name, parameter)[0] for name, parameter in others if name),
        *(name for name in LAS_COLUMNS if times and name in file.columns),
        *(name for name in (SCAN_COLUMN, *GRID) if not times and name in file.columns),
        *(_usual(file, usual.INTENSITIES)[:1] if reads(parameters, 'intensity') else ()),
    ]


def _usual(file: CloudFile, names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the columns of numbers that have one of these names, the best first."""
    numbers = tuple(name for name, kind in file.columns.items() if kind.kind in 'iuf')
    return usual.candidates(numbers, names)


def _named(
    file: CloudFile, name: str, parameter: str, names: tuple[str, ...] = ()
) -> tuple[str, ...]:
    """Return the column that a parameter names; under 'auto' those of usual names."""
    if name == 'auto':
        return _usual(file, names)
    if name not in file.columns:
        must_be = f'a column of {file.path}: {", ".join(file.columns) or "none"}'
        raise CloudError(parameter, must_be, repr(name))
    return (name,)


def _line_columns(file: CloudFile, parameters: FilterParameters, where: str = '') -> list[str]:
    """Name the columns that may hold the line of each point; refuse a file without one."""
    names = _named(file, parameters.line_field, 'line_field', usual.LINES)
    if not names:
        must_be = f'{usual.such_as(usual.LINES)}, or line_field given'
        must_be += f', {where}' if where else ''
        raise CloudError('the line column', must_be, f'the columns {", ".join(file.columns)}')
    return list(names)


def _fraction_in(columns: Columns, valid: Bools) -> Callable[[str], str]:
    """Return what objects to a column as the number of lines."""
    return lambda name: usual.not_whole(np.ma.getdata(columns[name]), valid)


def _with_lines(
    file: CloudFile, points: Points, columns: Columns, parameters: FilterParameters, size: float
) -> Loaded:
    """Add time, line and what is known of each point (``size`` metres per unit of sigma)."""
    t, time, notes = _times(file, points.valid, columns, parameters)
    if t is None and along_lines(parameters.chain) and (grid := _grid(file, columns)):
        # Trees on a scan pattern are for scanners that move: a grid serves methods along lines.
        number, row = grid
        t = (number * (int(row.max(initial=0)) + 1) + row) * GRID_SHOT_NS
        timed = replace(points, t=t, line=number)
        return Loaded(timed, 'columns of the grid', note='; '.join(notes))
    if t is None:
        return Loaded(points, lack='no column with the time of each point', note='; '.join(notes))
    line, found_by, more = _lines(file, points.valid, t, columns, parameters)
    timed = replace(points, t=t)
    if line is None and parameters.line_source == 'auto':
        timed, found_by = _recover_lines(timed, columns, parameters)
        line = timed.line if found_by else None
    elif line is not None and found_by in columns and found_by not in LAS_COLUMNS:
        claim = Claim('field', f'column {found_by!r}')
        timed, decision = settle_lines(replace(timed, line=line), claim, line_period(parameters))
        line = timed.line
        more += [decision.text] * decision.contradicts
    note = '; '.join(notes + more)
    if line is None:
        return Loaded(points, lack='no column that says its scan lines', note=note)
    sigma = intensity = None
    if name := parameters.sigma_field:
        sigma = cloud_file.filled(columns[name]).astype(np.float64) * size
        check_sigma(sigma, points.valid, f'column {name!r}')
    for name in _usual(file, usual.INTENSITIES)[:1] if reads(parameters, 'intensity') else ():
        intensity = cloud_file.filled(columns[name]).astype(np.float32)
    timed = replace(points, t=t, line=line, sigma=sigma, intensity=intensity, head=None)
    return Loaded(timed, f'{time} and {found_by}', note=note)


def _grid(file: CloudFile, columns: Columns) -> tuple[Ints, Ints] | None:
    """Return the line and the row (N,) of each point of scans that are grids; else None.

    A line is a column of a scan: scanners on tripods turn slowly, and measure column by column.
    """
    if all(name in columns for name in GRID):
        scan, column, row = (
            cloud_file.filled(columns[name]).astype(np.int64) for name in (SCAN_COLUMN, *GRID)
        )
        return number_rows([scan, column]), row - row.min(initial=0)
    if not file.grids:
        return None
    rows = np.concatenate([np.tile(np.arange(high), wide) for wide, high in file.grids])
    highs = np.concatenate([np.full(wide, high) for wide, high in file.grids])
    return np.repeat(np.arange(len(highs)), highs), rows


def _recover_lines(
    points: Points, columns: Columns, parameters: FilterParameters
) -> tuple[Points, str]:
    """Find the turns of the mirror where no column shows them; return what they are found by."""
    filled = {name: cloud_file.filled(columns[name]) for name in SCANNERS if name in columns}
    known = [filled[name] for name in SOURCES if name in filled]
    claim, period = Claim('message', 'the file'), line_period(parameters)
    tried = [known]
    if USER_DATA in filled and 1 < len(np.unique(filled[USER_DATA])) <= MAX_HEADS:
        tried.append([*known, filled[USER_DATA]])
    for sources in tried:
        head = number_rows(sources) if sources else None
        settled, decision = settle_lines(replace(points, head=head), claim, period)
        if decision.kind in {'turns', 'heads'}:
            return settled, decision.text.removeprefix('scan lines: ')
    return points, ''


def number_rows(columns: Sequence[NDArray[Any]]) -> Ints:
    """Return the numbers of the different rows of columns (N,) in ascending order, (N,)."""
    row = np.zeros(len(columns[0]), np.int64)
    for column in columns:
        number = _number_values(column)
        row = _number_values(row * (number.max(initial=0) + 1) + number)
    return row


def _number_values(values: NDArray[Any]) -> Ints:
    """Return the numbers of different values (N,), by a table if their range is small."""
    low, high = (values.min(), values.max()) if len(values) else (0, 0)
    if values.dtype.kind not in 'iu' or int(high) - int(low) > MAX_TABLE:
        return np.unique(values, return_inverse=True)[1].astype(np.int64)
    place = values.astype(np.int64) - int(low)
    return (np.cumsum(np.bincount(place) > 0) - 1)[place]


def _times(
    file: CloudFile, valid: Bools, columns: Columns, parameters: FilterParameters
) -> tuple[Ints | None, str, list[str]]:
    """Return the time of each point, nanoseconds, its column and unit, and notes on columns."""
    names = _named(file, parameters.time_field, 'time_field', usual.TIMES)
    name, notes = names[0] if names else '', list[str]()
    if parameters.time_field == 'auto':
        name, notes = usual.choose(
            names,
            usual.TIMES,
            lambda one: usual.too_coarse_times(np.ma.getdata(columns[one]), valid),
        )
    if not name:
        return None, '', notes
    if (valid & np.ma.getmaskarray(columns[name])).any():
        raise CloudError('the time of a point', 'finite and within 73 years', np.nan)
    values, unit = usual.unwrapped(np.ma.getdata(columns[name]), valid), parameters.time_unit
    if unit == 'auto' and file.classes and name == GPS_TIME:
        unit = 's'  # by the standard, however few points are left
    if unit == 'auto':
        # A text table has no integer type.
        said = file.columns[name]
        kind = said if said.kind == 'f' else values.dtype
        unit, note, _ = usual.find_unit(values[valid], kind, name)
        notes += [note] * bool(note)
    return usual.to_nanoseconds(values, valid, unit), f'{name} ({unit})', notes


def _lines(
    file: CloudFile, valid: Bools, t: Ints, columns: Columns, parameters: FilterParameters
) -> tuple[Ints | None, str, list[str]]:
    """Find the scan lines as ``line_source`` says; return their column, too, and notes on it."""
    source = parameters.line_source
    if source not in {'auto', 'field', 'angle'}:
        raise CloudError('line_source', "'auto', 'field' or 'angle' for a file", repr(source))
    names = _named(file, parameters.line_field, 'line_field', usual.LINES)
    name, notes = names[0] if names else '', list[str]()
    if parameters.line_field == 'auto' and source != 'angle':
        name, notes = usual.choose(names, usual.LINES, _fraction_in(columns, valid))
    if source == 'field' or (name and source != 'angle'):
        name = name or _line_columns(file, parameters)[0]
        return usual.whole_numbers(columns[name], valid, f'column {name!r}'), name, notes
    angle = parameters.angle_field
    if source == 'angle' and not angle:
        angle = next((name for name in ANGLE_FIELDS if name in columns), '')
        if not angle:
            must_be = f'one of {", ".join(ANGLE_FIELDS)}, or angle_field given'
            raise CloudError('the angle column', must_be, f'the columns {", ".join(file.columns)}')
    plain = {name: cloud_file.filled(values) for name, values in columns.items()}
    return *find_lines(t, plain, angle), notes
