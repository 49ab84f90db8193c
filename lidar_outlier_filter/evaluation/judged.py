# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Points of which the truth and the verdict are both known: from the output of a run, or files.

Missing returns (NaN, Inf, 0 0 0), and what stands in an organised cloud for a point that was
rejected, are no points: they are left out.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from lidar_outlier_filter.core.points.points import is_return
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.evaluation.labels import (
    ALL_BUT_0,
    CLASSIFICATION,
    LABEL,
    LAS_NOISE,
    Codes,
    Joiner,
    column_names,
    read_codes,
    read_column,
    usual_column,
    words,
)
from lidar_outlier_filter.messages.cloud import AXES, DETECTORS, SCORE
from lidar_outlier_filter.messages.truth import Cause
from lidar_outlier_filter.pipeline.topics import CLEANED, CLOUD, OUTLIERS
from lidar_outlier_filter.recordings.bags import Recording

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from lidar_outlier_filter.evaluation.labels import JoinedAnswer

SURFACE, OUTLIER = 'surface', 'outlier'
# What the label of a simulated drive says.
CAUSES = Codes(names={cause: words(cause.name) for cause in Cause})


@dataclass(frozen=True)
class Judged:
    """N points with truth and verdict.

    Attributes
    ----------
    code : (N,) int64
        Truth: the code of its cause or class.
    bad : (N,) bool
        Truth: whether the point is an outlier.
    rejected : (N,) bool
        Verdict.
    index : (N,) int64
        Number of the cloud in its recording, or of the point in its file.
    score : (N,) float or None
        Largest score; NaN where untested.
    detectors : (N,) uint16 or None
        Bits of the detectors that rejected the point.
    range : (N,) float64 or None
        Distance from the origin of the cloud's frame, metres.
    surface : (N,) uint8 or None
        What the point lies on, in simulated drives.

    """

    code: NDArray[np.int64]
    bad: NDArray[np.bool_]
    rejected: NDArray[np.bool_]
    index: NDArray[np.int64]
    score: NDArray[np.floating] | None = None
    detectors: NDArray[np.uint16] | None = None
    range: NDArray[np.float64] | None = None
    surface: NDArray[np.uint8] | None = None

    def __len__(self) -> int:
        """Count the points."""
        return len(self.code)

    def take(self, part: NDArray[np.bool_] | NDArray[np.intp]) -> Judged:
        """Choose points by mask or index."""
        chosen: dict[str, Any] = {
            field.name: None if (column := getattr(self, field.name)) is None else column[part]
            for field in fields(self)
        }
        return Judged(**chosen)

    def stretch(self, count: int) -> tuple[NDArray[np.int64], int]:
        """Cut what was judged into so many stretches, or as many as there are clouds.

        Returns the number of each point's stretch, and how many there are.
        """
        length = int(self.index.max()) + 1 if len(self) else 1
        count = min(count, length)
        return self.index * count // length, count


def read_recording(
    recording: Path,
    topic: str | None = None,
    label: str = '',
    codes: Codes = CAUSES,
    files: Sequence[Path] = (),
) -> Judged:
    """Read the answers in the output of a run, and the truth they carry or that files hold.

    Parameters
    ----------
    recording : output of a replay, or a recording of a live run
    topic : of the clouds that were filtered; None: the only one that was
    label : field with the truth, or column of the files; empty: ``label``, and in files
        ``classification`` first
    codes : what its values mean
    files : one for each cloud, in order; none: the truth is a field of the clouds

    Raises
    ------
    RecordingError
        If the recording cannot be read, has no such answers, or no truth for them.

    """
    parts = []
    for answer in answers(recording, topic, label, files):
        parts.append(_part(answer))
        first, this = parts[0], parts[-1]
        if (first.score is None, first.surface is None) != (
            this.score is None,
            this.surface is None,
        ):
            raise RecordingError(
                f'the fields of the answers in {recording}', 'the same in all', 'others'
            )
    if not parts:
        raise RecordingError(f'the answers in {recording}', 'at least one point', 'none')
    columns: dict[str, Any] = {}
    for field in fields(Judged):
        columns[field.name] = None
        if getattr(parts[0], field.name) is not None:
            columns[field.name] = np.concatenate([getattr(part, field.name) for part in parts])
    return _with_truth(Judged(**columns), codes)


