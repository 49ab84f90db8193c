# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Labels of files, columns and clouds, and which of them mean outliers."""

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise, zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Bools, Ints
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.files.cloud_file import check_file, open_cloud, read, readable
from lidar_outlier_filter.files.points import CLASSIFICATION
from lidar_outlier_filter.messages.cloud import is_empty, structured

MAX_CODE = 65_535  # of SemanticKITTI's; LAS has 255, and our own labels, too
LABEL = 'label'
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

    def bad(self, code: Ints) -> Bools:
        """Return which points (N,) are outliers."""
        return np.isin(code, list(self.outliers)) if self.outliers else code != 0

    def counted(self, code: Ints) -> Bools:
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
        if not fine or not int(first) <= int(last) <= MAX_CODE:
            must_be = f"numbers up to {MAX_CODE} as in '7,18' or '1-5'"
            raise RecordingError('the codes', must_be, repr(text))
        codes.update(range(int(first), int(last) + 1))
    return frozenset(codes)


def is_recording(path: Path) -> bool:
    """Return by its name whether a path is a recording, and no file with values for each point."""
    return path.is_dir() or path.suffix.lower() in {'', '.mcap', '.db3', '.bag'}


def by_number(folder: Path) -> list[Path]:
    """List the files of a folder by cloud number, the one number in which their names differ.

    Seconds of ten digits and nanoseconds of nine, with a dot or _ between, are one number. Hidden
    files are skipped.
    """
    paths = [one for one in folder.iterdir() if not (one.is_dir() or one.name.startswith('.'))]
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


def read_codes(path: Path, name: str = '') -> Ints:
    """Read a column of whole numbers, (N,); see :func:`read_column`.

    Without a name it is ``classification`` or ``label``, whichever is there.
    """
    values = read_column(path, name or usual_column(path, (CLASSIFICATION, LABEL)))
    # Tables that are text hold whole numbers as floats.
    if not bool((np.abs(values) <= MAX_CODE).all() and (values == np.floor(values)).all()):
        got = values[~(values == np.floor(values)) | (np.abs(values) > MAX_CODE)][0]
        raise RecordingError(f'the labels in {path}', f'whole numbers up to {MAX_CODE}', got)
    return values.astype(np.int64)


def read_codes_of(path: Path, points: int, name: str = '') -> Ints:
    """Read a column of whole numbers, one for each of so many points."""
    code = read_codes(path, name)
    if len(code) != points:
        raise RecordingError(f'the labels in {path}', f'for {points} points', len(code))
    return code


class CloudLabels:
    """Labels of the clouds of a topic: a field of each cloud, or one file for each, in order."""

    def __init__(self, topic: str, name: str = '', files: Sequence[Path] = ()) -> None:
        """Name the field or the column; empty: ``label``, in files ``classification`` first."""
        self.files = files
        self.topic, self._name = topic, name

    def read(self, number: int, message: Any) -> Ints:
        """Return the labels (N,) of all points of a cloud, row by row."""
        if self.files:
            if number >= len(self.files):
                must_be = f'one for each cloud of {self.topic}'
                raise RecordingError('the files with labels', must_be, len(self.files))
            return read_codes_of(self.files[number], message.width * message.height, self._name)
        if is_empty(message):
            return np.zeros(0, np.int64)
        points, name = structured(message).reshape(-1), self._name or LABEL
        names = points.dtype.names or ()
        if name not in names or points.dtype[name].kind not in 'iu':
            must_be = f'with whole numbers {name!r}'
            raise RecordingError(f'the fields of {self.topic}', must_be, ', '.join(names))
        return np.asarray(points[name].astype(np.int64))

    def check_count(self, clouds: int) -> None:
        """Refuse files that are more or fewer than the clouds of the topic."""
        if self.files and len(self.files) != clouds:
            must_be = f'one for each of the {clouds} clouds of {self.topic}'
            raise RecordingError('the files with labels', must_be, len(self.files))


def read_column(path: Path, name: str) -> NDArray[Any]:
    """Read one number for each point, (N,).

    Parameters
    ----------
    path : any file that ``clean`` reads, ``.label`` (SemanticKITTI: uint32, the class in the low 16
        bits) or ``.npy``
    name : of the column; ignored for files with a single one

    """
    plain = _PLAIN.get(path.suffix.lower())
    if plain is None:
        return np.concatenate([values for (values,) in read(open_cloud(path), [name])])
    with readable(path):
        check_file(path)
        values = plain(path)
        if values.ndim != 1 or values.dtype.kind not in 'iufb':
            got = f'{values.dtype} {values.shape}'
            raise RecordingError(f'the array in {path}', 'one number for each point', got)
        return values


def _read_label(path: Path) -> NDArray[Any]:
    data = path.read_bytes()
    if len(data) % 4:
        raise RecordingError(f'the size of {path}', 'a multiple of 4 bytes', len(data))
    return np.frombuffer(data, '<u4') & MAX_CODE


_PLAIN: dict[str, Callable[[Path], NDArray[Any]]] = {
    '.label': _read_label,
    '.npy': partial(np.load, allow_pickle=False),
}


def words(name: str) -> str:
    """Write the name of a cause or a surface in words."""
    return name.lower().replace('_', ' ')
