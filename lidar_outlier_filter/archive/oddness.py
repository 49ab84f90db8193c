# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Which recordings of an archive are odd: their shares against the medians of all recordings."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from numpy.typing import NDArray

LIMIT = 3.5  # robust z from which on a share is odd
FEWEST = 5  # recordings to compare
SIGMA = 1.4826  # standard deviation of a normal distribution, in median absolute deviations
# The least deviation that is assumed, as a share: where most recordings have the same, any other
# would be infinitely odd.
LEAST_OF_POINTS, LEAST_OF_CLOUDS = 1e-4, 1e-3
OF_FILES = ('invalid', 'ignored', 'spared')
SUMMED = ('messages', 'points', 'rejected', 'untested', 'refused', 'gaps', *OF_FILES)


@dataclass
class DriveCounts:
    """A recording or a file of the archive: the sums over its topics, and what is odd about it.

    ``error`` says why there is no output: it failed, or, with ``empty``, it has no clouds. ``odd``
    has a sentence for each oddness; ``z`` is the largest robust z by its absolute value. ``how`` is
    the version, and the hash of the parameters.
    """

    source: str
    output: str
    error: str | None
    size: int
    seconds: float
    duration: float
    unread: int
    lost: Sequence[str]
    empty: bool = False
    finished: str = ''
    how: tuple[str, str] = ('', '')
    messages: int = 0
    points: int = 0
    rejected: int = 0
    untested: int = 0
    refused: int = 0
    gaps: int = 0
    invalid: int = 0
    ignored: int = 0
    spared: int = 0
    rejected_by: Counter[str] = field(default_factory=Counter)
    untested_because: dict[str, str] = field(default_factory=dict)
    odd: list[str] = field(default_factory=list)
    z: float = 0.0

    @property
    def done(self) -> bool:
        """Whether there is an output."""
        return self.error is None

    @property
    def failed(self) -> bool:
        """Whether there should be an output, and is none."""
        return not self.done and not self.empty

    @property
    def lacks(self) -> list[str]:
        """What is missing in the output, a sentence each."""
        found = []
        if self.unread:
            found.append(f'{self.unread:,} messages not found in the recording')
        if self.lost:
            found.append(f'{len(self.lost):,} losses, the first: {self.lost[0]}')
        if self.refused:
            found.append(f'{self.refused:,} of {self.messages:,} clouds refused')
        for topic, reason in self.untested_because.items():
            found.append(f'no point of {topic} could be tested: {reason}')
        return found


@dataclass(frozen=True)
class _Share:
    """A share that is compared: what it says in a sentence, and how it is computed."""

    text: str
    least: float
    of: Callable[[DriveCounts], float]


def drives(entries: Iterable[Mapping[str, Any]]) -> list[DriveCounts]:
    """Sum up the lines of a manifest, the oddest first.

    Those that failed come first, then those that lack something, then by ``z``.
    """
    found = [counts_of(entry) for entry in entries]
    done = [drive for drive in found if drive.done]
    if len(done) >= FEWEST:
        for share in _shares(done):
            _compare(done, share)
    for drive in done:
        drive.odd[:0] = drive.lacks
    return sorted(found, key=_order)


def robust_z(values: NDArray[np.float64], least: float) -> NDArray[np.float64]:
    """Give the distances from the median, in deviations that outliers hardly change.

    Parameters
    ----------
    values : to compare
    least : the least deviation that is assumed

    """
    distance = values - np.median(values)
    deviation = SIGMA * np.median(np.abs(distance))
    result: NDArray[np.float64] = distance / max(deviation, least)
    return result


def counts_of(entry: Mapping[str, Any]) -> DriveCounts:
    """Sum up a line of a manifest."""
    without = entry['state'] != 'done'
    drive = DriveCounts(
        entry['source'],
        entry['output'],
        (entry.get('error') or 'no reason is known') if without else None,
        entry['size'],
        entry['seconds'],
        entry['duration'],
        entry.get('unread', 0),
        entry.get('lost', ()),
        entry['state'] == 'no clouds',
        entry.get('finished', ''),
        (entry.get('version', ''), entry.get('parameters', '')),
    )
    for topic, counts in entry['topics'].items():
        for name in SUMMED:
            setattr(drive, name, getattr(drive, name) + counts.get(name, 0))
        drive.rejected_by.update(counts['rejected_by'])
        if reason := counts.get('untested_because'):
            drive.untested_because[topic] = reason
    return drive


def _shares(done: Sequence[DriveCounts]) -> list[_Share]:
    """List what is compared; a single detector rejects what all reject."""
    detectors = sorted({name for drive in done for name in drive.rejected_by})
    each = [
        _Share(
            f'of the points rejected by {name}',
            LEAST_OF_POINTS,
            lambda drive, name=name: share(drive.rejected_by[name], drive.points),  # type: ignore[misc]
        )
        for name in detectors
        if len(detectors) > 1
    ]
    return [
        _Share('of the points rejected', LEAST_OF_POINTS, lambda d: share(d.rejected, d.points)),
        *each,
        _Share('of the points untested', LEAST_OF_POINTS, lambda d: share(d.untested, d.points)),
        _Share('of the clouds after a gap', LEAST_OF_CLOUDS, lambda d: share(d.gaps, d.messages)),
    ]


def _compare(done: Sequence[DriveCounts], compared: _Share) -> None:
    """Say of each recording if one of its shares is odd."""
    values = np.array([compared.of(drive) for drive in done])
    median = percent(float(np.median(values)))
    for drive, value, z in zip(done, values, robust_z(values, compared.least), strict=True):
        if abs(z) > abs(drive.z):
            drive.z = float(z)
        if abs(z) >= LIMIT:
            drive.odd.append(f'{percent(value)} {compared.text}, median {median} (z {signed(z)})')


def _order(drive: DriveCounts) -> tuple[bool, bool, float, str]:
    return not drive.failed, not drive.lacks, -abs(drive.z), drive.source


def share(part: float, whole: float) -> float:
    """Divide; nothing of nothing is 0."""
    return part / whole if whole else 0.0


def signed(z: float) -> str:
    """Write a robust z with its sign, and three digits that count or all before the point."""
    text = f'{z:+.3g}' if abs(z) < 1000 else f'{z:+,.0f}'  # noqa: PLR2004  digits
    return text.replace('-', '−')


def percent(value: float) -> str:
    """Write a share in percent, with three digits that count."""
    return f'{100 * value:.3g} %'
