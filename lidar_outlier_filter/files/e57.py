# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""E57 files of scanners on tripods, through libE57 (pye57): read only, copied as PLY.

A copy that libE57 writes has other bytes for every point, and its Python side knows neither
pictures nor extensions. So nothing is written as E57 that looks like the file and is not.
"""

import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pye57 import libe57

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.points.poses import SensorExtrinsics
from lidar_outlier_filter.errors import CloudError, PoseError
from lidar_outlier_filter.files.cloud_file import (
    CHUNK_ROWS,
    Change,
    CloudFile,
    check_count,
    check_fits,
)
from lidar_outlier_filter.files.ply import header_of
from lidar_outlier_filter.files.rows import BinaryRows, to_common_frame

_CARTESIAN = ('cartesianX', 'cartesianY', 'cartesianZ')
_ANGLES = ('sphericalRange', 'sphericalAzimuth', 'sphericalElevation')
_NAMES = {
    'intensity': 'intensity',
    'colorRed': 'red',
    'colorGreen': 'green',
    'colorBlue': 'blue',
    'rowIndex': 'row',
    'columnIndex': 'column',
}
_SCAN = 'scan'
_FLOAT = np.dtype(np.float64)
_WHOLE = np.dtype(np.longlong)  # pye57 confuses int64, another name of the same type, with int32
_NARROWEST = tuple(map(np.dtype, ('u1', 'u2', 'i4')))
_PAGE_BYTES, _SUM_BYTES = 1024, 4  # of a page, and of the checksum at its end
_XML_AT = struct.Struct('<16x 8x QQ')  # of the head: offset in the file, and length without sums
# libE57 gets what these name, from any address, and unpacks entities without a limit.
_REFERENCE = re.compile(rb'<!DOCTYPE|[sS]chemaLocation')
_ENCODING = re.compile(rb'<\?xml[^>]*\sencoding\s*=\s*["\']([^"\']*)')
_BITS = 8  # of a byte; a point is packed into one bit at least


@dataclass(frozen=True)
class _PosedScan:
    """One scan: its number, its count of points, its fields and their types, and its pose."""

    number: int
    count: int
    fields: Mapping[str, np.dtype[Any]]
    pose: Floats  # (3, 4), rotation and position


class E57File(CloudFile):
    """An E57 file; see :class:`CloudFile`. Points of all scans are in their common frame."""

    def __init__(self, path: Path) -> None:
        """Read the description of each scan; nothing is allocated by it."""
        self.path = path
        _check_xml(path)
        with _opened(path) as data:
            self._scans = [_scan(path, data[i], i) for i in range(len(data))]
        self._count = sum(scan.count for scan in self._scans)
        self.columns: Mapping[str, np.dtype[Any]] = dict.fromkeys('xyz', _FLOAT)
        for field, name in _NAMES.items():
            if self._scans and all(field in scan.fields for scan in self._scans):
                kinds = (scan.fields[field] for scan in self._scans)
                self.columns[name] = reduce(np.promote_types, kinds)
        self.columns[_SCAN] = np.dtype(np.int32)

    def read(self, names: Sequence[str]) -> Iterator[tuple[NDArray[Any], ...]]:
        """Read columns chunk by chunk; x, y and z of a missing return are NaN."""
        fields = [field for field, name in _NAMES.items() if name in names]
        placed = bool({*'xyz'} & {*names})
        with _opened(self.path) as data:
            for scan in self._scans:
                axes = _CARTESIAN if {*_CARTESIAN} <= {*scan.fields} else _ANGLES
                invalid = f'{"cartesian" if axes is _CARTESIAN else "spherical"}InvalidState'
                asked = [*axes * placed, *fields]
                asked += [invalid] * (placed and invalid in scan.fields)
                for chunk in self._chunks(data[scan.number], scan, asked or list(axes)):
                    values = {_NAMES.get(field, field): chunk[field] for field in chunk}
                    if placed:
                        values |= zip('xyz', _placed(scan, chunk, axes, invalid), strict=True)
                    size = len(next(iter(chunk.values())))
                    values[_SCAN] = np.full(size, scan.number, np.int32)
                    yield tuple(values[name].astype(self.columns[name]) for name in names)

    def _chunks(
        self, node: Any, scan: _PosedScan, fields: Sequence[str]
    ) -> Iterator[dict[str, NDArray[Any]]]:
        size = min(CHUNK_ROWS, scan.count)
        columns = {
            field: np.empty(size, _FLOAT if scan.fields[field].kind == 'f' else _WHOLE)
            for field in fields
        }
        buffers = libe57.VectorSourceDestBuffer()
        for field, column in columns.items():
            converted_and_scaled = (True, True)
            buffers.append(
                libe57.SourceDestBuffer(
                    node.destImageFile(), field, column, size, *converted_and_scaled
                )
            )
        found, reader = 0, node['points'].reader(buffers)
        try:
            while found < scan.count and (count := reader.read()):
                found += count
                yield {field: column[:count].copy() for field, column in columns.items()}
        finally:
            reader.close()
        check_count(self.path, scan.count, found)

    def copy(self, path: Path, change: Change) -> Iterator[int]:
        """Write the points into a binary PLY file, with all columns that are read."""
        names = list(self.columns)
        dtype = np.dtype([(name, kind.newbyteorder('<')) for name, kind in self.columns.items()])
        added = {name: values.dtype for name, values in change.added.items()}
        kinds = {**self.columns, **added}
        done = 0
        with path.open('wb') as stream:
            stream.write(header_of(change.count(len(self)), kinds))
            for chunk in self.read(names):
                rows = np.empty(len(chunk[0]), dtype)
                for name, values in zip(names, chunk, strict=True):
                    rows[name] = values
                part = change.part(slice(done, done + len(rows)))
                for _ in BinaryRows(rows).write(stream, part):
                    pass
                done += len(rows)
                yield done


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open a file and yield its scans; quote errors of libE57 in one line."""
    try:
        file = libe57.ImageFile(str(path), 'r')
        try:
            yield file.root()['data3D']
        finally:
            file.close()
    except libe57.E57Exception as err:  # further lines name source files of libE57
        got = f'"{str(err).strip().partition(chr(10))[0]}"'
        raise CloudError(f'the file {path}', 'readable', got) from err


