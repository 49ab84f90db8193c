# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The trajectory of the scanner of a LAS file.

SBET of Applanix is binary, in radians. Every other trajectory is a table of text in the coordinate
system of the file.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Allocate, Floats, Ints
from lidar_outlier_filter.core.points import columns as usual
from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.core.points.poses import is_covered
from lidar_outlier_filter.errors import CloudError, ParameterError, refusing
from lidar_outlier_filter.files import cloud_file
from lidar_outlier_filter.files.cloud_file import CHUNK_ROWS, CloudFile
from lidar_outlier_filter.files.points import GPS_TIME, Loaded
from lidar_outlier_filter.files.text import TextFile
from lidar_outlier_filter.parameters.filter import FilterParameters

SBET = ('.out', '.sbet')  # suffixes
# Of a record, float64: time, latitude, longitude, height, velocity, attitude, wander angle, more.
_SBET_COLUMNS, _SBET_USED = 17, (0, 1, 2, 3, 9, 10)
_STEP_RAD = 1e-6  # of latitude, 6 m: they show where north is in the system of the file
# Names of columns, without units in brackets; the last ones are those of tables without names.
_NAMES = (
    (*usual.TIMES, '1'),
    ('x', 'easting', 'east', '2'),
    ('y', 'northing', 'north', '3'),
    ('z', 'height', 'altitude', '4'),
    ('heading', 'yaw', 'azimuth', '7'),
)
_UNIT = re.compile(r' ?[\[(](.*)[\])]')
# LAS has seconds of the GPS week, or of GPS time, less 10^9.
_WEEK_NS, _ADJUSTED_NS = 604_800 * SECOND, 10**9 * SECOND
_MAX_RANGE_M = 20_000.0  # beyond, the coordinate systems differ
# Of a trajectory: times (M,), positions (M, 3) in metres and in the system of the points, headings
# (M,) in rad, clockwise from the y axis, or None, and what was assumed.
_Track = tuple[NDArray[Any], Floats, Floats | None, str]


def with_trajectory(  # noqa: PLR0913  points, and where the scanner was
    file: CloudFile,
    axes: Mapping[str, float],
    loaded: Loaded,
    path: Path,
    parameters: FilterParameters,
    allocate: Allocate = np.empty,
) -> Loaded:
    """Give points their positions as seen from the scanner at their own times; note how far it was.

    What detectors see as the sensor's own frame is level: x ahead, or as in the file where the
    trajectory has no heading, z up. Roll and pitch are not used, so that heights are those above
    or below the track.

    Parameters
    ----------
    file, axes : a LAS file; its columns x, y and z, and metres per unit of each
    loaded : its points, and ``gps_time``
    path : of the trajectory
    parameters : ``motion`` says where the scanner is on the vehicle, and which gaps are too long
    allocate : returns an array of a shape, in memory or in a file

    Raises
    ------
    FilterError
        If the trajectory cannot be read, does not reach over all points, or is elsewhere.

    """
    when, position, heading, note = _read_trajectory(path, file, [*axes.values(), 1.0][:3])
    points, gps_time = loaded.points, cloud_file.filled(loaded.more[GPS_TIME])
    motion = parameters.motion
    if heading is None and (motion.x, motion.y) != (0.0, 0.0):
        got = f'{motion.x:g} and {motion.y:g}'
        raise ParameterError('motion.x and motion.y', f'0 m, as {path} has no heading', got)
    t = usual.to_nanoseconds(gps_time, points.valid, 's')
    known = t[points.valid]
    if not len(known):
        return loaded
    when += _weeks_between(when, known)
    longest = round(motion.max_gap * SECOND)
    if missed := np.count_nonzero(points.valid & ~is_covered(t, when, longest)):
        span = f'{known.min() / SECOND:.3f} to {known.max() / SECOND:.3f} s'
        must_be = f'those of the points, {span}, without gaps over {motion.max_gap:g} s'
        got = f'{when[0] / SECOND:.3f} to {when[-1] / SECOND:.3f} s: {missed} points are outside'
        raise CloudError(f'the times of {path}', f'{must_be} (motion.max_gap)', got)
    own = _seen_from(points.xyz, t, (when, position, heading), allocate)
    own -= (motion.x, motion.y, motion.z)
    seen = replace(points, own=own)
    near, middle, far = np.percentile(seen.range[points.valid], (1, 50, 99))
    if middle > _MAX_RANGE_M:
        must_be = f'those of the points, and within {_MAX_RANGE_M:g} m of them'
        raise CloudError(f'the coordinates of {path}', must_be, f'{middle:g} m away')
    said = f'seen from {path.name}, {middle:.1f} m away, mostly {near:.1f} to {far:.1f} m'
    return replace(loaded, points=seen).noted(said, note)


