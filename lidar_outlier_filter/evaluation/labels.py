# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Labels: of files, of LAS classes, of columns, of the answers of a run; and which are outliers."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from itertools import pairwise, zip_longest
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.files.cloud_file import open_cloud, read, readable
from lidar_outlier_filter.messages.cloud import is_empty, structured
from lidar_outlier_filter.pipeline.topics import CLEANED, OUTLIERS

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Ints, Rows

MOST_CODE = 65_535  # of SemanticKITTI's; LAS has 255, and our own labels, too
INPUT = ''  # what follows the name of the topic for the clouds themselves
CLASSIFICATION, LABEL = 'classification', 'label'
LAS_NOISE = (7, 18)  # low and high noise, ASPRS LAS 1.4, table 17
KITTI_OUTLIER, KITTI_UNLABELED = 1, 0  # SemanticKITTI's own configuration


@dataclass(frozen=True)
class Codes:
    """What the codes of a truth mean.

    Attributes
    ----------
    outliers : codes of outliers; empty: all but 0
    ignored : codes of points that count neither way, such as unlabelled ones
    names : what some of the codes are called

    """

    outliers: frozenset[int] = frozenset()
    ignored: frozenset[int] = frozenset()
    names: Mapping[int, str] = field(default_factory=dict)

    def bad(self, code: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which points (N,) are outliers."""
        return np.isin(code, list(self.outliers)) if self.outliers else code != 0

    def counted(self, code: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which points (N,) count."""
        return np.isin(code, list(self.ignored), invert=True)

    def name(self, code: int) -> str:
        """Name a code."""
        return self.names.get(code, f'code {code}')


ALL_BUT_0 = Codes()
# By the suffix of the file that the truth comes from.
USUAL_CODES = {
    '.label': Codes(
        frozenset({KITTI_OUTLIER}), frozenset({KITTI_UNLABELED}), {KITTI_OUTLIER: 'outlier'}
    ),
    '.las': Codes(frozenset(LAS_NOISE), names={7: 'low noise', 18: 'high noise'}),
}
USUAL_CODES['.laz'] = USUAL_CODES['.las']


def parse_codes(text: str) -> frozenset[int]:
    """Read codes as in '7,18' or '1-5,110'; both ends of a range belong to it."""
    codes: set[int] = set()
    for part in text.split(','):
        low, dash, high = part.strip().partition('-')
        first, last = low.strip(), high.strip() if dash else low.strip()
        fine = all(end.isascii() and end.isdigit() for end in (first, last))
        if not fine or not int(first) <= int(last) <= MOST_CODE:
            must_be = f"numbers up to {MOST_CODE} as in '7,18' or '1-5'"
            raise RecordingError('the codes', must_be, repr(text))
        codes.update(range(int(first), int(last) + 1))
    return frozenset(codes)


def is_recording(path: Path) -> bool:
    """Return by its name whether a path is a recording, and no file with values for each point."""
    return path.is_dir() or path.suffix.lower() in {'', '.mcap', '.db3', '.bag'}


def by_number(folder: Path) -> list[Path]:
    """List the files of a folder by the one number in which their names differ: that of the cloud.

    Seconds of ten digits and nanoseconds of nine, with a dot or _ between, are one number. What
    begins with a dot is passed over.

    Raises
    ------
    RecordingError
        If there is no file, or two names differ in anything else.

    """
    paths = [path for path in folder.iterdir() if path.is_file() and not path.name.startswith('.')]
    if not paths:
        raise RecordingError('the folder of the labels', 'with files', f'{folder}, empty')
    paths.sort(key=_parts)
    index = None
    for one, other in pairwise(paths):
        parts = enumerate(zip_longest(_parts(one), _parts(other)))
        differ = [number for number, (this, that) in parts if this != that]
        index = differ[0] if index is None and differ else index
        if differ != [index] or differ[0] % 2 == 0:
            must_be = 'alike but for one number, that of the cloud'
            raise RecordingError(f'the names in {folder}', must_be, f'{one.name} and {other.name}')
    return paths


def _parts(path: Path) -> list[str | int]:
    """Cut a name into texts, at even indices, and the numbers between them."""
    name = re.sub(r'(\d{10})[._](\d{9})(?!\d)', r'\1\2', path.name)
    return [int(part) if index % 2 else part for index, part in enumerate(re.split(r'(\d+)', name))]


def column_names(path: Path) -> Collection[str]:
    """List the columns of a file; none where it holds a single one without a name."""
    return () if path.suffix.lower() in _PLAIN else tuple(open_cloud(path).columns)


def usual_column(path: Path, usual: Sequence[str]) -> str:
    """Choose the first of the usual columns that a file has; empty where columns have no names."""
    names = column_names(path)
    for name in usual:
        if name in names:
            return name
    if not names:
        return ''
    raise RecordingError(f'the columns of {path}', f'with {" or ".join(usual)}', ', '.join(names))


def read_codes(path: Path, name: str = '') -> NDArray[np.int64]:
    """Read a column of whole numbers, (N,); see :func:`read_column`.

    Without a name it is ``classification`` or ``label``, whichever is there.
    """
    values = read_column(path, name or usual_column(path, (CLASSIFICATION, LABEL)))
    # Tables that are text hold whole numbers as floats.
    if not bool((np.abs(values) <= MOST_CODE).all() and (values == np.floor(values)).all()):
        got = values[~(values == np.floor(values)) | (np.abs(values) > MOST_CODE)][0]
        raise RecordingError(f'the labels in {path}', f'whole numbers up to {MOST_CODE}', got)
    return values.astype(np.int64)


def read_codes_of(path: Path, points: int, name: str = '') -> NDArray[np.int64]:
    """Read a column of whole numbers, one for each of so many points."""
    code = read_codes(path, name)
    if len(code) != points:
        raise RecordingError(f'the labels in {path}', f'for {points} points', len(code))
    return code


def codes_of(points: Rows, label: str, topic: str) -> NDArray[np.int64]:
    """Return the labels (N,) that a field of a cloud's points holds."""
    names = points.dtype.names or ()
    if label not in names or points.dtype[label].kind not in 'iu':
        must_be = f'with whole numbers {label!r}'
        raise RecordingError(f'the fields of {topic}', must_be, ', '.join(names))
    return np.asarray(points[label].astype(np.int64))


def read_column(path: Path, name: str) -> NDArray[Any]:
    """Read one number for each point, (N,).

    Parameters
    ----------
    path : any file that ``clean`` reads, ``.label`` (SemanticKITTI: uint32, the class in the low 16
        bits) or ``.npy``
    name : of the column; files with a single one do not look at it

    Raises
    ------
    FilterError
        If the file cannot be read, or has no such column.

    """
    plain = _PLAIN.get(path.suffix.lower())
    if plain is None:
        return np.concatenate([values for (values,) in read(open_cloud(path), [name])])
    with readable(path):
        values = plain(path)
        if values.ndim != 1 or values.dtype.kind not in 'iufb':
            got = f'{values.dtype} {values.shape}'
            raise RecordingError(f'the array in {path}', 'one number for each point', got)
        return values


def _read_label(path: Path) -> NDArray[Any]:
    data = path.read_bytes()
    if len(data) % 4:
        raise RecordingError(f'the size of {path}', 'a multiple of 4 bytes', len(data))
    return np.frombuffer(data, '<u4') & MOST_CODE


def _read_npy(path: Path) -> NDArray[Any]:
    return np.asarray(np.load(path, allow_pickle=False))


_PLAIN = {'.label': _read_label, '.npy': _read_npy}


def words(name: str) -> str:
    """Write the name of a cause or a surface in words."""
    return name.lower().replace('_', ' ')


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
                code = codes_of(points, self._label, f'{self._topic}{which}')
                yield JoinedAnswer(points, which == OUTLIERS, code, number)
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

    def _join(self, together: Mapping[str, Any], number: int) -> Iterator[JoinedAnswer]:
        messages = [together[which] for which in (INPUT, CLEANED, OUTLIERS)]
        count = messages[0].width * messages[0].height
        code = read_codes_of(self._files[number], count, self._label)
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
