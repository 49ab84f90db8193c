# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The truth of each answer: a field of its points, or a file beside the cloud that it answers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.evaluation.labels import read_codes
from lidar_outlier_filter.messages.cloud import is_empty, structured
from lidar_outlier_filter.pipeline.topics import CLEANED, OUTLIERS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from lidar_outlier_filter.annotations import Ints, Rows


INPUT = ''  # what follows the name of the topic for the clouds themselves


class JoinedAnswer(NamedTuple):
    """One cleaned or outlier cloud: its points, their truth, and the number of the cloud."""

    points: Rows
    rejected: bool
    code: Ints
    number: int


class Joiner:
    """Takes the messages of a topic and its answers; gives the answers with their truth."""

    def __init__(self, topic: str, label: str, files: Sequence[Path] = ()) -> None:
        """Take the truth from the field ``label``, or from one file for each cloud."""
        self._topic, self._label, self._files = topic, label, files
        self._count = {INPUT: 0, CLEANED: 0, OUTLIERS: 0}
        # By stamp: clouds and answers come in any order, and some clouds have no answer.
        self._waiting: dict[tuple[int, int], dict[str, Any]] = {}
        self._numbers: dict[tuple[int, int], int] = {}

    def take(self, which: str, message: Any) -> Iterator[JoinedAnswer]:
        """Take the next cloud of the input ('', with files only), '/cleaned' or '/outliers'."""
        number = self._count[which]
        self._count[which] += 1
        if not self._files:
            if not is_empty(message):
                points = structured(message).reshape(-1)
                yield JoinedAnswer(points, which == OUTLIERS, self._field(which, points), number)
            return
        stamp = (message.header.stamp.sec, message.header.stamp.nanosec)
        if which == INPUT:
            self._check_new(stamp, number)
            self._numbers[stamp] = number
        together = self._waiting.setdefault(stamp, {})
        together[which] = message
        if len(together) == len(self._count):
            yield from self._join(self._waiting.pop(stamp), self._numbers[stamp])

    def finish(self) -> None:
        """Refuse files for clouds, and answers to clouds, that do not exist.

        A cloud without answers is none: it was refused by the filter.
        """
        for stamp, together in self._waiting.items():
            if INPUT not in together:
                must_be = f'to clouds of {self._topic}, by their stamps'
                raise RecordingError('the answers', must_be, f'one with {stamp}')
        if self._files and self._count[INPUT] != len(self._files):
            must_be = f'one for each of the {self._count[INPUT]} clouds of {self._topic}'
            raise RecordingError('the files with labels', must_be, len(self._files))

    def _check_new(self, stamp: tuple[int, int], number: int) -> None:
        if stamp in self._numbers:
            raise RecordingError(f'the stamps of {self._topic}', 'different', f'{stamp} twice')
        if number >= len(self._files):
            must_be = f'one for each cloud of {self._topic}'
            raise RecordingError('the files with labels', must_be, len(self._files))

    def _field(self, which: str, points: Rows) -> Ints:
        names = points.dtype.names or ()
        if self._label not in names or points.dtype[self._label].kind not in 'iu':
            raise RecordingError(
                f'the fields of {self._topic}{which}',
                f'with whole numbers {self._label!r}',
                ', '.join(names),
            )
        return points[self._label].astype(np.int64)

    def _join(self, together: Mapping[str, Any], number: int) -> Iterator[JoinedAnswer]:
        file = self._files[number]
        code = read_codes(file, self._label)
        messages = [together[which] for which in (INPUT, CLEANED, OUTLIERS)]
        if len(code) != messages[0].width * messages[0].height:
            must_be = f'for {messages[0].width * messages[0].height} points'
            raise RecordingError(f'the labels in {file}', must_be, len(code))
        rows = [_rows(message, messages[0].point_step) for message in messages]
        found = match(*rows)
        if found is None:
            must_be = f'the points of cloud {number} of {self._topic}'
            raise RecordingError('the answers', must_be, 'others')
        for message, index, rejected in zip(messages[1:], found, (False, True), strict=True):
            if not is_empty(message):
                points = structured(message).reshape(-1)
                yield JoinedAnswer(points, rejected, code[index], number)


def _rows(message: Any, step: int) -> Rows:
    """Give the first ``step`` bytes of each point; scores are behind them."""
    if is_empty(message):
        return np.empty(0, np.dtype((np.void, step)))
    points = np.ascontiguousarray(structured(message)).reshape(-1)
    table = points.view(np.uint8).reshape(len(points), message.point_step)
    return np.ascontiguousarray(table[:, :step]).view(np.dtype((np.void, step))).reshape(-1)


def match(given: Rows, cleaned: Rows, outliers: Rows) -> tuple[Ints, Ints] | None:
    """Find the index in a cloud of each point of its two answers; None: they are not its own.

    Points are found by their bytes. Of points that are equal byte by byte, the first are taken for
    those that were kept.
    """
    if len(cleaned) == len(given) != len(cleaned) + len(outliers):
        # An organised cloud that kept its shape: what was rejected is a hole in it.
        holes = np.flatnonzero(given != cleaned)
        return (np.arange(len(given)), holes) if len(holes) == len(outliers) else None
    answers = np.concatenate([cleaned, outliers])
    if len(answers) != len(given):
        return None
    in_given = np.argsort(given, kind='stable')
    in_answers = np.argsort(answers, kind='stable')
    if (given[in_given] != answers[in_answers]).any():
        return None
    where = np.empty(len(given), np.int64)
    where[in_answers] = in_given
    return where[: len(cleaned)], where[len(cleaned) :]
