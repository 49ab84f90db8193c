# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Rows of points behind a header, as in PCD, PLY, PTX and CSV, and poses of scans.

Rows are copied byte for byte; only requested columns are parsed.
"""

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, Literal

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Bools, Floats, Rows
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.cloud_file import (
    CHUNK_ROWS,
    Change,
    CloudFile,
    check_count,
    check_points,
)

_MAX_HEADER_BYTES = 1_000_000  # bytes


class RowFile(CloudFile):
    """A file with a header of lines, and one block of rows."""

    _header: Sequence[bytes]
    _rows: 'BinaryRows | TextRows'

    def read(self, names: Sequence[str]) -> Iterator[tuple[NDArray[Any], ...]]:
        """Read columns chunk by chunk."""
        return self._rows.read(names)

    def copy(self, path: Path, change: Change) -> Iterator[int]:
        """Write a copy."""
        with path.open('wb') as stream:
            stream.writelines(self._changed_header(change))
            yield from self._rows.write(stream, change)

    def _changed_header(self, _change: Change) -> Iterator[bytes]:
        yield from self._header


def read_header(
    stream: BinaryIO, is_first: Callable[[bytes], bool], is_last: Callable[[bytes], bool]
) -> list[bytes]:
    """Read the lines of a header, the last one included; refuse a file without such lines."""
    lines: list[bytes] = []
    while stream.tell() < _MAX_HEADER_BYTES:
        line = stream.readline(_MAX_HEADER_BYTES)
        if not line or (not lines and not is_first(line)):
            break
        lines.append(line)
        if is_last(line):
            return lines
    raise CloudError(f'the header of {stream.name}', 'complete', 'no last line of a header')


class BinaryRows:
    """Rows of fixed length."""

    def __init__(self, rows: Rows) -> None:
        """Use rows, (N,) structured, mapped from a file or in memory."""
        self._rows = rows

    @classmethod
    def map(
        cls, path: Path, offset: int, dtype: np.dtype[np.void], count: int, end: int | None = None
    ) -> 'BinaryRows':
        """Map the rows of a file from ``offset`` on; refuse a wrong number of them up to ``end``.

        Without ``end``, the rows reach to the end of the file.
        """
        end = path.stat().st_size if end is None else end
        check_points(path, count, dtype.itemsize, offset, end)
        if count == 0:
            return cls(np.empty(0, dtype))
        return cls(np.memmap(path, dtype, 'r', offset, count))

    def read(self, names: Sequence[str]) -> Iterator[tuple[NDArray[Any], ...]]:
        """Read columns chunk by chunk."""
        for begin in range(0, len(self._rows), CHUNK_ROWS):
            rows = self._rows[begin : begin + CHUNK_ROWS]
            yield tuple(np.ascontiguousarray(rows[name]) for name in names)

    def write(self, stream: BinaryIO, change: Change) -> Iterator[int]:
        """Write the rows, changed; yield how many are done."""
        kind = self._rows.dtype
        # As plain bytes: copies of a structured array lose the padding.
        plain = np.dtype((np.void, kind.itemsize))
        is_big = any(kind[name].base.byteorder == '>' for name in kind.names or ())
        order: Literal['<', '>'] = '>' if is_big else '<'
        added = [(name, values.dtype.newbyteorder(order)) for name, values in change.added.items()]
        for begin in range(0, len(self._rows), CHUNK_ROWS):
            part = slice(begin, begin + CHUNK_ROWS)
            rows = self._rows[part].view(plain)
            if added:
                wider = np.empty(len(rows), np.dtype([('', plain), *added]))
                wider['f0'] = rows
                for name, values in change.added.items():
                    wider[name] = values[part]
                rows = wider
            kept = rows if change.keep is None else rows[change.keep[part]]
            stream.write(kept.tobytes())
            yield begin + CHUNK_ROWS


class TextRows:
    """Rows that are lines, with numbers between separators."""

    def __init__(  # noqa: PLR0913  place and layout of the lines
        self,
        path: Path,
        offset: int,
        count: int | None,
        width: int,
        columns: Mapping[str, tuple[int, np.dtype[Any]]],
        *,
        separator: bytes = b' ',
        is_last: bool = True,
        instead: bytes = b'',
    ) -> None:
        """Note where the lines begin, how many there are, and index and type of the columns.

        Each line has ``width`` numbers. Only blank lines may follow the last lines of a file.
        Without a ``count``, all lines up to the end are rows. ``instead`` replaces a line that is
        left out.
        """
        self._path, self._offset, self._count, self._columns = path, offset, count, columns
        self._width, self._separator, self._is_last = width, separator, is_last
        self._instead = instead

    def read(self, names: Sequence[str]) -> Iterator[tuple[NDArray[Any], ...]]:
        """Read columns chunk by chunk, each number in its own type, as PCL does."""
        columns = [self._columns[name] for name in names]
        dtype = np.dtype([(f'f{i}', kind) for i, (_, kind) in enumerate(columns)])
        # numpy returns columns in the requested order.
        use = [index for index, _ in columns]
        done = 0
        for lines in self.chunks():
            text = [line.strip().decode('latin-1') for line in lines]
            self.check_widths(done, [len(line.split()) for line in text])
            done += len(lines)
            table = np.loadtxt(text, dtype, comments=None, usecols=use, ndmin=1)
            yield tuple(np.ascontiguousarray(table[name]) for name in dtype.names or ())

    def check_widths(self, done: int, widths: Sequence[int]) -> None:
        """Refuse rows of more or fewer numbers: added columns would be in the wrong place."""
        for number, found in enumerate(widths, done + 1):
            if found != self._width:
                what = f'point {number} of {self._path}'
                raise CloudError(what, f'of {self._width} numbers', found)

    def write(self, stream: BinaryIO, change: Change) -> Iterator[int]:
        """Write the lines, changed; yield how many are done."""
        done = 0
        for lines in self.chunks():
            part = change.part(slice(done, done + len(lines)))
            if part.added:
                added = [values.tolist() for values in part.added.values()]
                rows = zip(lines, *added, strict=True)
                # Nine digits distinguish any two float32.
                lines = [  # noqa: PLW2901
                    append(line, self._separator, [f'{value:.9g}' for value in values])
                    for line, *values in rows
                ]
            if part.keep is not None:
                kept = zip(lines, part.keep, strict=True)
                lines = [line if keep else self._left_out(line) for line, keep in kept]  # noqa: PLW2901
            stream.write(b''.join(lines))
            done += len(lines)
            yield done

    def _left_out(self, line: bytes) -> bytes:
        """Return the replacement of a line; its end and blank lines before it stay, if any does."""
        if not self._instead:
            return b''
        held = line.rstrip(b'\r\n')
        return held[: held.rfind(b'\n') + 1] + self._instead + line[len(held) :]

    def measure(self) -> tuple[int, int]:
        """Count the lines, and find the offset in the file where they end."""
        count, end = 0, self._offset
        for lines in self.chunks():
            count, end = count + len(lines), end + sum(map(len, lines))
        return count, end

    def chunks(self) -> Iterator[list[bytes]]:
        """Yield the lines chunk by chunk; blank lines belong to the line that follows."""
        with self._path.open('rb') as stream:
            stream.seek(self._offset)
            lines, found = _joined(stream), 0
            most = sys.maxsize if self._count is None else self._count
            while chunk := list(islice(lines, min(CHUNK_ROWS, most - found))):
                found += len(chunk)
                yield chunk
            if self._count is not None:
                more = sum(1 for _ in lines) if self._is_last else 0
                check_count(self._path, self._count, found + more)


def _joined(stream: BinaryIO) -> Iterator[bytes]:
    """Yield lines, each with the blank lines before it; blank lines at the end are left out."""
    blank: list[bytes] = []
    for line in stream:
        blank.append(line)
        if line.strip(b' \r\n'):
            yield b''.join(blank)
            blank.clear()


def append(line: bytes, separator: bytes, texts: Sequence[str]) -> bytes:
    """Append fields to a line, before its end of line."""
    held = line.rstrip(b'\r\n')
    return separator.join((held, *(text.encode() for text in texts))) + line[len(held) :]


def single_numbers(dtype: np.dtype[np.void]) -> dict[str, np.dtype[Any]]:
    """List the fields that are one number a row, with their types."""
    return {name: dtype[name] for name in dtype.names or () if dtype[name].subdtype is None}


def to_common_frame(
    xyz: Sequence[Any], pose: Floats, no_return: Bools | None = None
) -> Iterator[Floats]:
    """Yield x, y and z (n,) of a scan in the common frame; a missing return is NaN.

    The pose (3, 4) is a rotation and a position.
    """
    x, y, z = xyz
    at_origin = (x == 0) & (y == 0) & (z == 0)
    no_return = at_origin if no_return is None else no_return | at_origin
    with np.errstate(invalid='ignore', over='ignore'):  # infinite ones are no returns either
        for a, b, c, offset in pose:
            yield np.where(no_return, np.nan, x * a + y * b + z * c + offset)
