# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""LAS and LAZ files, through laspy and lazrs.

laspy writes some of the header and of the records before the points (VLRs) in its own words: texts
without what follows their first zero, legacy counts 0, keys of GeoTIFF anew. What it reads of them
is replaced here by the bytes that they were.
"""

from __future__ import annotations

import logging
import struct
from copy import deepcopy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, BinaryIO

import laspy
import numpy as np
from laspy import DecompressionSelection as Parts
from laspy.vlrs.vlrlist import VLRList

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.cleaning.units import USER, metres_per_unit
from lidar_outlier_filter.files.cloud_file import CHUNK, CloudFile
from lidar_outlier_filter.files.las_header import (
    EVLR,
    LONGEST,
    VLR,
    check_las_points,
    check_laz_points,
    check_records,
    check_scaling,
)
from lidar_outlier_filter.files.laz import unpacked

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from lidar_outlier_filter.files.cloud_file import Change

NOISE, HIGH_NOISE = 7, 18  # ASPRS: low and high point, noise
EXTRA_BYTES = 4  # number of the record that describes extra dimensions
AXES = ('x', 'y', 'z')
# What is unpacked for a column of point formats 6 to 10; all of a point for any other column.
_PARTS = {
    'x': Parts.XY_RETURNS_CHANNEL,
    'y': Parts.XY_RETURNS_CHANNEL,
    'return_number': Parts.XY_RETURNS_CHANNEL,
    'scanner_channel': Parts.XY_RETURNS_CHANNEL,
    'z': Parts.Z,
    'classification': Parts.CLASSIFICATION,
    'edge_of_flight_line': Parts.FLAGS,
    'scan_direction_flag': Parts.FLAGS,
    'scan_angle': Parts.SCAN_ANGLE,
    'point_source_id': Parts.POINT_SOURCE_ID,
    'gps_time': Parts.GPS_TIME,
}
# Offsets in the header (LAS 1.4, table 3), first byte and the one behind the last.
_IDENTITY = slice(4, 94)  # file source, encoding, project, system, software, day and year
_LEGACY = slice(107, 131)  # number of points, and by return, as LAS 1.3 knew them
_BOUNDS = slice(179, 227)
_LAYOUTS = {'copc', 'laszip encoded'}  # records on how the points lie in the file

# It reports what it raises anyway.
logging.getLogger('laspy').addHandler(logging.NullHandler())


def open_file(path: Path, _table: str | None) -> LasFile:
    """Open a LAS or LAZ file."""
    return LasFile(path)


@dataclass(frozen=True)
class _Record:
    """A (extended) variable length record as the bytes that it is; laspy can write it."""

    user_id: str
    record_id: int
    head: bytes
    data: bytes

    description = ''

    @property
    def describes_dimensions(self) -> bool:
        return (self.user_id, self.record_id) == ('LASF_Spec', EXTRA_BYTES)

    def record_data_bytes(self) -> bytes:
        return self.data


class LasFile(CloudFile):
    """A LAS or LAZ file; see :class:`CloudFile`. Columns x, y and z are in the unit of the file."""

    classes = True

    def __init__(self, path: Path) -> None:
        """Read the header."""
        self.path = path
        check_records(path)
        with laspy.open(path) as reader:
            header = reader.header
        if header.global_encoding.waveform_data_packets_internal:
            must_be = 'with its waveforms in a file of their own'
            raise CloudError(f'the file {path}', must_be, 'waveforms within')
        check_scaling(path, header.scales, header.offsets)
        self._count = int(header.point_count)
        if header.are_points_compressed:
            laszip = [record.record_data_bytes() for record in header.vlrs.get('LasZipVlr')]
            check_laz_points(path, self._count, laszip)
        else:
            check_las_points(path, self._count)
        names = [
            name for name in header.point_format.dimension_names if name not in {'X', 'Y', 'Z'}
        ]
        known = [*header.vlrs, *(header.evlrs or [])]
        self._system = {
            one.record_id: one.record_data_bytes() for one in known if one.user_id == USER
        }
        self._wkt = bool(header.global_encoding.wkt)
        kinds = {item.name: item.dtype for item in header.point_format.dimensions}
        self.columns: Mapping[str, np.dtype[Any]] = {
            **dict.fromkeys(AXES, np.dtype(np.float64)),
            # Those of a few bits only have no dtype of their own.
            **{name: np.dtype(kinds[name] or np.uint8) for name in names},
        }

    @property
    def metres(self) -> Mapping[str, float]:
        """The metres that one of x, y and z is, where it is not one."""
        return metres_per_unit(self._system, self.path, wkt=self._wkt)

    def __len__(self) -> int:
        """Count the points."""
        return self._count

    def read(self, names: Sequence[str]) -> Iterator[tuple[NDArray[Any], ...]]:
        """Read columns chunk by chunk."""
        wanted = _selection(names)
        with laspy.open(self.path, read_evlrs=False) as reader:
            for points in self._points(reader, wanted):
                yield tuple(np.array(points[name]) for name in names)

    def _points(self, reader: laspy.LasReader, wanted: Parts) -> Iterator[Any]:
        """Read points chunk by chunk; of LAZ, what is wanted of them."""
        if reader.header.are_points_compressed:
            return unpacked(self.path, reader.header, wanted, CHUNK)
        return iter(reader.chunk_iterator(CHUNK))

    def copy(self, path: Path, change: Change) -> Iterator[int]:
        """Write a copy, compressed if its name ends with .laz."""
        with laspy.open(self.path) as reader, path.open('w+b') as stream:
            header = deepcopy(reader.header)
            records = self._records(VLR, slice(94, 96), slice(100, 104))
            evlrs = self._records(EVLR, slice(235, 243), slice(243, 247)) if header.evlrs else []
            if change.added:
                # laspy describes all extra dimensions anew.
                records = [record for record in records if not record.describes_dimensions]
            header.vlrs[:] = records
            if change.added:
                kinds = {name: values.dtype for name, values in change.added.items()}
                header.add_extra_dims([laspy.ExtraBytesParams(*item) for item in kinds.items()])
            compress = path.suffix.lower() == '.laz'
            writer = laspy.LasWriter(stream, header, compress, closefd=False)
            done = 0
            for points in self._points(reader, Parts.all()):
                part = slice(done, done + len(points))
                writer.write_points(_changed(points, header, change, part))
                done = part.stop
                yield done
            writer.write_evlrs(VLRList(evlrs)) if evlrs else None
            writer.close()
            self._restore(stream, writer.header, records, evlrs, change)

    def _records(self, layout: struct.Struct, begin: slice, count: slice) -> list[_Record]:
        """Read the records once more, as bytes; ``begin`` and ``count`` are offsets in the header.

        Those on the layout of the points are left out: the copy has its own, and is no COPC.
        """
        records = []
        with self.path.open('rb') as stream:
            header = stream.read(LONGEST)
            stream.seek(int.from_bytes(header[begin], 'little'))
            for _ in range(int.from_bytes(header[count], 'little')):
                head = stream.read(layout.size)
                _, user, number, size, _ = layout.unpack(head)
                name = user.split(b'\0')[0].decode()
                record = _Record(name, number, head, stream.read(size))
                if name not in _LAYOUTS:
                    records.append(record)
        return records

    def _restore(
        self,
        stream: BinaryIO,
        header: Any,
        records: Sequence[_Record],
        evlrs: Sequence[_Record],
        change: Change,
    ) -> None:
        """Put back the bytes that laspy wrote in its own words."""
        with self.path.open('rb') as source:
            before = source.read(LONGEST)
        parts = {_IDENTITY.start: before[_IDENTITY]}
        if change.keep is None:
            parts[_LEGACY.start] = before[_LEGACY]
            parts[_BOUNDS.start] = before[_BOUNDS]
        elif any(before[_LEGACY]):
            counts = (header.point_count, *header.number_of_points_by_return[:5])
            parts[_LEGACY.start] = struct.pack('<6I', *(int(count) for count in counts))
        parts[int.from_bytes(before[94:96], 'little')] = b''.join(
            record.head + record.data for record in records
        )
        parts[header.start_of_first_evlr] = b''.join(record.head + record.data for record in evlrs)
        for offset, data in parts.items():
            if data:
                stream.seek(offset)
                stream.write(data)


def _selection(names: Sequence[str]) -> Parts:
    """Return the least that must be unpacked for some columns; the count of points is in x."""
    wanted = Parts.XY_RETURNS_CHANNEL
    for name in names:
        wanted |= _PARTS.get(name, Parts.all())
    return wanted


def _changed(points: Any, header: Any, change: Change, part: slice) -> Any:
    """Return the points of a chunk, changed."""
    if change.noise is not None or change.high is not None:
        classes = np.array(points.classification)
        for some, number in ((change.noise, NOISE), (change.high, HIGH_NOISE)):
            if some is not None:
                classes[some[part]] = number
        points.classification = classes
    if change.withheld is not None:
        flag = np.array(points.withheld)
        flag[change.withheld[part]] = 1
        points.withheld = flag
    if change.added:
        wider = laspy.ScaleAwarePointRecord.zeros(len(points), header=header)
        for name in points.array.dtype.names:
            wider.array[name] = points.array[name]
        for name, values in change.added.items():
            wider[name] = values[part]
        points = wider
    return points if change.keep is None else points[change.keep[part]]
