# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""PCD files of the Point Cloud Library: ascii, binary, binary_compressed.

Read here and not by pypcd4, the library there is: it prints the numbers of ascii files anew, drops
comments, gives padding random names, and holds whole files in memory. LZF is left to liblzf.
"""

import struct
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from itertools import accumulate
from pathlib import Path
from typing import Any, BinaryIO

import lzf
import numpy as np

from lidar_outlier_filter.core.annotations import Rows
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.cloud_file import (
    Change,
    check_count,
    check_fits,
    check_names,
    parse_count,
)
from lidar_outlier_filter.files.rows import (
    BinaryRows,
    RowFile,
    TextRows,
    read_header,
    single_numbers,
)

_KINDS = {'I': ('i', {1, 2, 4, 8}), 'U': ('u', {1, 2, 4, 8}), 'F': ('f', {4, 8})}
_LETTERS = {kind: letter for letter, (kind, _) in _KINDS.items()}
_SIZES = struct.Struct('<II')


class PcdFile(RowFile):
    """A PCD file; see :class:`CloudFile`."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with path.open('rb') as stream:
            self._header = read_header(stream, bool, lambda line: line.upper().startswith(b'DATA'))
            self._offset = stream.tell()
        said = {words[0].upper(): words[1:] for line in self._header if (words := line.split())}
        self._names = [name.decode('latin-1') for name in self._words(said, b'FIELDS')]
        self._dtype = self._layout(said)
        width, height = (self._numbers(said, key)[0] for key in (b'WIDTH', b'HEIGHT'))
        self._count = self._numbers(said, b'POINTS')[0] if b'POINTS' in said else width * height
        self._data = self._words(said, b'DATA')[0].decode('latin-1').lower()
        if min(width, height) < 0:
            raise CloudError(f'WIDTH and HEIGHT in {path}', 'at least 0', f'{width} and {height}')
        if self._count != width * height:
            must_be = f'WIDTH × HEIGHT = {width * height}'
            raise CloudError(f'POINTS in {path}', must_be, self._count)
        if self._data not in {'ascii', 'binary', 'binary_compressed'}:
            must_be = 'ascii, binary or binary_compressed'
            raise CloudError(f'DATA in {path}', must_be, repr(self._data))
        numbers = single_numbers(self._dtype)
        self.columns: Mapping[str, np.dtype[Any]] = {
            name: kind for name, kind in numbers.items() if not name.startswith('_ ')
        }
        self._rows = self._find_rows()

    def _words(self, said: Mapping[bytes, Sequence[bytes]], key: bytes) -> Sequence[bytes]:
        """Return the words of a header line; refuse a header without them."""
        if not said.get(key):
            raise CloudError(f'the header of {self.path}', 'complete', f'no {key.decode()}')
        return said[key]

    def _numbers(self, said: Mapping[bytes, Sequence[bytes]], key: bytes) -> list[int]:
        return [
            parse_count(self.path, key.decode(), text.decode('latin-1'))
            for text in self._words(said, key)
        ]

    def _layout(self, said: Mapping[bytes, Sequence[bytes]]) -> np.dtype[np.void]:
        """Make the dtype of a row; padding, whose name is always ``_``, is numbered."""
        sizes = self._numbers(said, b'SIZE')
        counts = self._numbers(said, b'COUNT') if b'COUNT' in said else [1] * len(sizes)
        kinds = [letter.decode('latin-1') for letter in self._words(said, b'TYPE')]
        if not len(self._names) == len(sizes) == len(kinds) == len(counts):
            got = f'{len(self._names)}, {len(sizes)}, {len(kinds)} and {len(counts)}'
            must_be = 'of one length'
            raise CloudError(f'FIELDS, SIZE, TYPE and COUNT in {self.path}', must_be, got)
        names = [f'_ {i}' if name == '_' else name for i, name in enumerate(self._names)]
        check_names(self.path, names)
        length = self.path.stat().st_size
        for kind, size, count in zip(kinds, sizes, counts, strict=True):
            if kind not in _KINDS or size not in _KINDS[kind][1]:
                must_be = 'I or U of 1, 2, 4 or 8 bytes, or F of 4 or 8'
                raise CloudError(f'a field of {self.path}', must_be, f'{kind} of {size}')
            check_fits(self.path, 'COUNT', count, 1, length)
        if sum(counts) == 0:
            raise CloudError(f'COUNT of {self.path}', 'at least 1 for a field', '0 for all')
        return np.dtype(
            [
                (name, f'<{_KINDS[kind][0]}{size}', *([(count,)] if count != 1 else []))
                for name, kind, size, count in zip(names, kinds, sizes, counts, strict=True)
            ]
        )

    def _find_rows(self) -> BinaryRows | TextRows:
        if self._data == 'ascii':
            counts = [dtype.itemsize // dtype.base.itemsize for dtype in self._kinds]
            indices = dict(zip(self._dtype.names or (), accumulate([0, *counts]), strict=False))
            columns = {name: (indices[name], kind) for name, kind in self.columns.items()}
            return TextRows(self.path, self._offset, self._count, sum(counts), columns)
        if self._data == 'binary':
            return BinaryRows.map(self.path, self._offset, self._dtype, self._count)
        return BinaryRows(self._decompressed)

    @property
    def _kinds(self) -> list[np.dtype[Any]]:
        return [self._dtype[name] for name in self._dtype.names or ()]

    @cached_property
    def _decompressed(self) -> Rows:
        """The rows of a compressed file, in which the columns come one after the other."""
        rows = np.empty(self._count, self._dtype)
        if self._count == 0:
            return rows
        with self.path.open('rb') as stream:
            stream.seek(self._offset)
            left = self.path.stat().st_size - self._offset - _SIZES.size
            check_fits(self.path, 'the sizes', 1, 1, left)
            packed, size = _SIZES.unpack(stream.read(_SIZES.size))
            check_fits(self.path, 'the compressed bytes', packed, 1, left)
            # LZF makes at most 264 bytes of three.
            check_fits(self.path, 'the bytes unpacked', size, 1, packed * 88)
            check_count(self.path, self._count, size // self._dtype.itemsize)
            columns = lzf.decompress(stream.read(packed), size) or b''
            if len(columns) != size:
                raise CloudError(f'the bytes unpacked of {self.path}', f'{size}', len(columns))
        begin = 0
        for name, kind in zip(self._dtype.names or (), self._kinds, strict=True):
            rows[name] = np.ndarray(self._count, kind, columns, begin)
            begin += kind.itemsize * self._count
        return rows

    def copy(self, path: Path, change: Change) -> Iterator[int]:
        """Write a copy; without some of its points a cloud is organised no more."""
        if self._data != 'binary_compressed':
            yield from super().copy(path, change)
            return
        with path.open('wb') as stream:
            stream.writelines(self._changed_header(change))
            self._compress(stream, change)
        yield self._count

    def _changed_header(self, change: Change) -> Iterator[bytes]:
        count = b'%d' % change.count(self._count)
        shape = {b'WIDTH': count, b'HEIGHT': b'1', b'POINTS': count}
        kinds = [values.dtype for values in change.added.values()]
        added = {
            b'FIELDS': ' '.join(change.added),
            b'SIZE': ' '.join(str(kind.itemsize) for kind in kinds),
            b'TYPE': ' '.join(_LETTERS[kind.kind] for kind in kinds),
            b'COUNT': ' '.join('1' for _ in kinds),
        }
        for line in self._header:
            word = line.split(maxsplit=1)[0].upper() if line.split() else b''
            if word in shape and change.keep is not None:
                yield word + b' ' + shape[word] + b'\n'
            elif word in added and kinds:
                yield line.rstrip() + b' ' + added[word].encode() + b'\n'
            else:
                yield line

    def _compress(self, stream: BinaryIO, change: Change) -> None:
        """Write the columns one after the other, compressed."""
        rows = self._decompressed
        columns = [rows[name] for name in rows.dtype.names or ()]
        columns += [
            values.astype(values.dtype.newbyteorder('<')) for values in change.added.values()
        ]
        kept = slice(None) if change.keep is None else change.keep
        data = b''.join(column[kept].tobytes() for column in columns)
        # With more memory, LZF also accepts incompressible data.
        packed = lzf.compress(data, len(data) + len(data) // 16 + 64) if data else b''
        stream.write(_SIZES.pack(len(packed), len(data)))
        stream.write(packed)
