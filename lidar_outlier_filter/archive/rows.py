# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The rows and columns of an archive's table: sums of the counts, and what is odd about each.

A recording is odd if a share of it is far from the median of all recordings.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from lidar_outlier_filter.archive.sidecar import ArchiveRecord
from lidar_outlier_filter.core.annotations import Floats

LIMIT = 3.5  # absolute robust z of an odd share
MIN_COMPARED = 5  # recordings
SIGMA = 1.4826  # standard deviation of a normal distribution per median absolute deviation
# Smallest deviation that is assumed, as a share: otherwise, where most recordings have the same
# share, any other would be infinitely odd.
MIN_OF_POINTS, MIN_OF_CLOUDS = 1e-4, 1e-3


@dataclass
class ArchiveRow:
    """A recording or file: its record, sums over its topics, and what is odd about it.

    Attributes
    ----------
    record : of its sidecar
    sums : of each count
    rejected_by : points by detector
    odd : a sentence for each oddness
    z : the robust z-score of largest magnitude

    """

    record: ArchiveRecord
    sums: Counter[str] = field(default_factory=Counter)
    rejected_by: Counter[str] = field(default_factory=Counter)
    odd: list[str] = field(default_factory=list)
    z: float = 0.0

    def __post_init__(self) -> None:
        """Sum the counts of all topics."""
        for counts in self.record.topics.values():
            self.sums.update({k: v for k, v in counts.items() if isinstance(v, int)})
            self.rejected_by.update(counts['rejected_by'])

    def of_points(self, name: str) -> float:
        """Return a count as a share of the points."""
        return share(self.sums[name], self.sums['points'])

    @property
    def lacks(self) -> list[str]:
        """What is missing in the output, a sentence each."""
        record, found = self.record, []
        if record.unread:
            found.append(f'{record.unread:,} messages not found in the recording')
        if record.lost:
            found.append(f'{len(record.lost):,} losses, the first: {record.lost[0]}')
        if self.sums['refused']:
            clouds = f'{self.sums["refused"]:,} of {self.sums["messages"]:,} clouds'
            found.append(f'{clouds} refused')
        for topic, reason in record.untested.items():
            found.append(f'no point of {topic} could be tested: {reason}')
        return found


def compare(records: Iterable[ArchiveRecord]) -> list[ArchiveRow]:
    """Make a row for each record: failed ones first, then incomplete ones, then by ``z``."""
    rows = [ArchiveRow(record) for record in records]
    done = [row for row in rows if row.record.is_done]
    for text, least, shares in _shares(done) if len(done) >= MIN_COMPARED else ():
        values = np.array(shares)
        median = percent(float(np.median(values)))
        for row, one, z in zip(done, values, robust_z(values, least), strict=True):
            if abs(z) > abs(row.z):
                row.z = float(z)
            if abs(z) >= LIMIT:
                row.odd.append(f'{percent(one)} {text}, median {median} (z {signed(z)})')
    for row in done:
        row.odd[:0] = row.lacks
    return sorted(
        rows,
        key=lambda row: (not row.record.is_failed, not row.lacks, -abs(row.z), row.record.source),
    )


def robust_z(values: Floats, least: float) -> Floats:
    """Return distances from the median in robust deviations, of which ``least`` is assumed."""
    distance = values - np.median(values)
    deviation = SIGMA * np.median(np.abs(distance))
    result: Floats = distance / max(deviation, least)
    return result


def _shares(done: Sequence[ArchiveRow]) -> Iterator[tuple[str, float, list[float]]]:
    """Give the shares that are compared: a text, the smallest deviation, and a value for each row.

    A single detector rejects what all reject.
    """
    of_points = 'of the points rejected'
    yield of_points, MIN_OF_POINTS, [row.of_points('rejected') for row in done]
    names = sorted({name for row in done for name in row.rejected_by})
    for name in names if len(names) > 1 else ():
        each = [share(row.rejected_by[name], row.sums['points']) for row in done]
        yield f'{of_points} by {name}', MIN_OF_POINTS, each
    yield 'of the points untested', MIN_OF_POINTS, [row.of_points('untested') for row in done]
    gaps = [share(row.sums['gaps'], row.sums['messages']) for row in done]
    yield 'of the clouds after a gap', MIN_OF_CLOUDS, gaps


def share(part: float, whole: float) -> float:
    """Divide; nothing of nothing is 0."""
    return part / whole if whole else 0.0


def signed(z: float) -> str:
    """Write a robust z with its sign and three significant digits, or all before the point."""
    text = f'{z:+.3g}' if abs(z) < 1000 else f'{z:+,.0f}'  # noqa: PLR2004  digits
    return text.replace('-', '−')


def percent(value: float) -> str:
    """Write a share in percent with three significant digits."""
    return f'{100 * value:.3g} %'


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
        '× real time', lambda row: share(row.record.duration, row.record.seconds), '{:.1f}'.format
    ),
)
OF_FILES = (POINTS, REJECTED, UNTESTED)


def in_terminal(rows: Sequence[ArchiveRow], what: str) -> list[Column]:
    """Return the columns of a terminal, where files have counts."""
    columns: list[Column] = [*OF_RECORDINGS]
    if what == 'file':
        columns = [
            POINTS,
            *(_count(name, is_rare=True) for name in ('invalid', 'ignored', 'untested', 'spared')),
            _count('rejected'),
            Column('share', REJECTED.value, lambda share: f'{100 * share:.3f} %'),
            Column('seconds', lambda row: row.record.seconds, '{:.1f}'.format),
        ]
    return [one for one in columns if not one.is_rare or any(map(one.value, rows))]
