# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Formats that are text: CSV with any of the usual separators, and PTX of scanners on tripods.

Lines are copied as the bytes that they are. Python's own ``csv`` finds the numbers of a table, with
and without names on top. A PTX file has scans, each a full grid of lines behind the scanner's pose.
A grid must stay whole, and readers count the numbers of a line: so a point that is left out becomes
a missing return, and no column is added.
"""

import csv
import re
from codecs import BOM_UTF8
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.cloud_file import (
    FORMATS,
    Change,
    CloudFile,
    check_fits,
    check_names,
    parse_count,
    parse_number,
)
from lidar_outlier_filter.files.rows import RowFile, TextRows, append, to_common_frame

_SEPARATORS = ',;\t| '
_COMMENTS = (b'#', b'//')
MAX_COMMENTS = 1000  # lines
FLOAT = np.dtype(np.float64)
MAX_LINE_BYTES = 1_000_000  # bytes of the first lines
EXACT_FLOAT64 = 2**53  # up to here a float64 holds every whole number

# As programs write them: quoted, with the exponent of Fortran, or with a comma.
_WORD = re.compile(rb'[^\s,;|"\']+')
_NUMBER = re.compile(rb'[-+]?(\d+\.?\d*|\.\d+)([eEdD][-+]?\d+)?')
_FIRST_LINES = 20  # of a table, after which its rows have begun

# PTX
_NAMES = ('x', 'y', 'z', 'intensity', 'red', 'green', 'blue')
# The numbers of a line, and the line of a missing return as Leica's programs write it.
_MISSING = {4: b'0 0 0 0.5', 7: b'0 0 0 0.5 0 0 0'}
_MIN_LINE_BYTES = 8  # bytes of a line
_MAX_HEADER_LINE_BYTES = 1000  # bytes of a line of a header
_SHAPE = ('columns', 'rows')
_POSE = (3,) * 4 + (4,) * 4  # numbers of each line: position, three axes, matrix


def is_prose(path: Path) -> bool:
    """Return whether a file named as a table is prose, so that no reader need try it.

    It is a table that has a number in its first two rows, however it is written, or a row of
    numbers in its first ones; what is not ASCII text at all is not prose either.
    """
    if FORMATS.get(path.suffix.lower(), ('',))[0] != 'text':
        return False
    with path.open('rb') as stream:
        lines = [stream.readline(MAX_LINE_BYTES) for _ in range(_FIRST_LINES)]
    if any(b'\0' in line for line in lines):  # UTF-16, or binary
        return False
    lines = [line for line in lines if not line.lower().startswith(b'sep=')]
    rows = [_WORD.findall(line.removeprefix(BOM_UTF8)) for line in lines]
    counts = [sum(map(bool, map(_NUMBER.fullmatch, row))) for row in rows]
    is_row = any(count > max(1, len(row) / 2) for count, row in zip(counts, rows, strict=True))
    return not is_row and not any(counts[:2])


class TextFile(RowFile):
    """A table that is text; see :class:`CloudFile`. Each row is one line.

    Without names on top the columns are called 1, 2, 3 and so on.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with path.open('rb') as stream:
            mark = BOM_UTF8 if stream.read(len(BOM_UTF8)) == BOM_UTF8 else b''
            stream.seek(len(mark))
            comments = [stream.readline(MAX_LINE_BYTES)]
            while comments[-1].startswith(_COMMENTS) and len(comments) < MAX_COMMENTS:
                comments.append(stream.readline(MAX_LINE_BYTES))
            first = comments.pop()
        # The separator that splits the first line into the most fields.
        separators = [mark.encode() for mark in _SEPARATORS]
        self._separator = separator = max(
            separators, key=lambda one: len(_fields(first, one, strict=False))
        )
        names = _fields(first, separator, strict=False)
        has_names = not all(map(_is_number, names))
        self._header = [mark, *comments, first] if has_names else [mark, *comments]
        if not has_names:
            count, last = len(names), comments[-1:]
            names = next((found for line in last if (found := _names_in(line, count))), [])
            has_names = bool(names)
            names = names or [str(i + 1) for i in range(count)]
        self._has_names = has_names
        check_names(path, names)
        self._rows = _TableRows(path, sum(map(len, self._header)), names, separator)
        self._count, _ = self._rows.measure()
        fields = _fields(next(self._rows.chunks(), [b''])[0], separator)
        self.columns: Mapping[str, np.dtype[Any]] = {
            name: FLOAT
            for name, text in zip(names, fields, strict=False)
            if not text.strip() or _is_number(text)
        }

    def _changed_header(self, change: Change) -> Iterator[bytes]:
        *before, last = self._header
        yield from before
        yield append(last, self._separator, list(change.added)) if self._has_names else last