def _check_xml(path: Path) -> None:
    """Refuse XML that refers to other files or has entities, and XML in which it cannot be seen."""
    with path.open('rb') as stream:
        head = stream.read(_XML_AT.size)
        if len(head) < _XML_AT.size:
            return  # libE57 refuses it
        begin, size = _XML_AT.unpack(head)
        stream.seek(begin // _PAGE_BYTES * _PAGE_BYTES)
        data = stream.read(min(2 * size + 2 * _PAGE_BYTES, path.stat().st_size))
    whole = _PAGE_BYTES - _SUM_BYTES
    plain = b''.join(data[at : at + whole] for at in range(0, len(data), _PAGE_BYTES))
    xml = plain[begin % _PAGE_BYTES :][:size]
    what = f'the XML of {path}'
    if found := _REFERENCE.search(xml):
        raise CloudError(what, 'without references to other files', repr(found[0].decode()))
    said = _ENCODING.match(xml.removeprefix(b'\xef\xbb\xbf'))
    if said and said[1].lower() != b'utf-8':
        raise CloudError(what, 'in UTF-8', repr(said[1].decode('latin-1')))
    if b'\0' in xml:
        raise CloudError(what, 'in UTF-8', 'zeros')


def _scan(path: Path, node: Any, number: int) -> _PosedScan:
    what = f'scan {number + 1}'
    prototype = libe57.StructureNode(node['points'].prototype())
    nodes = [prototype.get(i) for i in range(prototype.childCount())]
    fields = {one.elementName(): _kind(one) for one in nodes}
    if not any({*axes} <= {*fields} for axes in (_CARTESIAN, _ANGLES)):
        must_be = f'with {", ".join(_CARTESIAN)} or {", ".join(_ANGLES)}'
        raise CloudError(f'{what} of {path}', must_be, ', '.join(fields) or 'none')
    count = node['points'].childCount()
    check_fits(path, f'the points of {what}', count, 1, _BITS * path.stat().st_size)
    return _PosedScan(number, count, fields, _pose(node, f'the pose of {what} of {path}'))


def _pose(node: Any, what: str) -> Floats:
    """Return the rotation and the position of a scan, (3, 4)."""
    numbers = {'translation': [0.0] * 3, 'rotation': [0.0, 0.0, 0.0, 1.0]}
    for part, axes in (('translation', 'xyz'), ('rotation', 'xyzw')):
        if node.isDefined('pose') and node['pose'].isDefined(part):
            numbers[part] = [float(node['pose'][part][axis].value()) for axis in axes]
    try:
        pose = SensorExtrinsics.of_pose((*numbers['translation'], *numbers['rotation']))
    except PoseError as err:
        raise CloudError(what, 'a unit quaternion and a place', f'"{err}"') from err
    return np.column_stack((pose.matrix, pose.position))


def _kind(node: Any) -> np.dtype[Any]:
    """Return the narrowest type of PLY that a field fits into."""
    if not isinstance(node, libe57.IntegerNode):
        return _FLOAT
    for kind in _NARROWEST:
        if np.iinfo(kind).min <= node.minimum() and node.maximum() <= np.iinfo(kind).max:
            return kind
    return _FLOAT


def _placed(
    scan: _PosedScan, chunk: Mapping[str, NDArray[Any]], axes: Sequence[str], invalid: str
) -> Iterator[Floats]:
    """Return x, y and z in the common frame; NaN where there is no return."""
    x, y, z = (chunk[place] for place in axes)
    if axes is _ANGLES:
        reach, azimuth, elevation = x, y, z
        level = reach * np.cos(elevation)
        x, y = level * np.cos(azimuth), level * np.sin(azimuth)
        z = reach * np.sin(elevation)
    no_return = chunk[invalid] != 0 if invalid in chunk else np.zeros(len(x), np.bool_)
    return to_common_frame((x, y, z), scan.pose, no_return)
