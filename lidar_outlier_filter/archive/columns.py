# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The columns of an archive's table, on its page and in the terminal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from lidar_outlier_filter.archive.oddness import percent, share

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from lidar_outlier_filter.archive.oddness import DriveCounts


@dataclass(frozen=True)
class Column:
    """A number of each recording or file.

    Attributes
    ----------
    name : above it
    value : of a recording or a file
    text : of a value, on the page
    format : of a value, in the terminal; empty: the terminal has no such column
    is_of_files : whether files have it, too: each is one cloud
    is_rare : whether the terminal leaves it out where all are 0

    """

    name: str
    value: Callable[[DriveCounts], float]
    text: Callable[[float], str]
    format: str = ''
    is_of_files: bool = False
    is_rare: bool = False

    def is_of(self, what: str) -> bool:
        """Return whether it is of ``what``: a recording or a file."""
        return self.is_of_files or what == 'recording'


def length(seconds: float) -> str:
    """Write a time as people do."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f'{hours:,} h {minutes:02} min'
    return f'{minutes} min {rest:02} s' if minutes else f'{seconds:.3g} s'


def _whole(value: float) -> str:
    return f'{value:,}'


def _one_decimal(value: float) -> str:
    return f'{value:.1f}'


def rejected(drive: DriveCounts) -> float:
    """Return the share of the points that is rejected."""
    return share(drive.rejected, drive.points)


REJECTED = Column('rejected', rejected, percent, '.2%', is_of_files=True)
COLUMNS = (
    Column('length', lambda drive: drive.duration, length),
    Column('clouds', lambda drive: drive.messages, _whole, ','),
    Column('refused', lambda drive: drive.refused, _whole, ',', is_rare=True),
    Column('gaps', lambda drive: drive.gaps, _whole, ',', is_rare=True),
    Column('points', lambda drive: drive.points, _whole, ',', is_of_files=True),
    REJECTED,
    Column(
        'untested',
        lambda drive: share(drive.untested, drive.points),
        percent,
        '.2%',
        is_of_files=True,
    ),
    Column('× real time', lambda drive: share(drive.duration, drive.seconds), _one_decimal, '.1f'),
)


# In a terminal.
OF_FILES = (
    Column('points', lambda drive: drive.points, _whole, ','),
    *(
        Column(name, lambda drive, name=name: getattr(drive, name), _whole, ',', is_rare=True)  # type: ignore[misc]
        for name in ('invalid', 'ignored', 'untested', 'spared')
    ),
    Column('rejected', lambda drive: drive.rejected, _whole, ','),
    Column('share', rejected, percent, '.3%'),
)
SECONDS = Column('seconds', lambda drive: drive.seconds, _one_decimal, '.1f')


def in_terminal(drives: Iterable[DriveCounts], what: str) -> list[Column]:
    """List the columns that a terminal shows of some recordings or files."""
    some = list(drives)
    columns = [column for column in COLUMNS if column.format]
    if what == 'file':
        columns = [*OF_FILES, *_by_detector(some), SECONDS]
    return [one for one in columns if not (one.is_rare and not any(map(one.value, some)))]


def _by_detector(drives: Iterable[DriveCounts]) -> list[Column]:
    """List what each detector rejects; a single one rejects what all reject."""
    names = dict.fromkeys(name for drive in drives for name in drive.rejected_by)
    return [
        Column(f'by {name}', lambda drive, name=name: drive.rejected_by[name], _whole, ',')  # type: ignore[misc]
        for name in names
        if len(names) > 1
    ]
