# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Tables that are text: CSV with any of the usual separators, with and without names on top.

Rows are copied as the bytes that they are; Python's own ``csv`` finds the numbers in them.
"""

from __future__ import annotations

import csv
from codecs import BOM_UTF8
from itertools import islice
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.cloud_file import CHUNK
from lidar_outlier_filter.files.rows import append, check_names

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from lidar_outlier_filter.files.cloud_file import Change

    Row = tuple[list[str], str]  # the fields, and the text that they were

_SEPARATORS = ',;\t| '
FLOAT = np.dtype(np.float64)
LONGEST_LINE = 1_000_000  # letters of the first line
EXACT = 2**53  # up to here a float64 holds every whole number


def open_file(path: Path, _table: str | None) -> TextFile:
    """Open a table that is text."""
    return TextFile(path)


class TextFile:
    """A table that is text; see :class:`CloudFile`.

    Without names on top the columns are called 1, 2, 3 and so on.
    """

    classes = False
    metres: Mapping[str, float] = MappingProxyType({})
    whole = ''

    def __init__(self, path: Path) -> None:
        """Find the separator, the names, and how many rows there are."""
        self.path = path
        with path.open('rb') as raw:
            self._mark = raw.read(len(BOM_UTF8)) == BOM_UTF8
        with self._open() as stream:
            first = stream.readline(LONGEST_LINE)
        if len(first) == LONGEST_LINE:
            must_be = f'of fewer than {LONGEST_LINE} letters'
            raise CloudError(f'the first line of {path}', must_be, 'more')
        # The one that makes the most of the first line.
        self._separator = max(_SEPARATORS, key=lambda mark: len(_split(first, mark)))
        names = _split(first, self._separator)
        self._has_names = bool(names) and not all(_is_number(name) for name in names)
        if not self._has_names:
            names = [str(i + 1) for i in range(len(names))]
        check_names(path, names)
        self._width = len(names)
        with self._open() as stream:
            first_row, _ = next(self._rows(stream), ([], ''))
        with self._open() as stream:
            self._count = sum(1 for _ in self._rows(stream))
        self._places = {
            name: place
            for place, (name, text) in enumerate(zip(names, first_row, strict=False))
            if not text or _is_number(text)
        }
        self.columns: Mapping[str, np.dtype[Any]] = dict.fromkeys(self._places, FLOAT)

    def _open(self) -> TextIO:
        # What is no UTF-8 comes out again as it went in; a byte order mark belongs to no column.
        return self.path.open(encoding='utf-8-sig', errors='surrogateescape', newline='')

    def _rows(self, stream: TextIO) -> Iterator[Row]:
        """Yield the rows, each with the text that it was; empty lines are none."""
        text: list[str] = []

        def noted() -> Iterator[str]:
            for line in stream:
                text.append(line)
                yield line

        reader = csv.reader(noted(), delimiter=self._separator, skipinitialspace=True, strict=True)
        if self._has_names:
            next(reader)
        text.clear()
        for fields in reader:
            if fields and any(fields):
                yield fields, ''.join(text)
            text.clear()

    def _chunks(self, stream: TextIO) -> Iterator[list[Row]]:
        rows = self._rows(stream)
        while chunk := list(islice(rows, CHUNK)):
            yield chunk

    def __len__(self) -> int:
        """Count the points."""
        return self._count

    def read(self, names: Sequence[str]) -> Iterator[tuple[NDArray[Any], ...]]:
        """Read columns chunk by chunk; an empty field is missing."""
        places = [self._places[name] for name in names]
        done = 0
        with self._open() as stream:
            for rows in self._chunks(stream):
                table = [np.empty(len(rows)) for _ in names]
                for i, (fields, _) in enumerate(rows):
                    if len(fields) < self._width:
                        what = f'row {done + i + 1} of {self.path}'
                        raise CloudError(what, f'of {self._width} fields', len(fields))
                    for column, place in zip(table, places, strict=True):
                        column[i] = self._number(fields[place], done + i)
                done += len(rows)
                yield tuple(
                    _exact(column, [fields[place] for fields, _ in rows])
                    for column, place in zip(table, places, strict=True)
                )

    def _number(self, text: str, row: int) -> float:
        try:
            return float(text) if text and not text.isspace() else np.nan
        except ValueError:
            what = f'row {row + 1} of {self.path}'
            raise CloudError(what, 'of numbers', repr(text)) from None

    def copy(self, path: Path, change: Change) -> Iterator[int]:
        """Write a copy: the rows as they are, with more fields or without some of the rows."""
        done = 0
        mark = self._separator.encode()
        with self._open() as stream, path.open('wb') as output:
            output.write(BOM_UTF8 if self._mark else b'')
            if self._has_names:
                head = self._head()
                names = self._separator.join(['', *change.added])
                held = head.rstrip('\r\n')
                output.write(_bytes(held + names + head[len(held) :]))
            for rows in self._chunks(stream):
                part = slice(done, done + len(rows))
                added = [values[part].tolist() for values in change.added.values()]
                keep = [True] * len(rows) if change.keep is None else change.keep[part].tolist()
                for (_, text), stays, *values in zip(rows, keep, *added, strict=True):
                    if stays:
                        output.write(append(_bytes(text), mark, values))
                done = part.stop
                yield done

    def _head(self) -> str:
        """Return the text of the line with the names."""
        with self._open() as stream:
            return stream.readline()


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


def _split(line: str, mark: str) -> list[str]:
    return next(csv.reader([line.rstrip('\r\n')], delimiter=mark, skipinitialspace=True), [])


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _bytes(text: str) -> bytes:
    return text.encode('utf-8', 'surrogateescape')
