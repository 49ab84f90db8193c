# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The octree of a COPC file (https://copc.io, 1.0), which a copy keeps.

The points of each node are one chunk of LAZ. Pages of entries, in a record behind the points, say
where each chunk is, and how many points it has. A copy has the same nodes, whose chunks lie
elsewhere.
"""

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO

import lazrs
import numpy as np
from laspy._pointwriter import IPointWriter
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Bools
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.cloud_file import check_fits, check_offset
from lidar_outlier_filter.files.las_header import MAX_HEADER_BYTES, LasRecord, number
from lidar_outlier_filter.files.unpack_laz import checksum

USER, INFO, HIERARCHY = 'copc', 1, 1000  # numbers of records
_INFO_BYTES = 160
_ROOT = struct.Struct('<QQ')  # offset and bytes of the root page
_ROOT_AT = 40  # its offset in the info
_POINT_FORMATS = (6, 7, 8)
_PAGE = -1  # count of an entry that is another page
_TABLE_BYTES = 8  # before the first chunk: the offset of the table of chunks
_CHUNK = struct.Struct('<Qii')  # the second half of an entry
_CHUNK_AT = 16  # its offset in the entry, behind the key
_ENTRY = np.dtype([('key', '<i4', 4), ('offset', '<u8'), ('bytes', '<i4'), ('count', '<i4')])


class Octree:
    """The nodes with points, in the order of their chunks.

    Attributes
    ----------
    counts : (N,) int, points of each node
    table : checksum of the table of chunks that belongs to them

    """

    def __init__(
        self, path: Path, header: bytes, info: LasRecord, records: Sequence[LasRecord]
    ) -> None:
        """Read and check all pages.

        Parameters
        ----------
        path : of the file
        header : its first bytes
        info : the record that says where the root page is
        records : those behind the points

        """
        self._info_at = info.at
        self._root = _ROOT.unpack_from(info.record_data_bytes(), _ROOT_AT)
        if header[104] & 63 not in _POINT_FORMATS:
            raise CloudError(f'the point format of {path}', 'from 6 to 8 in COPC', header[104] & 63)
        # Where the records behind the points begin, or the file ends.
        self._extended = number(header, 235, 8) if records else path.stat().st_size
        self._data, self._at = b'', self._extended
        for record in records:
            if (record.user_id, record.record_id) == (USER, HIERARCHY):
                self._data, self._at = record.record_data_bytes(), record.at
                break
        starts, entries = self._read_pages(path)
        if (entries['count'] < _PAGE).any():
            raise CloudError(
                f'the points of a node of {path}', 'at least 0', entries['count'].min()
            )
        self._pages = starts[entries['count'] == _PAGE]
        some = np.flatnonzero(entries['count'] > 0)
        some = some[np.argsort(entries['offset'][some], kind='stable')]
        self._nodes, nodes = starts[some], entries[some]
        self.counts = nodes['count'].astype(np.int64)
        begin, total = number(header, 96, 4), number(header, 247, 8)
        sizes = nodes['bytes'].astype(np.int64)
        ends = begin + _TABLE_BYTES + np.cumsum(sizes)
        wrong = (sizes <= 0) | (ends > self._extended)
        wrong |= nodes['offset'] != (ends - sizes).astype('u8')
        if wrong.any():
            key = '-'.join(map(str, nodes['key'][np.argmax(wrong)]))
            must_be = 'behind those of the node before, before the records'
            raise CloudError(f'the points of the nodes of {path}', must_be, f'others at {key}')
        if (found := int(self.counts.sum())) != total:
            raise CloudError(f'the nodes of {path}', f'of {total} points, as it says', found)
        self.table = checksum([*zip(self.counts.tolist(), sizes.tolist(), strict=True)])

    def _read_pages(self, path: Path) -> tuple[NDArray[np.int64], NDArray[np.void]]:
        """Return all entries, and where each is in the record; each byte is read once at most."""
        read = np.zeros(len(self._data), np.bool_)
        starts, entries = [np.empty(0, np.int64)], [np.empty(0, _ENTRY)]
        pages, end = [self._root], self._at + len(self._data)
        while pages:
            offset, size = pages.pop()
            check_offset(path, 'a page of the octree', offset, self._at, end)
            check_fits(path, 'the bytes in a page of the octree', size, 1, end - offset)
            part = slice(offset - self._at, offset - self._at + size)
            if size % _ENTRY.itemsize or read[part].any():
                must_be = 'of whole entries, and referred to once'
                got = f'{size} bytes at byte {offset}'
                raise CloudError(f'a page of the octree of {path}', must_be, got)
            read[part] = True
            starts.append(np.arange(part.start, part.stop, _ENTRY.itemsize))
            entries.append(np.frombuffer(self._data[part], _ENTRY))
            more = entries[-1][entries[-1]['count'] == _PAGE]
            pages += zip(more['offset'].tolist(), more['bytes'].tolist(), strict=True)
        return np.concatenate(starts), np.concatenate(entries)

    def kept(self, keep: Bools | None) -> NDArray[np.int64]:
        """Count the points of each node in a copy."""
        if keep is None:
            return self.counts
        return np.add.reduceat(keep, np.cumsum(self.counts) - self.counts, dtype=np.int64)

    def write(
        self, stream: BinaryIO, laszip: bytes, offsets: tuple[int, int], counts: NDArray[np.int64]
    ) -> None:
        """Write the pages of a finished copy, and where the root page is.

        Parameters
        ----------
        stream : the copy
        laszip : its record of LASzip
        offsets : of its points, and of the records behind them, bytes
        counts : points of each node

        """
        begin, extended = offsets
        stream.seek(begin)
        chunks = lazrs.read_chunk_table(stream, lazrs.LazVlr(laszip))
        sizes = iter([size for count, size in chunks if count])
        data, offset, shift = bytearray(self._data), begin + _TABLE_BYTES, extended - self._extended
        for start, count in zip(self._nodes.tolist(), counts.tolist(), strict=True):
            # A node without points has no chunk.
            size = next(sizes) if count else 0
            _CHUNK.pack_into(data, start + _CHUNK_AT, offset if count else 0, size, count)
            offset += size
        for start in self._pages.tolist():
            known, *rest = _CHUNK.unpack_from(data, start + _CHUNK_AT)
            _CHUNK.pack_into(data, start + _CHUNK_AT, known + shift, *rest)
        stream.seek(self._at + shift)
        stream.write(data)
        stream.seek(self._info_at + _ROOT_AT)
        stream.write(_ROOT.pack(self._root[0] + shift, self._root[1]))


def read_octree(
    path: Path, records: Sequence[LasRecord], evlrs: Sequence[LasRecord]
) -> Octree | None:
    """Read the octree of a file; None: it has none."""
    with path.open('rb') as stream:
        header = stream.read(MAX_HEADER_BYTES)
    one = records[0] if records else None
    if one is None or (one.user_id, one.record_id) != (USER, INFO):
        return None
    if number(header, 94, 2) != MAX_HEADER_BYTES or len(one.record_data_bytes()) != _INFO_BYTES:
        return None
    return Octree(path, header, one, evlrs)


class NodeBackend:
    """What laspy compresses points with: each node is a chunk."""

    def __init__(self, laszip: bytes, counts: NDArray[np.int64]) -> None:
        self._laszip, self._counts = laszip, counts

    def is_available(self) -> bool:
        """Return whether it can be used."""
        return True

    def create_writer(self, stream: BinaryIO, _header: Any) -> IPointWriter:
        """Return what laspy gives the points to."""
        return _NodeWriter(stream, self._laszip, self._counts)


class _NodeWriter(IPointWriter):  # type: ignore[misc]  # laspy has no types
    """Compresses nodes as their points come."""

    def __init__(self, stream: BinaryIO, laszip: bytes, counts: NDArray[np.int64]) -> None:
        self._stream, self._vlr = stream, lazrs.LazVlr(laszip)
        self._ends = np.cumsum(counts[counts > 0])
        self._done = 0

    @property
    def destination(self) -> BinaryIO:
        return self._stream

    def write_initial_header_and_vlrs(self, header: Any, encoding_errors: str) -> None:
        super().write_initial_header_and_vlrs(header, encoding_errors)
        self._packer = lazrs.LasZipCompressor(self._stream, self._vlr)
        self._packer.reserve_offset_to_chunk_table()

    def write_points(self, points: Any) -> None:
        last = self._done + len(points)
        inside = self._ends[(self._ends > self._done) & (self._ends < last)]
        for number_of, part in enumerate(np.split(points.array, inside - self._done)):
            # The last chunk ends with the file: behind it the library would begin an empty one.
            if number_of or self._done in self._ends:
                self._packer.finish_current_chunk()
            self._packer.compress_many(np.frombuffer(part, np.uint8))
        self._done = last

    def done(self) -> None:
        self._packer.done()
