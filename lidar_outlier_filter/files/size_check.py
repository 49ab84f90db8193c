# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""One rule for all formats: what a header says is compared with the size of its file.

Readers ask here before they allocate memory or begin a loop. What cannot be in the file is refused,
and so is a count of points that is not that of the points that are there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lidar_outlier_filter.errors import CloudError

if TYPE_CHECKING:
    from pathlib import Path

_PART = 2**20  # bytes read at once
_MOST_DIGITS = 18  # of a number that is less than 2^63


def whole(path: Path, what: str, text: str) -> int:
    """Read a whole number of a header, or refuse it."""
    digits = text.removeprefix('-')
    if not (digits.isascii() and digits.isdigit() and len(digits) <= _MOST_DIGITS):
        raise CloudError(f'{what} of {path}', 'a whole number', repr(text[:40]))
    return int(text)


def check_fits(path: Path, what: str, count: int, each: int, size: int) -> None:
    """Refuse a count of things, of at least ``each`` bytes, that do not fit into ``size`` bytes.

    Things without a byte cannot be counted by their bytes: there may be as many as there are bytes.
    """
    most = max(0, size) // max(1, each)
    if not 0 <= count <= most:
        raise CloudError(f'{what} of {path}', f'from 0 to {most}, which it has room for', count)


def check_offset(path: Path, what: str, offset: int, low: int, high: int) -> None:
    """Refuse an offset (byte) that is not between two others, both of them included."""
    if not low <= offset <= high:
        raise CloudError(f'{what} of {path}', f'from byte {low} to byte {high}', offset)


def check_points(path: Path, said: int, each: int, begin: int, end: int) -> None:
    """Refuse points of ``each`` bytes that are more or fewer than lie between two offsets (bytes).

    Behind the points there may be zeros, with which some programs fill pages, or a rest that is
    shorter than a point.
    """
    if each <= 0:
        raise CloudError(f'the size of a point of {path}', 'at least 1 byte', each)
    found = max(0, end - begin) // each
    if found < said or (found > said and _is_written(path, begin + said * each, end)):
        check_count(path, said, found)


def _is_written(path: Path, begin: int, end: int) -> bool:
    """Return whether any byte between two offsets is not zero."""
    with path.open('rb') as stream:
        stream.seek(begin)
        while part := stream.read(min(_PART, end - stream.tell())):
            if part.count(0) < len(part):
                return True
    return False


def check_count(path: Path, said: int, found: int) -> None:
    """Refuse a file that has more or fewer points than it says."""
    if found != said:
        raise CloudError(f'the file {path}', f'of {said} points, as it says', f'{found}')
