# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The unit of the coordinates of a LAS file: PROJ reads it from its GeoTIFF keys, or its WKT.

Parameters are in metres. A file in feet is judged in metres, its numbers times 0.3048; what is
written keeps its numbers. A file that says nothing of its unit is in metres.
"""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import TYPE_CHECKING

from pyproj import CRS
from pyproj.database import get_units_map
from pyproj.exceptions import CRSError

from lidar_outlier_filter.errors import CloudError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

USER = 'LASF_Projection'
KEYS, DOUBLES, WKT = 34735, 34736, 2112  # numbers of records
MODEL, ANGLES = 1024, 2  # key: the kind of the coordinates, and its value for degrees
PLANE, UP = 3072, 4096  # keys: EPSG numbers of the system of x and y, and of that of z
HORIZONTAL, SIZE, VERTICAL = 3076, 3077, 4099  # keys: unit of x and y, its own size, unit of z
OWN = 32767  # no number of EPSG: what it is follows in other keys


def metres_per_unit(records: Mapping[int, bytes], path: Path, *, wkt: bool) -> dict[str, float]:
    """Say how many metres one of x, y and z is, where it is not one.

    Parameters
    ----------
    records : bytes of the (extended) variable length records of ``USER``, by their numbers
    path : of the file, for a refusal
    wkt : whether the header says that WKT counts, and not the keys; where the one that counts is
        missing or says no unit, it is the other

    Raises
    ------
    CloudError
        If the coordinates are degrees, or of a system or a unit that is not known.

    """
    readers = (_of_wkt, _of_keys) if wkt else (_of_keys, _of_wkt)
    said = (reader(records, path) for reader in readers)
    plane, up = next((units for units in said if units != (None, None)), (None, None))
    # Heights without a unit of their own have that of the plane.
    up = plane if up is None else up
    found = {'x': plane, 'y': plane, 'z': up}
    return {axis: size for axis, size in found.items() if size is not None and size != 1.0}


def _of_keys(records: Mapping[int, bytes], path: Path) -> tuple[float | None, float | None]:
    data, doubles = records.get(KEYS, b''), records.get(DOUBLES, b'')
    numbers = struct.unpack(f'<{len(data) // 2}H', data[: len(data) // 2 * 2])
    rows = [numbers[i : i + 4] for i in range(4, len(numbers) - 3, 4)]
    keys = {row[0]: row for row in rows}
    codes = {key: row[3] for key, row in keys.items() if row[1] == 0}  # other values lie elsewhere
    sizes = struct.unpack(f'<{len(doubles) // 8}d', doubles[: len(doubles) // 8 * 8])

    def unit(key: int) -> float | None:
        if key not in codes:
            return None
        own = keys.get(SIZE)
        if codes[key] == OWN and own is not None and own[1] == DOUBLES and own[3] < len(sizes):
            return float(sizes[own[3]])
        if codes[key] not in _metres_by_code():
            must_be = 'a length that EPSG knows, or clean --unit given'
            raise CloudError(f'the unit of {path}, key {key}', must_be, codes[key])
        return _metres_by_code()[codes[key]]

    plane, up = unit(HORIZONTAL), unit(VERTICAL)
    if plane is None and codes.get(PLANE, OWN) != OWN:
        plane, _ = _of_system(_system(f'EPSG:{codes[PLANE]}', path), path)
    if plane is None and codes.get(MODEL) == ANGLES:
        raise _no_lengths(path)
    if up is None and codes.get(UP, OWN) != OWN:
        up = _of_height(codes[UP], path)
    return plane, up


def _of_height(code: int, path: Path) -> float | None:
    """Return the unit of a system of heights; GeoTIFF has numbers of its own, without units."""
    try:
        system = CRS.from_epsg(code)
    except CRSError:
        return None
    return _of_system(system, path)[1] if system.is_vertical else None


def _of_wkt(records: Mapping[int, bytes], path: Path) -> tuple[float | None, float | None]:
    text = records.get(WKT, b'').split(b'\0')[0].decode('utf-8', 'replace')
    return _of_system(_system(text, path), path) if text.strip() else (None, None)


def _system(text: str, path: Path) -> CRS:
    try:
        return CRS.from_user_input(text)
    except CRSError as err:
        must_be = 'one that PROJ knows, or clean --unit given'
        raise CloudError(f'the coordinate system of {path}', must_be, repr(text[:100])) from err


def _of_system(system: CRS, path: Path) -> tuple[float | None, float | None]:
    """Return the metres of a unit of the plane, and of the heights; None: it has no such axis."""
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
    """Return the metres of each unit of length that EPSG knows, by its number."""
    units = get_units_map(auth_name='EPSG', category='linear').values()
    return {int(unit.code): unit.conv_factor for unit in units}
