# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""LAS and LAZ files, through laspy and lazrs.

laspy rewrites parts of the header and the GeoTIFF keys. Copies get the original bytes back.
"""

import logging
import signal
import struct
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO, cast

import laspy
import lazrs
import numpy as np
from laspy import DecompressionSelection as Parts
from laspy.header import LAS_HEADERS_SIZE, Version
from laspy.vlrs.vlrlist import VLRList
from numpy.typing import NDArray

from lidar_outlier_filter.errors import CloudError, quote_error
from lidar_outlier_filter.files import unpack_laz
from lidar_outlier_filter.files.cloud_file import CHUNK_ROWS, Change, CloudFile, is_copc
from lidar_outlier_filter.files.copc import NodeBackend, Octree, read_octree
from lidar_outlier_filter.files.las_header import (
    HEAD_BYTES,
    MAX_HEADER_BYTES,
    USER,
    LasRecord,
    check_las_points,
    check_scaling,
    metres_per_unit,
    name_and_wkt,
    read_records,
)

HIGH_NOISE = 18  # ASPRS: high point, noise
_FEW_CLASSES, _MAX_OF_FEW = range(6), 31  # point formats with 5 bits for a class
EXTRA_BYTES = 4  # number of the record that describes extra dimensions
_DESCRIBED = ('LASF_Spec', EXTRA_BYTES)
_OUTDATED = _DESCRIBED, ('copc', 10000)  # by more dimensions; the latter has extents of each
# Of the description of an extra dimension (LAS 1.4, table 24): all its bytes, where its options,
# least and largest value lie, and the options that say that both are known.
_DIMENSION_BYTES, _OPTIONS, _LEAST, _LARGEST, _HAS_LIMITS = 192, 3, 64, 88, 2 | 4
AXES = ('x', 'y', 'z')
# What is unpacked for a column of point formats 6 to 10; all of a point for any other column.
_RETURNS = ('x', 'y', 'return_number', 'scanner_channel')
_PARTS = {
    **dict.fromkeys(_RETURNS, Parts.XY_RETURNS_CHANNEL),
    **dict.fromkeys(('edge_of_flight_line', 'scan_direction_flag'), Parts.FLAGS),
    'z': Parts.Z,
    **{
        name: Parts[name.upper()]
        for name in ('classification', 'scan_angle', 'point_source_id', 'gps_time')
    },
}
# Offsets in the header (LAS 1.4, table 3), first byte and the one behind the last.
_IDENTITY = slice(4, 94)  # file source, encoding, project, system, software, day and year
_VERSION = slice(24, 26)
_LEGACY = slice(107, 131)  # number of points, and by return, as LAS 1.3 knew them
_BOUNDS = slice(179, 227)
_LASZIP = 'laszip encoded'
_LAYOUTS = {'copc', _LASZIP}  # records on how the points lie in the file
_MAX_BYTES_AT_ONCE = 2**28  # of points in memory at once

# It logs errors that it also raises.
logging.getLogger('laspy').addHandler(logging.NullHandler())


class LasFile(CloudFile):
    """A LAS or LAZ file; see :class:`CloudFile`. Columns x, y and z are in the unit of the file."""

    classes = True

    def __init__(self, path: Path) -> None:
        """Read the header."""
        self.path = path
        self._records, self._evlrs = read_records(path)
        with laspy.open(path, read_evlrs=False) as reader:
            header = reader.header
        if header.global_encoding.waveform_data_packets_internal:
            must_be = 'with its waveforms in a file of their own'
            raise CloudError(f'the file {path}', must_be, 'waveforms within')
        check_scaling(path, header.scales, header.offsets)
        self._count = int(header.point_count)
        if header.are_points_compressed:
            for _ in _unpacked(path, header, Parts.base(), 0):
                pass
        else:
            check_las_points(path, self._count)
        self._wkt = bool(header.global_encoding.wkt)
        if header.point_format.id in _FEW_CLASSES:
            self.max_class = _MAX_OF_FEW
        self.about = {'LAS': f'{header.version}', 'point format': f'{header.point_format.id}'}
        self.columns: Mapping[str, np.dtype[Any]] = {
            **dict.fromkeys(AXES, np.dtype(np.float64)),
            # Fields of a few bits have no dtype.
            **{
                item.name: np.dtype(item.dtype or np.uint8)
                for item in header.point_format.dimensions
                if item.name not in {'X', 'Y', 'Z'}
            },
        }

    @cached_property
    def octree(self) -> Octree | None:  # type: ignore[override]  # it may be refused
        """The octree of a COPC file."""
        return read_octree(self.path, self._records, self._evlrs)

    @property
    def _system(self) -> dict[int, bytes]:
        """The records of the coordinate system, by number."""
        known = [*self._records, *self._evlrs]
        return {one.record_id: one.record_data_bytes() for one in known if one.user_id == USER}

    @cached_property
    def _crs(self) -> tuple[str, str]:
        return name_and_wkt(self._system, self.path)

    @property
    def crs(self) -> str:  # type: ignore[override]  # it may refuse to say it
        """The name of the coordinate system; empty where the file names none."""
        return self._crs[0]

    @property
    def wkt(self) -> str:  # type: ignore[override]  # likewise
        """The coordinate system as WKT."""
        return self._crs[1]

    @cached_property
    def metres(self) -> Mapping[str, float]:  # type: ignore[override]  # it may refuse to say it
        """Metres per unit of x, y and z, where that is not 1."""
        return metres_per_unit(self._system, self.path, wkt=self._wkt)

    def read(self, names: Sequence[str]) -> Iterator[tuple[NDArray[Any], ...]]:
        """Read columns chunk by chunk."""
        requested = Parts.XY_RETURNS_CHANNEL  # the count of points is in x
        for name in names:
            requested |= _PARTS.get(name, Parts.all())
        with laspy.open(self.path, read_evlrs=False) as reader:
            for points in self._points(reader, requested):
                yield tuple(np.array(points[name]) for name in names)

    def _points(
        self, reader: laspy.LasReader, requested: Parts, table: int | None = None
    ) -> Iterator[Any]:
        """Read points chunk by chunk; of LAZ, only the requested parts."""
        if reader.header.are_points_compressed:
            return _unpacked(self.path, reader.header, requested, CHUNK_ROWS, table)
        return iter(reader.chunk_iterator(CHUNK_ROWS))

    def copy(self, path: Path, change: Change) -> Iterator[int]:
        """Write a copy: compressed for .laz, with the octree for .copc.laz."""
        octree = self.octree if is_copc(path) else None
        # Else the copy has a layout of its own.
        left_out = _LAYOUTS if octree is None else ()
        records = [one for one in self._records if one.user_id not in left_out]
        evlrs = [one for one in self._evlrs if one.user_id not in left_out]
        with laspy.open(self.path, read_evlrs=False) as reader, path.open('w+b') as stream:
            header = deepcopy(reader.header)
            if str(header.version) == '1.0':  # laspy reads it only; its header is that of 1.1
                header.version = Version(1, 1)
            if change.added:
                # laspy describes all extra dimensions anew.
                records = [one for one in records if (one.user_id, one.record_id) not in _OUTDATED]
            header.vlrs[:] = records
            if change.added:
                kinds = {name: values.dtype for name, values in change.added.items()}
                header.add_extra_dims([laspy.ExtraBytesParams(*item) for item in kinds.items()])
            compress, backend, table = path.suffix.lower() == '.laz', None, None
            if octree is not None:
                if change.added:
                    records = [_of_wider_points(one, header) for one in records]
                    header.vlrs[: len(records)] = records
                counts, table = octree.kept(change.keep), octree.table
                (laszip,) = (one.record_data_bytes() for one in records if one.user_id == _LASZIP)
                backend = NodeBackend(laszip, counts)
            writer = laspy.LasWriter(stream, header, compress, backend, closefd=False)
            done = 0
            for points in self._points(reader, Parts.all(), table):
                part = slice(done, done + len(points))
                writer.write_points(_changed(points, header, change, part))
                done = part.stop
                yield done
            if evlrs:
                writer.write_evlrs(VLRList(evlrs))
            writer.close()
            self._restore(stream, writer.header, change, (records, evlrs))
            if octree is not None:
                after = writer.header
                offsets = int(after.offset_to_point_data), int(after.start_of_first_evlr)
                octree.write(stream, laszip, offsets, counts)

    def _restore(
        self,
        stream: BinaryIO,
        header: Any,
        change: Change,
        records: Sequence[Sequence[LasRecord]],
    ) -> None:
        """Put back the bytes that laspy rewrote: of the header, and the heads of the records."""
        with self.path.open('rb') as source:
            before = source.read(MAX_HEADER_BYTES)
        parts = {_VERSION.start: before[_VERSION], _IDENTITY.start: before[_IDENTITY]}
        if change.keep is None:
            parts[_LEGACY.start] = before[_LEGACY]
            parts[_BOUNDS.start] = before[_BOUNDS]
        elif any(before[_LEGACY]):
            counts = (header.point_count, *header.number_of_points_by_return[:5])
            parts[_LEGACY.start] = struct.pack('<6I', *(int(count) for count in counts))
        for offset, data in parts.items():
            stream.seek(offset)
            stream.write(data)
        begin = LAS_HEADERS_SIZE[str(header.version)] + len(header.extra_header_bytes)
        for offset, some in zip((begin, header.start_of_first_evlr), records, strict=True):
            for record in some:
                stream.seek(offset)
                stream.write(record.head)
                offset += len(record.head) + len(record.record_data)  # noqa: PLW2901
            if some is records[0] and change.added:
                self._describe(stream, offset + HEAD_BYTES, change)

    def _describe(self, stream: BinaryIO, offset: int, change: Change) -> None:
        """Describe the extra dimensions in a record of laspy: the file's own as they were."""
        known = ((one.user_id, one.record_id) for one in self._records)
        own = dict(zip(known, self._records, strict=True)).get(_DESCRIBED)
        stream.seek(offset)
        if own is not None:
            data = own.record_data_bytes()
            stream.write(data[: len(data) // _DIMENSION_BYTES * _DIMENSION_BYTES])
        for values in change.added.values():
            begin = stream.tell()
            one = bytearray(stream.read(_DIMENSION_BYTES))
            kept = values if change.keep is None else values[change.keep]
            kept = kept[np.isfinite(kept)]
            one[_OPTIONS] = _HAS_LIMITS if len(kept) else 0
            kind = {'f': 'd', 'u': 'Q', 'i': 'q'}[values.dtype.kind]
            limits = (kept.min().item(), kept.max().item()) if len(kept) else (0, 0)
            for place, limit in zip((_LEAST, _LARGEST), limits, strict=True):
                struct.pack_into(f'<{kind}', one, place, limit)
            stream.seek(begin)
            stream.write(one)


def _of_wider_points(record: LasRecord, header: laspy.LasHeader) -> LasRecord:
    """Return a record of a COPC file whose points get more extra bytes."""
    if record.user_id != _LASZIP:
        return record
    kind = header.point_format
    laszip = lazrs.LazVlr.new_for_compression(
        kind.id, kind.num_extra_bytes, use_variable_size_chunks=True
    )
    data = bytes(laszip.record_data())
    wider = LasRecord(record.user_id, record.record_id, record.description, data)
    wider.head = record.head[:20] + struct.pack('<H', len(data)) + record.head[22:]
    return wider


def _unpacked(
    path: Path, header: laspy.LasHeader, parts: Parts, rows: int, table: int | None = None
) -> Iterator[Any]:
    """Yield the points of a LAZ file as laspy does, ``rows`` at once, by a process of its own.

    With no rows, only the count of points is checked. A ``table`` of chunks that does not have
    this checksum is refused.
    """
    count, each = int(header.point_count), int(header.point_format.size)
    records = [record.record_data_bytes() for record in header.vlrs.get('LasZipVlr')]
    if len(records) != 1:
        raise CloudError(f'the records of LASzip in {path}', 'one', len(records))
    rows = min(rows, max(1, _MAX_BYTES_AT_ONCE // each))
    selection = sum(
        getattr(lazrs, f'SELECTIVE_DECOMPRESS_{part.name}') for part in Parts if part in parts
    )
    library, record = Path(lazrs.__file__).parents[1], records[0].hex()
    numbers = (
        header.offset_to_point_data,
        selection,
        each,
        count,
        rows,
        -1 if table is None else table,
    )
    command = [sys.executable, '-I', '-S', unpack_laz.__file__, library, path.absolute(), record]
    with (
        tempfile.TemporaryFile() as said,
        # In a session of its own: Ctrl-C is for the reader.
        subprocess.Popen(  # noqa: S603  no shell; all but the path are numbers
            [*map(str, (*command, *numbers))],
            stdout=subprocess.PIPE,
            stderr=said,
            start_new_session=True,
        ) as process,
    ):
        stream = cast('BinaryIO', process.stdout)
        try:
            for first in range(0, count, rows) if rows else ():
                data = np.empty(min(rows, count - first), header.point_format.dtype())
                if stream.readinto(data.view(np.uint8).data) != data.nbytes:  # type: ignore[attr-defined]
                    break
                yield laspy.ScaleAwarePointRecord(
                    data, header.point_format, header.scales, header.offsets
                )
            else:
                if rows or process.wait() == 0:
                    return
            status = process.wait()
            said.seek(0)
            text = said.read().decode(errors='replace').rpartition('\n')[2]
            if status < 0:
                text = f'the library for LAZ ended by {signal.Signals(-status).name}'
            raise CloudError(f'the file {path}', 'readable', quote_error(RuntimeError(text)))
        finally:
            process.kill()


def _changed(points: Any, header: Any, change: Change, part: slice) -> Any:
    """Return the points of a chunk, changed."""
    if change.noise is not None or change.high is not None:
        classes = np.array(points.classification)
        for some, number in ((change.noise, change.code), (change.high, HIGH_NOISE)):
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
