# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Points with known truth and verdict, from the output of a run, or from files.

From clouds, missing returns (NaN, Inf, 0 0 0) and placeholders of rejected points are left out.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Bools, Bytes, Floats, Ints, Reals, Rows
from lidar_outlier_filter.core.points.points import is_return
from lidar_outlier_filter.core.verdict import DETECTORS, OUTLIER, SCORE
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.evaluation.labels import (
    ALL_BUT_0,
    LABEL,
    LAS_NOISE,
    CloudLabels,
    Codes,
    column_names,
    read_codes,
    read_column,
    usual_column,
    words,
)
from lidar_outlier_filter.evaluation.truth import Cause
from lidar_outlier_filter.files.points import CLASSIFICATION
from lidar_outlier_filter.messages.cloud import AXES, is_empty, structured

SURFACE = 'surface'
WITHHELD = 'withheld'  # a flag of LAS
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

    code: Ints
    bad: Bools
    rejected: Bools
    index: Ints
    score: Reals | None = None
    detectors: NDArray[np.uint16] | None = None
    range: Floats | None = None
    surface: Bytes | None = None

    def __len__(self) -> int:
        """Count the points."""
        return len(self.code)

    def take(self, part: Bools | NDArray[np.intp]) -> 'Judged':
        """Choose points by mask or index."""
        chosen: dict[str, Any] = {
            field.name: None if (column := getattr(self, field.name)) is None else column[part]
            for field in fields(self)
        }
        return Judged(**chosen)

    def stretch(self, count: int) -> tuple[Ints, int]:
        """Cut the judged points into ``count`` stretches, at most one per ``index``.

        Returns the number of each point's stretch, and how many there are.
        """
        length = int(self.index.max()) + 1 if len(self) else 1
        count = min(count, length)
        return self.index * count // length, count


def read_clouds(
    clouds: Iterable[tuple[bool | None, Any]], labels: CloudLabels, codes: Codes = CAUSES
) -> Judged:
    """Read the clouds that a run wrote, and the truth they carry or that files hold.

    Parameters
    ----------
    clouds : (rejected, message) pairs; rejected is None for an input, used only with label
        files
    labels : of the topic that was filtered
    codes : what its labels mean

    """
    parts = [_part(one) for one in joined_clouds(clouds, labels)]
    what = f'the outputs of {labels.topic}'
    if not parts:
        raise RecordingError(what, 'at least one point', 'none')
    columns: dict[str, Any] = {}
    for field in fields(Judged):
        values = [getattr(part, field.name) for part in parts]
        known = [one is not None for one in values]
        if any(known) and not all(known):
            got = f'{field.name} in some'
            raise RecordingError(f'the fields of {what}', 'the same in all', got)
        columns[field.name] = np.concatenate(values) if all(known) else None
    return _with_truth(Judged(**columns), codes)


class JoinedCloud(NamedTuple):
    """One cleaned or outlier cloud: its points, their truth, and the number of the cloud."""

    points: Rows
    rejected: bool
    code: Ints
    number: int


def joined_clouds(
    clouds: Iterable[tuple[bool | None, Any]], labels: CloudLabels
) -> Iterator[JoinedCloud]:
    """Yield every cleaned and outlier cloud that has any points; see :func:`read_clouds`."""
    return _beside(clouds, labels) if labels.files else _inside(clouds, labels)


def _inside(
    clouds: Iterable[tuple[bool | None, Any]], labels: CloudLabels
) -> Iterator[JoinedCloud]:
    """Yield outputs whose truth is one of their fields."""
    counts = Counter[bool]()
    for rejected, message in clouds:
        if rejected is None:
            continue
        number = counts[rejected]
        counts[rejected] += 1
        if not is_empty(message):
            points = structured(message).reshape(-1)
            yield JoinedCloud(points, rejected, labels.read(number, message), number)


def _beside(
    clouds: Iterable[tuple[bool | None, Any]], labels: CloudLabels
) -> Iterator[JoinedCloud]:
    """Yield outputs whose truth is in one file for each input cloud, found by their stamps.

    Inputs and outputs come in any order; an input without outputs was refused by the filter.
    """
    numbers: dict[tuple[int, int], int] = {}
    pending: dict[tuple[int, int], dict[bool | None, Any]] = {}
    for which, message in clouds:
        stamp = (message.header.stamp.sec, message.header.stamp.nanosec)
        if which is None:
            if stamp in numbers:
                raise RecordingError(f'the stamps of {labels.topic}', 'different', f'{stamp} twice')
            numbers[stamp] = len(numbers)
        together = pending.setdefault(stamp, {})
        together[which] = message
        if len(together) == len((None, False, True)):
            yield from _join(pending.pop(stamp), numbers[stamp], labels)
    if unknown := pending.keys() - numbers.keys():
        must_be = f'to clouds of {labels.topic}, by their stamps'
        raise RecordingError('the outputs', must_be, f'one with {unknown.pop()}')
    labels.check_count(len(numbers))


def _join(
    together: Mapping[bool | None, Any], number: int, labels: CloudLabels
) -> Iterator[JoinedCloud]:
    """Give the two outputs of one cloud the labels of their points."""
    messages = [together[which] for which in (None, False, True)]
    code = labels.read(number, messages[0])
    found = match(*(_rows(message, messages[0].point_step) for message in messages))
    if found is None:
        must_be = f'the points of cloud {number} of {labels.topic}'
        raise RecordingError('the outputs', must_be, 'others')
    for message, index, rejected in zip(messages[1:], found, (False, True), strict=True):
        if not is_empty(message):
            points = structured(message).reshape(-1)
            yield JoinedCloud(points, rejected, code[index], number)


