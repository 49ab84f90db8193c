# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""PTX files of scanners on tripods: scans, each a full grid of lines behind the scanner's pose.

Lines are copied as the bytes that they are. A grid must stay whole, and readers count the numbers
of a line: so a point that is left out becomes a missing return, and no column is added.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.cloud_file import (
    Change,
    CloudFile,
    check_fits,
    parse_count,
    parse_number,
)
from lidar_outlier_filter.files.rows import TextRows, to_common_frame

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

_FLOAT = np.dtype(np.float64)
_NAMES = ('x', 'y', 'z', 'intensity', 'red', 'green', 'blue')
# The numbers of a line, and the line of a missing return as Leica's programs write it.
_MISSING = {4: b'0 0 0 0.5', 7: b'0 0 0 0.5 0 0 0'}
_SHORTEST = 8  # bytes of a line
_LONGEST = 1000  # bytes of a line of a header
_SHAPE = ('columns', 'rows')
_POSE = (3,) * 4 + (4,) * 4  # numbers of each line: position, three axes, matrix


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
            _NAMES[: min(widths, default=0)], _FLOAT
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
            {name: (i, _FLOAT) for i, name in enumerate(_NAMES[:width])},
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
