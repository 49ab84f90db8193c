# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How well the outliers were found: counted from the output of a run alone.

The clouds carry their truth in the fields ``label`` (a :class:`Cause`) and ``surface`` (a
:class:`Kind`), which the filter passes through.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from rich.table import Table
from rosbags.typesys import Stores, get_typestore

from lidar_outlier_filter.bags import Recording
from lidar_outlier_filter.cloud import is_empty, structured
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.evaluation.scene import Cause, Kind

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

CLEANED, OUTLIERS = '/cleaned', '/outliers'
LABEL, SURFACE = 'label', 'surface'
CODES = 256


class Share(NamedTuple):
    """How many of how many points were rejected."""

    rejected: int
    total: int

    def __add__(self, other: object) -> Share:
        """Count both together."""
        if not isinstance(other, Share):
            return NotImplemented
        return Share(self.rejected + other.rejected, self.total + other.total)

    @property
    def ratio(self) -> float:
        """Rejected ÷ total; NaN of nothing."""
        return self.rejected / self.total if self.total else math.nan


@dataclass(frozen=True)
class Confusion:
    """What was rejected: of the outliers by their cause, of the good points by what they lie on."""

    outliers: dict[Cause, Share]
    good: dict[Kind, Share]

    @property
    def found(self) -> int:
        """Outliers rejected."""
        return sum(share.rejected for share in self.outliers.values())

    @property
    def missed(self) -> int:
        """Outliers kept."""
        return sum(share.total for share in self.outliers.values()) - self.found

    @property
    def lost(self) -> int:
        """Good points rejected."""
        return sum(share.rejected for share in self.good.values())

    @property
    def kept(self) -> int:
        """Good points kept."""
        return sum(share.total for share in self.good.values()) - self.lost

    @property
    def precision(self) -> float:
        """Share of the rejected that are outliers; NaN if nothing was rejected."""
        return Share(self.found, self.found + self.lost).ratio

    @property
    def recall(self) -> float:
        """Share of the outliers that are rejected; NaN without outliers."""
        return Share(self.found, self.found + self.missed).ratio

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall; NaN with nothing to find and nothing rejected."""
        return Share(2 * self.found, 2 * self.found + self.lost + self.missed).ratio


def confusion(
    label: NDArray[np.uint8], surface: NDArray[np.uint8], rejected: NDArray[np.bool_]
) -> Confusion:
    """Compare a verdict with the truth, (N,) each."""
    return _from_counts(_count(label, surface, rejected))


def score(recording: Path, topic: str | None = None) -> Confusion:
    """Compare the answers in the output of a run with the truth they carry.

    Parameters
    ----------
    recording : output of a replay, or a recording of a live run
    topic : of the clouds that were filtered; None: the only one that was

    Raises
    ------
    RecordingError
        If the recording cannot be read, has no such answers, or they carry no truth.

    """
    counts = np.zeros((2, CODES, CODES), np.int64)
    for points, rejected in _answers(recording, topic):
        verdict = np.full(len(points), rejected)
        counts += _count(points[LABEL], points[SURFACE], verdict)
    return _from_counts(counts)


def read(recording: Path, topic: str | None = None) -> tuple[NDArray[np.void], NDArray[np.bool_]]:
    """Read all points of the answers, cleaned and outliers, and whether each was rejected."""
    answers = list(_answers(recording, topic))
    if not answers:
        raise RecordingError(f'the answers in {recording}', 'at least one point', 'none')
    points = np.concatenate([part for part, _ in answers])
    return points, np.concatenate([np.full(len(part), verdict) for part, verdict in answers])


def _answers(recording: Path, topic: str | None) -> Iterator[tuple[NDArray[np.void], bool]]:
    """Yield the points of every answer that has any, and whether it is of outliers."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with Recording(recording) as source:
        topic = _choose(source, topic)
        for channel, _, data in source.messages():
            if channel.name not in {topic + CLEANED, topic + OUTLIERS}:
                continue
            message = store.deserialize_cdr(data, channel.msgtype)
            if is_empty(message):
                continue
            points = structured(message).reshape(-1)
            names = points.dtype.names or ()
            for name in (LABEL, SURFACE):
                if name not in names or points.dtype[name] != np.uint8:
                    raise RecordingError(
                        f'the fields of {channel.name}', f'with a uint8 {name!r}', ', '.join(names)
                    )
            yield points, channel.name.endswith(OUTLIERS)


def _choose(source: Recording, topic: str | None) -> str:
    """Find the topic whose answers are to be scored."""
    names = {channel.name for channel in source.topics}
    filtered = [
        name.removesuffix(CLEANED)
        for name in sorted(names)
        if name.endswith(CLEANED) and name.removesuffix(CLEANED) + OUTLIERS in names
    ]
    if topic is None and len(filtered) == 1:
        return filtered[0]
    if topic is None or topic not in filtered:
        known = ', '.join(filtered) or 'none'
        must_be = f"one of those with '{CLEANED}' and '{OUTLIERS}' ({known})"
        raise RecordingError(f'the topic to score in {source.path}', must_be, repr(topic))
    return topic


def _count(
    label: NDArray[np.uint8], surface: NDArray[np.uint8], rejected: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Count points by verdict, label and surface: (2, 256, 256)."""
    code = (rejected.astype(np.int64) * CODES + label) * CODES + surface
    return np.bincount(code, minlength=2 * CODES * CODES).reshape(2, CODES, CODES)


def _from_counts(counts: NDArray[np.int64]) -> Confusion:
    known = counts.sum() == counts[:, : len(Cause), : len(Kind)].sum()
    if not known:
        must_be = f'below {len(Cause)} and {len(Kind)}'
        raise RecordingError('the labels and surfaces', must_be, 'others')
    bad = counts.sum(axis=2)
    good = counts[:, Cause.GOOD]
    return Confusion(
        {c: Share(int(bad[1, c]), int(bad[:, c].sum())) for c in Cause if c != Cause.GOOD},
        {k: Share(int(good[1, k]), int(good[:, k].sum())) for k in Kind},
    )


def table(results: Mapping[str, Confusion]) -> Table:
    """Lay out the confusion of one or several runs on the same recording, one column each."""
    answer = Table(title_justify='left', box=None, pad_edge=False, header_style='bold')
    answer.add_column('')
    for name in results:
        answer.add_column(name, justify='right')

    def row(name: str, texts: list[str], style: str = '') -> None:
        answer.add_row(name, *texts, style=style)

    runs = list(results.values())
    row('precision', [_percent(run.precision) for run in runs], 'bold')
    row('recall', [_percent(run.recall) for run in runs], 'bold')
    row('F1', [_percent(run.f1) for run in runs], 'bold')
    row('outliers found', [_share(Share(run.found, run.found + run.missed)) for run in runs])
    for cause in next(iter(results.values())).outliers if runs else ():
        if any(run.outliers[cause].total for run in runs):
            row(f'  {_name(cause)}', [_share(run.outliers[cause]) for run in runs], 'dim')
    row('good points lost', [_share(Share(run.lost, run.lost + run.kept)) for run in runs])
    for kind in runs[0].good if runs else ():
        if any(run.good[kind].total for run in runs):
            row(f'  {_name(kind)}', [_share(run.good[kind]) for run in runs], 'dim')
    return answer


def _name(code: Cause | Kind) -> str:
    return code.name.lower().replace('_', ' ')


def _percent(ratio: float) -> str:
    return '–' if math.isnan(ratio) else f'{100 * ratio:.2f} %'


def _share(share: Share) -> str:
    return f'{share.rejected} of {share.total}  {_percent(share.ratio):>8}'