class _TableRows(TextRows):
    """Rows with a separator between their fields, which may be quoted or empty."""

    def __init__(self, path: Path, offset: int, names: Sequence[str], separator: bytes) -> None:
        columns = {name: (i, FLOAT) for i, name in enumerate(names)}
        super().__init__(path, offset, None, len(names), columns, separator=separator)

    def read(self, names: Sequence[str]) -> Iterator[tuple[NDArray[Any], ...]]:
        """Read columns chunk by chunk; an empty field is missing."""
        done = 0
        for lines in self.chunks():
            rows = [_fields(line, self._separator) for line in lines]
            self.check_widths(done, list(map(len, rows)))
            indices = [self._columns[name][0] for name in names]
            yield tuple(self._column([row[i] for row in rows], done) for i in indices)
            done += len(rows)

    def _column(self, texts: Sequence[str], done: int) -> NDArray[Any]:
        """Parse a column; a refusal names the number of the point."""
        numbers = np.empty(len(texts))
        for i, text in enumerate(texts):
            try:
                numbers[i] = parse_number(text) if text.strip() else np.nan
            except ValueError:
                what = f'point {done + i + 1} of {self._path}'
                raise CloudError(what, 'of numbers', repr(text)) from None
        return _exact(numbers, texts)


def _fields(line: bytes, separator: bytes, *, strict: bool = True) -> list[str]:
    *_, last = line.rstrip(b'\r\n').rsplit(b'\n', 1)  # blank lines come before it
    mark, text = separator.decode(), last.decode('utf-8', 'surrogateescape')
    if mark == ' ':
        text = text.rstrip()
    return next(csv.reader([text], delimiter=mark, skipinitialspace=True, strict=strict), [])


def _names_in(comment: bytes, count: int) -> list[str]:
    """Return the names of so many columns in a comment, such as ``//X Y Z``; else none."""
    line = comment.lstrip(b'#/ ')
    for separator in _SEPARATORS:
        names = _fields(line, separator.encode(), strict=False)
        if len(names) == count and not any(map(_is_number, names)):
            return [name or '#' for name in names]
    return []


def _exact(numbers: Floats, texts: Sequence[str]) -> NDArray[Any]:
    """Return numbers as exact int64 if all are whole; NaN are masked then."""
    missing = np.isnan(numbers)
    known = numbers[~missing]
    if not (np.isfinite(known).all() and (known == np.floor(known)).all()):
        return numbers
    large = np.abs(numbers) >= EXACT_FLOAT64
    whole = np.where(missing | large, 0, numbers).astype(np.int64)
    try:
        for i in np.flatnonzero(large).tolist():
            whole[i] = int(texts[i])
    except (ValueError, OverflowError):  # such as 1e300
        return numbers
    return np.ma.MaskedArray(whole, missing) if missing.any() else whole


def _is_number(text: str) -> bool:
    try:
        parse_number(text)
    except ValueError:
        return False
    return True


@dataclass(frozen=True)
class _GridScan:
    """One scan: its header as it is, its count of lines, its pose (3, 4), and its lines."""

    header: bytes
    count: int
    pose: Floats
    rows: TextRows


class PtxFile(CloudFile):
    """A PTX file; see :class:`CloudFile`. Points of all scans are in their common frame."""

    gaps = True

    def __init__(self, path: Path) -> None:
        """Find the scans, and check that each has all of its lines."""
        self.path = path
        self._scans: list[_GridScan] = []
        self.grids: list[tuple[int, int]] = []
        widths: set[int] = set()
        with path.open('rb') as stream:
            while (begin := _next_line(stream)) >= 0:
                stream.seek(begin)
                width = self._add_scan(stream)
                widths.add(width)
        self._count = sum(scan.count for scan in self._scans)
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
            check_fits(self.path, f'the {name} of {what}', count, _MIN_LINE_BYTES, room)
        check_fits(self.path, f'the points of {what}', columns * rows, _MIN_LINE_BYTES, room)
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
        self.grids.append((columns, rows))
        self._scans.append(_GridScan(header, columns * rows, matrix.T[:3], lines))
        stream.seek(lines.measure()[1])
        return width

    def _numbers(self, line: bytes, width: int, what: str) -> list[float]:
        try:
            numbers = [parse_number(word.decode('latin-1')) for word in line.split()]
        except ValueError:
            numbers = []
        if len(numbers) != width or not np.isfinite(numbers).all():
            got = repr(line.strip()[:40].decode('latin-1'))
            must_be = f'of {width} finite numbers'
            raise CloudError(f'a line of the pose of {what} of {self.path}', must_be, got)
        return numbers

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
    """Find where the next line begins that is not empty; -1: no such line."""
    while line := stream.readline(_MAX_HEADER_LINE_BYTES):
        if not line.isspace():
            return stream.tell() - len(line)
    return -1


def _line(stream: BinaryIO) -> bytes:
    return stream.readline(_MAX_HEADER_LINE_BYTES)