def _read_trajectory(path: Path, file: CloudFile, units: list[float]) -> _Track:
    """Read a trajectory, its times in ns; ``units``: metres per unit of x, y and z of a table."""
    with cloud_file.readable(path):
        cloud_file.check_file(path)
        is_sbet = path.suffix.lower() in SBET
        t, xyz, heading, note = _read_sbet(path, file) if is_sbet else _read_table(path, units)
    for what, values in (('times', t), ('positions', xyz), ('headings', heading)):
        if values is not None and not np.isfinite(values).all():
            raise CloudError(f'the {what} of {path}', 'finite', 'NaN or Inf')
    ns = usual.to_nanoseconds(t, np.ones(len(t), np.bool_), 's')
    if len(ns) < 2 or not (np.diff(ns) > 0).all():  # noqa: PLR2004  between two
        raise CloudError(f'the times of {path}', 'two or more, ascending', 'others')
    return ns, xyz, None if heading is None else np.unwrap(heading), note


def _read_sbet(path: Path, file: CloudFile) -> _Track:
    """Read an SBET, its times in s; its positions are of the datum of the file."""
    # It needs PROJ, which is no part of every installation.
    from pyproj import CRS, Transformer  # noqa: PLC0415
    from pyproj.exceptions import ProjError  # noqa: PLC0415

    size = path.stat().st_size
    if size == 0 or size % (8 * _SBET_COLUMNS):
        must_be = f'of whole records of {8 * _SBET_COLUMNS} bytes (SBET)'
        raise CloudError(f'the trajectory {path}', must_be, f'{size} bytes')
    system = CRS.from_user_input(file.wkt) if file.wkt else None
    datum = None if system is None else system.geodetic_crs
    if system is None or datum is None:
        must_be = f'in the file, and on the Earth, for {path} in degrees'
        raise CloudError(f'the coordinate system of {file.path}', must_be, file.crs or 'none')
    records = np.fromfile(path, '<f8').reshape(-1, _SBET_COLUMNS)
    t, latitude, longitude, height, heading, wander = records[:, _SBET_USED].T
    units = [file.metres.get(axis, 1.0) for axis in 'xyz']
    if is_flat := len(system.axis_info) == 2:  # noqa: PLR2004  heights stay as they are
        units[2] = 1.0
    with refusing(CloudError, f'the positions of {path}', f'projected to {file.crs}', ProjError):
        # Without the grid of a geoid, heights would be wrong.
        project = Transformer.from_crs(
            datum.to_3d(),
            system,
            always_xy=True,
            only_best=True,
            allow_ballpark=False,
        )

        def place(latitude: Floats) -> Floats:
            found = project.transform(longitude, latitude, height, radians=True, errcheck=True)
            return np.stack(found, axis=1) * units

        xyz = place(latitude)
        east, north, _ = (place(latitude + _STEP_RAD) - xyz).T
    note = f'its heights are taken for ellipsoidal, as {file.crs} has none' if is_flat else ''
    return t, xyz, heading - wander + np.arctan2(east, north), note


def _read_table(path: Path, units: list[float]) -> _Track:
    """Read a table, with or without names on top; its times in s."""
    table = TextFile(path)
    plain = {_UNIT.sub('', name): name for name in table.columns}
    found = (next(iter(usual.candidates(tuple(plain), names)), '') for names in _NAMES)
    names = [plain.get(name, '') for name in found]
    if not all(names[:4]):
        must_be = 'time, x, y and z, or easting, northing and height'
        raise CloudError(f'the columns of {path}', must_be, ', '.join(table.columns) or 'none')
    chunks = cloud_file.read(table, [name for name in names if name])
    t, *rest = (np.concatenate(parts).astype(np.float64) for parts in zip(*chunks, strict=True))
    t = t * (usual.NANOSECONDS[usual.unit_of(names[0]) or 's'] / SECOND)
    is_radians = names[4].lower().endswith(('[rad]', '(rad)'))
    heading = (rest[3] if is_radians else np.radians(rest[3])) if names[4] else None
    return t, np.stack(rest[:3], axis=1) * units, heading, ''


def _weeks_between(t: Ints, known: Ints) -> int:
    """Return how far a trajectory is behind points, ns, if one of the two has seconds of a week."""
    weekly = [bool(some.max() < 2 * _WEEK_NS) for some in (t, known)]
    origin = (weekly[1] - weekly[0]) * _ADJUSTED_NS
    behind = int(known.min()) - int(t[0]) - origin
    return origin + behind // _WEEK_NS * _WEEK_NS if origin else 0


def _seen_from(
    xyz: Floats, t: Ints, track: tuple[Ints, Floats, Floats | None], allocate: Allocate
) -> Floats:
    """Return N positions at their times (N,) ahead, to the left, and above; or east and north."""
    own: Floats = allocate(xyz.shape)
    when, position, heading = track
    for begin in range(0, len(own), CHUNK_ROWS):
        part = slice(begin, begin + CHUNK_ROWS)
        east, north, up = xyz[part].T - [np.interp(t[part], when, axis) for axis in position.T]
        if heading is not None:
            turn = np.interp(t[part], when, heading)
            sine, cosine = np.sin(turn), np.cos(turn)
            east, north = sine * east + cosine * north, sine * north - cosine * east
        own[part] = np.stack([east, north, up], axis=1)
    return own