def _rows(message: Any, step: int) -> Rows:
    """Return the first ``step`` bytes of each point; scores are behind them."""
    if is_empty(message):
        return np.empty(0, np.dtype((np.void, step)))
    points = np.ascontiguousarray(structured(message)).reshape(-1)
    table = points.view(np.uint8).reshape(len(points), message.point_step)
    return np.ascontiguousarray(table[:, :step]).view(np.dtype((np.void, step))).reshape(-1)


def match(given: Rows, cleaned: Rows, outliers: Rows) -> tuple[Ints, Ints] | None:
    """Find the indices of two outputs' points in their cloud; None: they are not from it.

    Points are found by their bytes. Of points that are equal byte by byte, the first are taken for
    those that were kept.
    """
    if len(cleaned) == len(given) != len(cleaned) + len(outliers):
        # An organised cloud that kept its shape: what was rejected is a hole in it.
        holes = np.flatnonzero(given != cleaned)
        return (np.arange(len(given)), holes) if len(holes) == len(outliers) else None
    split = np.concatenate([cleaned, outliers])
    in_given, in_split = np.argsort(given, kind='stable'), np.argsort(split, kind='stable')
    if len(split) != len(given) or (given[in_given] != split[in_split]).any():
        return None
    where = np.empty(len(given), np.int64)
    where[in_split] = in_given
    return where[: len(cleaned)], where[len(cleaned) :]


def _part(joined: JoinedCloud) -> Judged:
    """Read truth, verdict and scores of one cleaned or outlier cloud."""
    points = joined.points
    names = points.dtype.names or ()
    xyz = np.stack([points[axis] for axis in AXES], axis=1).astype(np.float64)
    has_surface = SURFACE in names and points.dtype[SURFACE] == np.uint8
    part = Judged(
        joined.code,
        np.zeros(len(points), np.bool_),
        np.full(len(points), joined.rejected),
        np.full(len(points), joined.number),
        points[SCORE].astype(np.float32) if SCORE in names else None,
        points[DETECTORS].astype(np.uint16) if DETECTORS in names else None,
        np.sqrt(np.einsum('ij,ij->i', xyz, xyz)),
        points[SURFACE] if has_surface else None,
    )
    return part.take(is_return(xyz))


def _with_truth(points: Judged, codes: Codes) -> Judged:
    """Mark the outliers, and leave out points that do not count."""
    counted = points.take(codes.counted(points.code))
    return replace(counted, bad=codes.bad(counted.code))


def _check_withheld(verdicts: Path, verdict: str, names: Collection[str]) -> None:
    """Refuse classes as verdicts, where ``clean --mark withheld`` may have marked other points."""
    if verdict == CLASSIFICATION and WITHHELD in names:
        classes, withheld = (read_codes(verdicts, name) for name in (verdict, WITHHELD))
        count = np.count_nonzero((withheld != 0) & ~np.isin(classes, LAS_NOISE))
        if count:
            must_be = f'named by --verdict {WITHHELD} or --verdict {CLASSIFICATION}'
            got = f'{count} withheld points of other classes than {LAS_NOISE[0]} and {LAS_NOISE[1]}'
            raise RecordingError(f'the verdicts in {verdicts}', must_be, got)


def read_files(  # noqa: PLR0913  what the command line offers
    verdicts: Path,
    truth: Path,
    codes: Codes = ALL_BUT_0,
    *,
    label: str = '',
    score: str = '',
    verdict: str = '',
    threshold: float | None = None,
) -> Judged:
    """Read scores or verdicts, and labels: one for each point.

    Parameters
    ----------
    verdicts : what ``clean`` wrote, or any file with scores
    truth : file with labels, in the same order; may be the same file
    codes : what the labels mean
    label : column of the truth; empty: ``classification`` or ``label``
    score : column of the scores; empty: ``outlier_score``, if there is one
    verdict : column that is not 0 where rejected (``classification``: 7 or 18); empty: the score
        if ``score`` or ``threshold`` is set; else ``outlier``, else the score, else
        ``classification``, unless points of other classes are withheld
    threshold : points with a larger score are rejected; None: 1

    """
    names = column_names(verdicts)
    label = label or usual_column(truth, (CLASSIFICATION, LABEL))
    is_named = bool(score or verdict)
    score = score or (SCORE if SCORE in names else '')
    if threshold is not None:
        score = score or usual_column(verdicts, (SCORE,))
    elif not is_named and (OUTLIER in names or not score):
        verdict = usual_column(verdicts, (OUTLIER, CLASSIFICATION))
        _check_withheld(verdicts, verdict, names)
    if verdicts == truth and label in {verdict, score}:
        must_be = 'another than that of the verdicts'
        raise RecordingError(f'the column of the labels in {truth}', must_be, repr(label))
    code = read_codes(truth, label)
    values = None
    if score or not names:
        values = read_column(verdicts, score)
        values = values if values.dtype.kind == 'f' else values.astype(np.float64)
        rejected = values > (1.0 if threshold is None else threshold)
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
