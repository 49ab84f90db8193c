# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Formats that are text: CSV with any of the usual separators, and PTX of scanners on tripods.

Lines are copied as the bytes that they are. Python's own ``csv`` finds the numbers of a table, with
and without names on top. A PTX file has scans, each a full grid of lines behind the scanner's pose.
A grid must stay whole, and readers count the numbers of a line: so a point that is left out becomes
a missing return, and no column is added.
"""

from __future__ import annotations

import csv
import re
from codecs import BOM_UTF8
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple, TextIO

import numpy as np

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.cloud_file import (
    CHUNK,
    FORMATS,
    Change,
    CloudFile,
    check_fits,
    check_names,
    parse_count,
    parse_number,
)
from lidar_outlier_filter.files.rows import TextRows, append, to_common_frame

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

_SEPARATORS = ',;\t| '
FLOAT = np.dtype(np.float64)
LONGEST_LINE = 1_000_000  # letters
EXACT = 2**53  # up to here a float64 holds every whole number

# PTX
_NAMES = ('x', 'y', 'z', 'intensity', 'red', 'green', 'blue')
# The numbers of a line, and the line of a missing return as Leica's programs write it.
_MISSING = {4: b'0 0 0 0.5', 7: b'0 0 0 0.5 0 0 0'}
_SHORTEST = 8  # bytes of a line
_LONGEST = 1000  # bytes of a line of a header
_SHAPE = ('columns', 'rows')
_POSE = (3,) * 4 + (4,) * 4  # numbers of each line: position, three axes, matrix


class _Row(NamedTuple):
    """The fields of a row, the text that they were, and the number of its first line."""

    fields: list[str]
    text: str
    line: int


def is_prose(path: Path) -> bool:
    """Return whether a file named as a text table is none: no number is in its first two rows."""
    if FORMATS.get(path.suffix.lower(), ('',))[0] != 'text':
        return False
    with path.open(encoding='utf-8-sig', errors='surrogateescape') as stream:
        lines = [stream.readline(LONGEST_LINE) for _ in range(2)]
    words = re.split(rf'[{_SEPARATORS}\n]', ''.join(lines))
    return not any(_is_number(word) for word in words)


class TextFile(CloudFile):
    """A table that is text; see :class:`CloudFile`.

    Without names on top the columns are called 1, 2, 3 and so on.
    """

    def __init__(self, path: Path) -> None:
        """Find the separator, the names, and how many rows there are."""
        self.path = path
        with path.open('rb') as raw:
            self._mark = raw.read(len(BOM_UTF8)) == BOM_UTF8
        # The one that makes the most of the first row.
        self._separator = max(_SEPARATORS, key=lambda mark: len(self._first(mark).fields))
        names, self._head, _ = self._first(self._separator)
        self._has_names = bool(names) and not all(_is_number(name) for name in names)
        if not self._has_names:
            names = [str(i + 1) for i in range(len(names))]
        check_names(path, names)
        self._width = len(names)
        with self._open() as stream:
            first_row = next(self._rows(stream), _Row([], '', 1)).fields
        with self._open() as stream:
            self._count = sum(1 for _ in self._rows(stream))
        self._indices = {
            name: index
            for index, (name, text) in enumerate(zip(names, first_row, strict=False))
            if not text or _is_number(text)
        }
        self.columns: Mapping[str, np.dtype[Any]] = dict.fromkeys(self._indices, FLOAT)

    def _open(self) -> TextIO:
        # What is no UTF-8 comes out again as it went in; a byte order mark belongs to no column.
        return self.path.open(encoding='utf-8-sig', errors='surrogateescape', newline='')

    def _first(self, mark: str) -> _Row:
        """Return the first row, whatever it is, with a separator; names may have line breaks."""
        with self._open() as stream:
            return next(self._parsed(stream, mark, strict=False), _Row([], '', 1))

    def _parsed(self, stream: TextIO, mark: str, *, strict: bool) -> Iterator[_Row]:
        """Yield the rows, and empty lines, each with the text that it was."""
        text: list[str] = []

        def noted() -> Iterator[str]:
            while line := stream.readline(LONGEST_LINE):
                if len(line) == LONGEST_LINE:
                    must_be = f'of fewer than {LONGEST_LINE} letters'
                    raise CloudError(f'a line of {self.path}', must_be, 'more')
                text.append(line)
                yield line

        reader = csv.reader(noted(), delimiter=mark, skipinitialspace=True, strict=strict)
        for fields in reader:
            if mark == ' ' and fields and not fields[-1]:
                fields.pop()  # blanks at the end separate nothing
            yield _Row(fields, ''.join(text), reader.line_num - len(text) + 1)
            text.clear()

    def _rows(self, stream: TextIO) -> Iterator[_Row]:
        """Yield the rows below the names; a row of empty fields is one, an empty line is none.

        Every row has as many fields as the first: a number in the wrong column is none.
        """
        rows = self._parsed(stream, self._separator, strict=True)
        if self._has_names:
            next(rows)
        for row in rows:
            if len(row.fields) <= 1 and not row.text.strip():
                continue
            if len(row.fields) != self._width:
                what = f'line {row.line} of {self.path}'
                raise CloudError(what, f'of {self._width} fields, as the first', len(row.fields))
            yield row

    def _chunks(self, stream: TextIO) -> Iterator[list[_Row]]:
        rows = self._rows(stream)
        while chunk := list(islice(rows, CHUNK)):
            yield chunk

    def __len__(self) -> int:
        """Count the points."""
        return self._count

    def read(self, names: Sequence[str]) -> Iterator[tuple[NDArray[Any], ...]]:
        """Read columns chunk by chunk; an empty field is missing."""
        indices = [self._indices[name] for name in names]
        with self._open() as stream:
            for rows in self._chunks(stream):
                table = [np.empty(len(rows)) for _ in names]
                for i, row in enumerate(rows):
                    for column, index in zip(table, indices, strict=True):
                        column[i] = self._number(row, index)
                yield tuple(
                    _exact(column, [row.fields[index] for row in rows])
                    for column, index in zip(table, indices, strict=True)
                )

    def _number(self, row: _Row, index: int) -> float:
        text = row.fields[index]
        try:
            return parse_number(text) if text and not text.isspace() else np.nan
        except ValueError:
            what = f'line {row.line} of {self.path}'
            raise CloudError(what, 'of numbers', repr(text)) from None

    def copy(self, path: Path, change: Change) -> Iterator[int]:
        """Write a copy: the rows as they are, with more fields or without some of the rows."""
        done = 0
        mark = self._separator.encode()
        with self._open() as stream, path.open('wb') as output:
            output.write(BOM_UTF8 if self._mark else b'')
            if self._has_names:
                names = self._separator.join(['', *change.added])
                held = self._head.rstrip('\r\n')
                output.write(_bytes(held + names + self._head[len(held) :]))
            for rows in self._chunks(stream):
                part = slice(done, done + len(rows))
                added = [values[part].tolist() for values in change.added.values()]
                keep = [True] * len(rows) if change.keep is None else change.keep[part].tolist()
                for row, stays, *values in zip(rows, keep, *added, strict=True):
                    if stays:
                        output.write(append(_bytes(row.text), mark, values))
                done = part.stop
                yield done


def _exact(column: NDArray[np.float64], texts: Sequence[str]) -> NDArray[Any]:
    """Return numbers as int64 if all are whole, so that none is rounded; NaN are missing then."""
    missing = np.isnan(column)
    known = column[~missing]
    if not (np.isfinite(known).all() and (known == np.floor(known)).all()):
        return column
    large = np.abs(column) >= EXACT
    whole = np.where(missing | large, 0, column).astype(np.int64)
    try:
        for i in np.flatnonzero(large).tolist():
            whole[i] = int(texts[i])
    except (ValueError, OverflowError):  # such as 1e300
        return column
    return np.ma.MaskedArray(whole, missing) if missing.any() else whole


def _is_number(text: str) -> bool:
    try:
        parse_number(text)
    except ValueError:
        return False
    return True


def _bytes(text: str) -> bytes:
    return text.encode('utf-8', 'surrogateescape')


@dataclass(frozen=True)
class _GridScan:
    """One scan: its header as it is, its count of lines, its pose (3, 4), and its lines."""

    header: bytes
    count: int
    pose: NDArray[np.float64]
    rows: TextRows


class PtxFile(CloudFile):
    """A PTX file; see :class:`CloudFile`. Points of all scans are in their common frame."""

    gaps = True

    def __init__(self, path: Path) -> None:
        """Find the scans, and check that each has all of its lines."""
        self.path = path
        self._scans: list[_GridScan] = []
        widths: set[int] = set()
        with path.open('rb') as stream:
            while (begin := _next_line(stream)) >= 0:
                stream.seek(begin)
                width = self._add_scan(stream)
                widths.add(width)
        self.columns: Mapping[str, np.dtype[Any]] = dict.fromkeys(
            _NAMES[: min(widths, default=0)], FLOAT
        )

    def _add_scan(self, stream: BinaryIO) -> int:
        """Read a header and go to the end of its points; return how many numbers a line has."""
        what = f'scan {len(self._scans) + 1}'
        begin = stream.tell()
        columns, rows = (
            parse_count(self.path, f'the {name} of {what}', _line(stream).strip().decode('latin-1'))
            for name in _SHAPE
        )
        pose = [self._numbers(_line(stream), width, what) for width in _POSE]
        matrix = np.array(pose[-4:])
        if matrix[:, 3].tolist() != [0, 0, 0, 1]:
            must_be = 'with 0 0 0 1 as its last column'
            raise CloudError(f'the matrix of {what} of {self.path}', must_be, matrix[:, 3].tolist())
        offset = stream.tell()
        room = self.path.stat().st_size - offset + 1  # the last line may have no end
        for name, count in zip(_SHAPE, (columns, rows), strict=True):
            check_fits(self.path, f'the {name} of {what}', count, _SHORTEST, room)
        check_fits(self.path, f'the points of {what}', columns * rows, _SHORTEST, room)
        first = _next_line(stream)
        stream.seek(max(first, offset))
        width = len(_line(stream).split())
        if width not in _MISSING:
            must_be = 'of 4 or 7 numbers: x y z intensity [red green blue]'
            raise CloudError(f'the first point of {what} of {self.path}', must_be, width)
        lines = TextRows(
            self.path,
            offset,
            columns * rows,
            width,
            {name: (i, FLOAT) for i, name in enumerate(_NAMES[:width])},
            is_last=False,
            instead=_MISSING[width],
        )
        stream.seek(begin)
        header = stream.read(offset - begin)
        self._scans.append(_GridScan(header, columns * rows, matrix.T[:3], lines))
        stream.seek(lines.end())
        return width

    def _numbers(self, line: bytes, width: int, what: str) -> list[float]:
        """Read a line of a pose."""
        try:
            numbers = [parse_number(word.decode('latin-1')) for word in line.split()]
        except ValueError:
            numbers = []
        if len(numbers) != width or not np.isfinite(numbers).all():
            got = repr(line.strip()[:40].decode('latin-1'))
            must_be = f'of {width} finite numbers'
            raise CloudError(f'a line of the pose of {what} of {self.path}', must_be, got)
        return numbers

    def __len__(self) -> int:
        """Count the lines of all grids, missing returns among them."""
        return sum(scan.count for scan in self._scans)

    def read(self, names: Sequence[str]) -> Iterator[tuple[NDArray[Any], ...]]:
        """Read columns chunk by chunk; x, y and z of a missing return are NaN."""
        asked = list(dict.fromkeys([*'xyz', *names])) if {*'xyz'} & {*names} else list(names)
        for scan in self._scans:
            for chunk in scan.rows.read(asked):
                values = dict(zip(asked, chunk, strict=True))
                if asked[0] == 'x':
                    values |= zip('xyz', to_common_frame(chunk[:3], scan.pose), strict=True)
                yield tuple(values[name] for name in names)

    def copy(self, path: Path, change: Change) -> Iterator[int]:
        """Write a copy, in which each point that is left out is a missing return."""
        if change.added:
            must_be = 'left out: a line of PTX has no place for them'
            raise CloudError(f'the columns of {path}', must_be, ', '.join(change.added))
        done = 0
        with path.open('wb') as stream:
            for scan in self._scans:
                part = slice(done, done + scan.count)
                stream.write(scan.header)
                keep = None if change.keep is None else change.keep[part]
                for written in scan.rows.write(stream, Change(keep)):
                    yield done + written
                done = part.stop


def _next_line(stream: BinaryIO) -> int:
    """Find where the next line begins that is not empty; -1: there is none."""
    while line := stream.readline(_LONGEST):
        if not line.isspace():
            return stream.tell() - len(line)
    return -1


def _line(stream: BinaryIO) -> bytes:
    return stream.readline(_LONGEST)
