# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The unit of the coordinates of a LAS file: of its GeoTIFF keys, or of its WKT.

Parameters are in metres. A file in feet is judged in metres, its numbers times 0.3048; what is
written keeps its numbers. A file that says nothing of its unit is in metres.
"""

from __future__ import annotations

import re
import struct
from typing import TYPE_CHECKING

from lidar_outlier_filter.errors import CloudError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

USER = 'LASF_Projection'
KEYS, DOUBLES, WKT = 34735, 34736, 2112  # numbers of records
HORIZONTAL, SIZE, VERTICAL = 3076, 3077, 4099  # keys: unit of x and y, its own size, unit of z
OWN = 32767  # the unit is given by its size
# EPSG codes of units of length, and their metres.
METRES: Mapping[int, float] = {
    9001: 1.0,
    9002: 0.3048,
    9003: 1200 / 3937,
    9005: 0.3047972654,
    9036: 1000.0,
    9094: 0.304799710181508,
    9095: 0.3048007491,
}
_PLANE = {'PROJCS', 'PROJCRS', 'PROJECTEDCRS', 'LOCAL_CS', 'ENGCRS'}
_UP = {'VERT_CS', 'VERTCRS', 'VERTICALCRS'}
_TOKEN = re.compile(r'"[^"]*"|([A-Za-z_0-9]+)\s*[\[(]|[\])]')
_FACTOR = re.compile(r'\s*"[^"]*"\s*,\s*([0-9.eE+-]+)')


def metres_per_unit(records: Mapping[int, bytes], path: Path, *, wkt: bool) -> dict[str, float]:
    """Say how many metres one of x, y and z is, where it is not one.

    Parameters
    ----------
    records : bytes of the (extended) variable length records of ``USER``, by their numbers
    path : of the file, for a refusal
    wkt : whether the header says that WKT counts, and not the keys

    Raises
    ------
    CloudError
        If the file names a unit that is not known.

    """
    if wkt and WKT in records:
        plane, up = _of_wkt(records[WKT].decode('utf-8', 'replace'))
    elif KEYS in records:
        plane, up = _of_keys(records[KEYS], records.get(DOUBLES, b''), path)
    else:
        return {}
    # Heights without a unit of their own have that of the plane.
    up = plane if up is None else up
    found = {'x': plane, 'y': plane, 'z': up}
    return {axis: size for axis, size in found.items() if size is not None and size != 1.0}


def _of_keys(data: bytes, doubles: bytes, path: Path) -> tuple[float | None, float | None]:
    numbers = struct.unpack(f'<{len(data) // 2}H', data[: len(data) // 2 * 2])
    rows = [numbers[i : i + 4] for i in range(4, len(numbers) - 3, 4)]
    keys = {row[0]: row for row in rows}
    sizes = struct.unpack(f'<{len(doubles) // 8}d', doubles[: len(doubles) // 8 * 8])

    def unit(key: int) -> float | None:
        if key not in keys:
            return None
        code = keys[key][3]
        own = keys.get(SIZE)
        if code == OWN and own is not None and own[1] == DOUBLES and own[3] < len(sizes):
            return float(sizes[own[3]])
        if code not in METRES:
            known = ', '.join(map(str, METRES))
            raise CloudError(f'the unit of {path}, key {key}', f'one of {known}', code)
        return METRES[code]

    return unit(HORIZONTAL), unit(VERTICAL)


def _of_wkt(text: str) -> tuple[float | None, float | None]:
    """Find the units of length of the plane and of the heights; those of angles are none."""
    plane = up = None
    stack: list[str] = []
    for token in _TOKEN.finditer(text):
        if token.group()[0] in '])':
            del stack[-1:]
        elif token.group(1):
            name = token.group(1).upper()
            owners = [one for one in stack if one != 'AXIS']
            factor = _FACTOR.match(text, token.end())
            if name in {'UNIT', 'LENGTHUNIT'} and owners and factor:
                if owners[-1] in _PLANE:
                    plane = float(factor.group(1))
                elif owners[-1] in _UP:
                    up = float(factor.group(1))
            stack.append(name)
    return plane, up
