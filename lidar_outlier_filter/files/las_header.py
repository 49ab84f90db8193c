# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Header and records of LAS and LAZ, checked before laspy reads them, and the coordinate system.

laspy believes a header: it reads as many records as that counts, also behind the end of the file.
PROJ reads the coordinate system from GeoTIFF keys or from WKT. A file that names no unit is in
metres.
"""

import math
import struct
from collections.abc import Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import BinaryIO

import numpy as np
from laspy import VLR
from numpy.typing import NDArray
from pyproj import CRS
from pyproj.database import get_units_map
from pyproj.exceptions import CRSError

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.cloud_file import check_fits, check_offset, check_points

MAX_HEADER_BYTES = 375  # bytes of a header that are read
MIN_HEADER_BYTES = 227  # bytes of a header of LAS 1.0 to 1.2
_BOX = 179  # offset, bytes: greatest x, least x, greatest y, least y
_VLR = struct.Struct('<H16sHH32s')
HEAD_BYTES = _VLR.size  # of a record before the points
_EVLR = struct.Struct('<H16sHQ32s')
_MAX_UNITS = 2**31  # units that a coordinate may have

USER = 'LASF_Projection'
KEYS, WKT = 34735, 2112  # numbers of records
MODEL, ANGLES = 1024, 2  # key: the kind of the coordinates, and its value for degrees
PLANE, UP = 3072, 4096  # keys: EPSG numbers of the system of x and y, and of that of z
HORIZONTAL, VERTICAL = 3076, 4099  # keys: unit of x and y, unit of z
OWN = 32767  # user-defined, not a number of EPSG

Units = tuple[float | None, float | None]  # metres per unit of the plane, and of heights


class LasRecord(VLR):  # type: ignore[misc]  # laspy has no types
    """A (extended) variable length record, whose head stays as it is in the file."""

    head = b''
    at = 0  # where its data begin in the file, bytes


def read_records(path: Path) -> tuple[list[LasRecord], list[LasRecord]]:
    """List the records before and behind the points; refuse records that exceed the file."""
    size = path.stat().st_size
    with path.open('rb') as stream:
        header = stream.read(MAX_HEADER_BYTES)
        if header[:4] != b'LASF':
            return [], []  # laspy refuses it
        if len(header) < MIN_HEADER_BYTES:
            raise CloudError(
                f'the header of {path}', f'of at least {MIN_HEADER_BYTES} bytes', len(header)
            )
        begin, points = number(header, 94, 2), number(header, 96, 4)
        check_offset(path, 'the end of the header', begin, MIN_HEADER_BYTES, size)
        check_offset(path, 'the first point', points, begin, size)
        records = _chain(stream, path, _VLR, (begin, points), number(header, 100, 4))
        if not (count := _evlr_count(header)):
            return records, []
        begin = number(header, 235, 8)
        check_offset(path, 'the first extended record', begin, points, size)
        return records, _chain(stream, path, _EVLR, (begin, size), count)


def read_box(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return the least and the greatest x and y that the header says; None: it is no header."""
    with path.open('rb') as stream:
        header = stream.read(MIN_HEADER_BYTES)
    if len(header) < MIN_HEADER_BYTES or header[:4] != b'LASF':
        return None
    high_x, low_x, high_y, low_y = struct.unpack_from('<4d', header, _BOX)
    return np.array([low_x, low_y]), np.array([high_x, high_y])


def _chain(
    stream: BinaryIO, path: Path, layout: struct.Struct, offsets: tuple[int, int], count: int
) -> list[LasRecord]:
    """List records; refuse them if they do not all lie between two offsets (bytes)."""
    offset, end = offsets
    check_fits(path, 'the number of records', count, layout.size, end - offset)
    records = []
    for _ in range(count):
        check_offset(path, 'a record', offset, 0, end - layout.size)
        stream.seek(offset)
        head = stream.read(layout.size)
        _, user, name, length, _ = layout.unpack(head)
        offset += layout.size
        check_fits(path, 'the bytes in a record', length, 1, end - offset)
        text = user.split(b'\0')[0].decode('ascii', 'ignore')
        records.append(LasRecord(text, name, '', stream.read(length)))
        records[-1].head, records[-1].at = head, offset
        offset += length
    return records


def _evlr_count(header: bytes) -> int:
    """Return the number of extended records, which LAS has from 1.4 on."""
    return number(header, 243, 4) if header[25] >= 4 else 0  # noqa: PLR2004  minor version


def check_scaling(path: Path, scales: Iterable[float], offsets: Iterable[float]) -> None:
    """Refuse scales and offsets that give infinite or all equal coordinates.

    For laspy a NaN scale is always new: it would write other integers.
    """
    for axis, *pair in zip('xyz', scales, offsets, strict=True):
        scale, offset = map(float, pair)
        what = f'scale and offset of {axis} in {path}'
        if not math.isfinite(abs(scale) * _MAX_UNITS + abs(offset)):
            raise CloudError(what, 'such that all coordinates are finite', f'{scale} and {offset}')
        if scale == 0:
            raise CloudError(what, 'such that coordinates differ', f'{scale} and {offset}')