def answers(
    recording: Path, topic: str | None, label: str = '', files: Sequence[Path] = ()
) -> Iterator[JoinedAnswer]:
    """Yield every answer that has any points."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with Recording(recording) as source:
        topic = _choose(source, topic)
        joiner = Joiner(topic, label if files else label or LABEL, files)
        wanted = {topic + CLEANED, topic + OUTLIERS} | ({topic} if files else set())
        if missing := wanted - _clouds(source):
            must_be = f'with {topic}, which the labels are for'
            raise RecordingError(f'the recording {recording}', must_be, f'no {missing.pop()}')
        for channel, _, data in source.messages():
            if channel.name in wanted and channel.msgtype == CLOUD:
                message = store.deserialize_cdr(data, channel.msgtype)
                yield from joiner.take(channel.name.removeprefix(topic), message)
        joiner.finish()


def _clouds(source: Recording) -> set[str]:
    """List the topics of clouds."""
    return {channel.name for channel in source.topics if channel.msgtype == CLOUD}


def _choose(source: Recording, topic: str | None) -> str:
    """Find the topic whose answers are to be scored."""
    names = _clouds(source)
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


def _part(answer: JoinedAnswer) -> Judged:
    """Take what counts from one cleaned or outlier cloud."""
    points = answer.points
    names = points.dtype.names or ()
    xyz = _xyz(points)
    there = is_return(xyz)
    has_surface = SURFACE in names and points.dtype[SURFACE] == np.uint8
    part = Judged(
        answer.code,
        np.zeros(len(points), np.bool_),
        np.full(len(points), answer.rejected),
        np.full(len(points), answer.number),
        points[SCORE].astype(np.float32) if SCORE in names else None,
        points[DETECTORS].astype(np.uint16) if DETECTORS in names else None,
        np.sqrt(np.einsum('ij,ij->i', xyz, xyz)),
        points[SURFACE] if has_surface else None,
    )
    return part.take(there)


def _xyz(points: NDArray[np.void]) -> NDArray[np.float64]:
    return np.stack([points[axis] for axis in AXES], axis=1).astype(np.float64)


def _with_truth(points: Judged, codes: Codes) -> Judged:
    """Say which points are outliers, and leave out those that do not count."""
    counted = points.take(codes.counted(points.code))
    return replace(counted, bad=codes.bad(counted.code))


@dataclass(frozen=True)
class ColumnNames:
    """Which columns of files hold truth and verdict; empty: the usual ones that are there.

    Attributes
    ----------
    label : truth; usual are ``classification`` and ``label``
    score : usual is ``outlier_score``
    verdict : not 0 where rejected, in a ``classification`` 7 and 18; usual are ``outlier``, and
        ``classification`` where there is no score; without: what the score says
    threshold : points with a larger score are rejected; None: 1

    """

    label: str = ''
    score: str = ''
    verdict: str = ''
    threshold: float | None = None


def read_files(
    verdicts: Path, truth: Path, codes: Codes = ALL_BUT_0, columns: ColumnNames | None = None
) -> Judged:
    """Read scores or verdicts, and labels: one for each point.

    Parameters
    ----------
    verdicts : what ``clean`` wrote, or any file with scores
    truth : file with labels, in the same order; may be the same file
    codes : what the labels mean
    columns : where they are

    Raises
    ------
    FilterError
        If a file cannot be read, the two do not fit, or truth and verdict are one column.

    """
    columns = columns or ColumnNames()
    names = column_names(verdicts)
    label = columns.label or usual_column(truth, (CLASSIFICATION, LABEL))
    score = columns.score or (SCORE if SCORE in names else '')
    verdict = columns.verdict
    if columns.threshold is not None:
        score = score or usual_column(verdicts, (SCORE,))
    elif not verdict and not columns.score and (OUTLIER in names or not score):
        verdict = usual_column(verdicts, (OUTLIER, CLASSIFICATION))
    if verdicts == truth and label in {verdict, score}:
        must_be = 'another than that of the verdicts'
        raise RecordingError(f'the column of the labels in {truth}', must_be, repr(label))
    code = read_codes(truth, label)
    values = None
    if score or not names:
        values = read_column(verdicts, score)
        values = values if values.dtype.kind == 'f' else values.astype(np.float64)
        rejected = values > (1.0 if columns.threshold is None else columns.threshold)
    if verdict:
        result = read_codes(verdicts, verdict)
        rejected = np.isin(result, LAS_NOISE) if verdict == CLASSIFICATION else result != 0
    if len(rejected) != len(code):
        got = f'{len(code)} and {len(rejected)}'
        raise RecordingError('the numbers of labels and verdicts', 'equal', got)
    detectors = None
    if DETECTORS in names:
        detectors = read_codes(verdicts, DETECTORS).astype(np.uint16)
    index = np.arange(len(code), dtype=np.int64)
    no_truth_yet = np.zeros(len(code), np.bool_)
    return _with_truth(Judged(code, no_truth_yet, rejected, index, values, detectors), codes)
