# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What every format can do, and which module reads which file."""

from __future__ import annotations

import importlib
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from lidar_outlier_filter.errors import CloudError, FilterError, said_by
from lidar_outlier_filter.files.size_check import check_count

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Bools


CHUNK = 500_000  # rows in memory at once; a multiple of LAZ's 50 000

# Suffix, module, and what to install where its library is missing.
FORMATS = {
    '.las': ('las', 'files'),
    '.laz': ('las', 'files'),
    '.pcd': ('pcd', 'files'),
    '.ply': ('ply', ''),
    '.ptx': ('ptx', ''),
    '.e57': ('e57', 'e57'),
    '.csv': ('text', ''),
    '.tsv': ('text', ''),
    '.txt': ('text', ''),
    '.xyz': ('text', ''),
    '.asc': ('text', ''),
    '.parquet': ('parquet', 'parquet'),
    '.sqlite': ('sqlite', ''),
    '.sqlite3': ('sqlite', ''),
    '.db': ('sqlite', ''),
}
SUFFIXES = tuple(FORMATS)
_COPIES = {'.e57': '.ply'}  # of formats that are only read, the one of their copies


@dataclass(frozen=True)
class Change:
    """In what a copy of a file of N points differs from it.

    Attributes
    ----------
    keep : (N,) bool or None
        The points that the copy has; None: all.
    noise : (N,) bool or None
        The points whose classification becomes 7, low noise; only where the format has classes.
    high : (N,) bool or None
        Those whose classification becomes 18, high noise; likewise.
    withheld : (N,) bool or None
        Those that gain the flag "withheld"; likewise.
    added : columns by name, (N,) each
        What each point gains, behind all that it has.

    """

    keep: Bools | None = None
    noise: Bools | None = None
    high: Bools | None = None
    withheld: Bools | None = None
    added: Mapping[str, NDArray[Any]] = field(default_factory=dict)

    def count(self, total: int) -> int:
        """Count the points of the copy of a file of so many."""
        return total if self.keep is None else int(np.count_nonzero(self.keep))

    def part(self, rows: slice) -> Change:
        """Return what becomes of some of the points, in a format without classes."""
        added = {name: values[rows] for name, values in self.added.items()}
        return Change(None if self.keep is None else self.keep[rows], added=added)


class CloudFile(Protocol):
    """A file of points, read chunk by chunk as often as it takes, and copied with changes.

    Attributes
    ----------
    columns : the columns that hold one number a point, and their types, in the order of the file
    classes : whether points have a classification
    gaps : whether a point that is left out of a copy becomes a missing return, as its grid stays
        whole, and a copy can have no more columns
    whole : why no point can be left out of a copy; empty: any can

    """

    path: Path
    columns: Mapping[str, np.dtype[Any]]
    classes: bool = False
    gaps: bool = False
    whole: str = ''

    @property
    def metres(self) -> Mapping[str, float]:
        """Of columns with coordinates in other units, the metres that one of them is."""
        return {}

    def __len__(self) -> int:
        """Count the points."""

    def read(self, names: Sequence[str]) -> Iterator[tuple[NDArray[Any], ...]]:
        """Read columns, chunk by chunk: for each name an array (n,), in the order of the names.

        Whole numbers of which some are missing are a masked array; other missing numbers are NaN.
        """

    def copy(self, path: Path, change: Change) -> Iterator[int]:
        """Write a copy to a new file; yield, now and then, how many points of this are done.

        All that the change does not name is kept, byte for byte.
        """


def open_cloud(path: Path, table: str | None = None) -> CloudFile:
    """Open a cloud by the suffix of its name.

    Parameters
    ----------
    path : the file
    table : the table of a database; None: the only one

    Raises
    ------
    CloudError
        If the suffix is of no known format, or the file cannot be read or has no points.

    """
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise CloudError(f'the file {path}', f'one of {" ".join(FORMATS)}', repr(path.suffix))
    module, extra = FORMATS[suffix]
    with readable(path):
        if not path.is_file():
            raise CloudError(f'the file {path}', 'a file', 'a folder' if path.is_dir() else 'none')
        try:
            opened: CloudFile = importlib.import_module(f'{__package__}.{module}').open_file(
                path, table
            )
        except ModuleNotFoundError as err:
            must_be = f"installed, as by pip install 'lidar_outlier_filter[{extra}]'"
            raise CloudError(f'the module {err.name} for {suffix} files', must_be, 'none') from err
    if table is not None and module != 'sqlite':
        raise CloudError('the table', f'given for a database only, not for {suffix}', repr(table))
    with readable(path):
        if len(opened) == 0:
            raise CloudError(f'the cloud {path}', 'of at least one point', 0)
    return opened


def copy_suffix(path: Path) -> str:
    """Return how the name of a copy ends: as that of the file, where its format is written."""
    return _COPIES.get(path.suffix.lower(), path.suffix)


def is_copy_format(path: Path, copy: Path) -> bool:
    """Return whether a name is that of a file in the format of a file's copies."""
    suffixes = (copy_suffix(path), copy.suffix)
    said, got = (FORMATS.get(suffix.lower()) for suffix in suffixes)
    return said == got


def read(file: CloudFile, names: Sequence[str]) -> Iterator[tuple[NDArray[Any], ...]]:
    """Read columns of a file chunk by chunk, as :func:`read_exact`; what is missing is NaN."""
    for chunk in read_exact(file, names):
        yield tuple(filled(values) for values in chunk)


def filled(values: NDArray[Any]) -> NDArray[Any]:
    """Put NaN where a masked array has no number; others stay as they are."""
    if not np.ma.is_masked(values):
        return np.ma.getdata(values)
    with_nan: NDArray[Any] = np.ma.filled(values.astype(np.float64), np.nan)
    return with_nan


def read_exact(file: CloudFile, names: Sequence[str]) -> Iterator[tuple[NDArray[Any], ...]]:
    """Read columns of a file chunk by chunk, whatever is wrong with it said in one sentence.

    Whole numbers of which some are missing are a masked array: a float would round large ones.
    """
    for name in names:
        if name not in file.columns:
            raise CloudError(f'a column of {file.path}', f'one of {_names(file)}', repr(name))
    count = 0
    with readable(file.path):
        for chunk in file.read(names):
            count += len(chunk[0])
            yield chunk
        check_count(file.path, len(file), count)


def copy(file: CloudFile, path: Path, change: Change) -> Iterator[int]:
    """Write a changed copy; whatever goes wrong is said in one sentence."""
    if change.keep is not None and file.whole:
        raise CloudError(f'rejected points of {file.path}', 'marked', f'removed: {file.whole}')
    for name in change.added:
        if name in file.columns:
            raise CloudError(f'the columns of {file.path}', f'without {name}', _names(file))
    with readable(file.path):
        try:
            yield from file.copy(path, change)
        except OSError as err:
            raise CloudError(f'the output {path}', 'written in full', said_by(err)) from err


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """Refuse, in one sentence, whatever a file that is none makes its reader raise."""
    try:
        yield
    except FilterError:
        raise
    except Exception as err:  # on damaged files, the readers raise whatever they come upon
        raise CloudError(f'the file {path}', 'readable', said_by(err)) from err
    except BaseException as err:
        # The library for LAZ, which is in Rust, ends so where it comes upon what cannot be.
        if type(err).__name__ != 'PanicException':
            raise
        raise CloudError(f'the file {path}', 'readable', said_by(err)) from err


def _names(file: CloudFile) -> str:
    return ', '.join(file.columns) or 'none'