def check_las_points(path: Path, count: int) -> None:
    """Refuse a count of uncompressed points that is not that of the points in the file."""
    with path.open('rb') as stream:
        header = stream.read(MAX_HEADER_BYTES)
    end = number(header, 235, 8) if _evlr_count(header) else path.stat().st_size
    check_points(path, count, number(header, 105, 2), number(header, 96, 4), end)


def number(data: bytes, offset: int, size: int) -> int:
    """Read an unsigned number of a header."""
    return int.from_bytes(data[offset : offset + size], 'little')


def metres_per_unit(records: Mapping[int, bytes], path: Path, *, wkt: bool) -> dict[str, float]:
    """Return metres per unit of x, y and z, where that is not 1.

    Parameters
    ----------
    records : content of the records of ``USER``, by their numbers
    path : of the file, for a refusal
    wkt : whether, by the header, WKT has precedence over the keys; if the first is missing or names
        no unit, the other is used

    """
    readers = (_of_wkt, _of_keys) if wkt else (_of_keys, _of_wkt)
    found = (reader(records, path) for reader in readers)
    plane, up = next((units for units in found if units != (None, None)), (None, None))
    # Heights without a unit of their own have that of the plane.
    sizes = {'x': plane, 'y': plane, 'z': plane if up is None else up}
    return {axis: size for axis, size in sizes.items() if size is not None and size != 1.0}


def name_and_wkt(records: Mapping[int, bytes], path: Path) -> tuple[str, str]:
    """Return name and WKT 1 of the coordinate system; empty if PROJ knows none of that name."""
    text, code = _wkt_text(records), _keys(records).get(PLANE, OWN)
    if not text and code == OWN:
        return '', ''
    try:
        system = _system(text or f'EPSG:{code}', path)
    except CloudError:
        return '', ''
    name = system.name if text else f'EPSG:{code} {system.name}'
    try:
        return name, system.to_wkt('WKT1_GDAL')
    except CRSError:  # of a kind that WKT 1 does not have
        return name, system.to_wkt()


def _keys(records: Mapping[int, bytes]) -> dict[int, int]:
    """Read the GeoTIFF keys with an inline value."""
    data = records.get(KEYS, b'')
    rows = [struct.unpack_from('<4H', data, at) for at in range(8, len(data) - 7, 8)]
    return {key: value for key, place, _, value in rows if place == 0}


def _of_keys(records: Mapping[int, bytes], path: Path) -> Units:
    codes = _keys(records)

    def unit(key: int) -> float | None:
        if key in codes and codes[key] not in _metres_by_code():
            must_be = 'a length that EPSG knows, or clean --unit given'
            raise CloudError(f'the unit of {path}, key {key}', must_be, codes[key])
        return _metres_by_code().get(codes.get(key, 0))

    plane, up = unit(HORIZONTAL), unit(VERTICAL)
    if plane is None and codes.get(PLANE, OWN) != OWN:
        plane, _ = _of_system(_system(f'EPSG:{codes[PLANE]}', path), path)
    if plane is None and codes.get(MODEL) == ANGLES:
        raise _no_lengths(path)
    if up is None and codes.get(UP, OWN) != OWN:
        try:  # GeoTIFF has numbers of its own for heights, without units
            system = CRS.from_epsg(codes[UP])
        except CRSError:
            return plane, None
        up = _of_system(system, path)[1] if system.is_vertical else None
    return plane, up


def _of_wkt(records: Mapping[int, bytes], path: Path) -> Units:
    text = _wkt_text(records)
    return _of_system(_system(text, path), path) if text else (None, None)


def _wkt_text(records: Mapping[int, bytes]) -> str:
    return records.get(WKT, b'').split(b'\0')[0].decode('utf-8', 'replace').strip()


def _system(text: str, path: Path) -> CRS:
    try:
        return CRS.from_user_input(text)
    except CRSError as err:
        must_be = 'one that PROJ knows, or clean --unit given'
        raise CloudError(f'the coordinate system of {path}', must_be, repr(text[:100])) from err


def _of_system(system: CRS, path: Path) -> Units:
    """Return metres per unit of the plane, and of heights; None: it has no such axis."""
    if system.is_geographic:
        raise _no_lengths(path)
    upright = {'up', 'down'}
    plane = [one.unit_conversion_factor for one in system.axis_info if one.direction not in upright]
    up = [one.unit_conversion_factor for one in system.axis_info if one.direction in upright]
    return (plane[0] if plane else None), (up[0] if up else None)


def _no_lengths(path: Path) -> CloudError:
    return CloudError(f'the coordinates of {path}', 'lengths, or clean --unit given', 'degrees')


@lru_cache
def _metres_by_code() -> Mapping[int, float]:
    """Return metres per unit of length that EPSG knows, by its number."""
    units = get_units_map(auth_name='EPSG', category='linear').values()
    return {int(unit.code): unit.conv_factor for unit in units}
