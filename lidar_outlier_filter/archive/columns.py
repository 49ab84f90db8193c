# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The columns of an archive's table, on its page and in the terminal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from lidar_outlier_filter.archive.oddness import percent, share

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from lidar_outlier_filter.archive.oddness import ArchiveRow


@dataclass(frozen=True)
class Column:
    """A number of each recording or file.

    Attributes
    ----------
    name : its heading
    value : of a row
    text : of a value
    is_rare : whether a terminal omits it if all values are 0

    """

    name: str
    value: Callable[[ArchiveRow], float]
    text: Callable[[float], str]
    is_rare: bool = False


def length(seconds: float) -> str:
    """Write a time in hours, minutes or seconds."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f'{hours:,} h {minutes:02} min'
    return f'{minutes} min {rest:02} s' if minutes else f'{seconds:.3g} s'


def _count(name: str, key: str = '', *, is_rare: bool = False) -> Column:
    return Column(name, lambda row: row.sums[key or name], '{:,}'.format, is_rare)


POINTS, UNTESTED = _count('points'), Column('untested', lambda r: r.of_points('untested'), percent)
REJECTED = Column('rejected', lambda row: row.of_points('rejected'), percent)
OF_RECORDINGS = (
    Column('length', lambda row: row.record.duration, length),
    _count('clouds', 'messages'),
    _count('refused', is_rare=True),
    _count('gaps', is_rare=True),
    POINTS,
    REJECTED,
    UNTESTED,
    Column(
        '× real time',
        lambda row: share(row.record.duration, row.record.seconds),
        '{:.1f}'.format,
    ),
)
OF_FILES = (POINTS, REJECTED, UNTESTED)


def on_page(what: str) -> Sequence[Column]:
    """Return the columns of the page."""
    return OF_RECORDINGS if what == 'recording' else OF_FILES


def in_terminal(rows: Sequence[ArchiveRow], what: str) -> list[Column]:
    """Return the columns of a terminal, where files have counts, also by detector."""
    columns: list[Column] = [*OF_RECORDINGS]
    if what == 'file':
        names = dict.fromkeys(name for row in rows for name in row.rejected_by)
        columns = [
            POINTS,
            *(_count(name, is_rare=True) for name in ('invalid', 'ignored', 'untested', 'spared')),
            _count('rejected'),
            Column('share', lambda row: row.of_points('rejected'), '{:.3%}'.format),
            *(_by(name) for name in names if len(names) > 1),
            Column('seconds', lambda row: row.record.seconds, '{:.1f}'.format),
        ]
    return [one for one in columns if not one.is_rare or any(map(one.value, rows))]


def _by(name: str) -> Column:
    return Column(f'by {name}', lambda row: row.rejected_by[name], '{:,}'.format)
