# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The interface of all formats, and the rule that no header is trusted.

Readers compare what a header says with the size of its file before they allocate memory or begin a
loop. What cannot be in the file is refused, and so is a wrong count of points.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Bools
from lidar_outlier_filter.errors import CloudError, FilterError, refusing

CHUNK_ROWS = 500_000  # rows in memory at once; a multiple of LAZ's 50 000
_BYTES_AT_ONCE = 2**20
_MAX_DIGITS = 18  # of a number that is less than 2^63

# Suffix, module, class, and the extra that installs its library.
FORMATS = {
    **dict.fromkeys(('.las', '.laz'), ('las', 'LasFile', 'files')),
    '.pcd': ('pcd', 'PcdFile', 'files'),
    '.ply': ('ply', 'PlyFile', ''),
    '.ptx': ('text', 'PtxFile', ''),
    '.e57': ('e57', 'E57File', 'e57'),
    **dict.fromkeys(('.csv', '.tsv', '.txt', '.xyz', '.asc'), ('text', 'TextFile', '')),
    '.parquet': ('parquet', 'ParquetFile', 'parquet'),
    **dict.fromkeys(('.sqlite', '.sqlite3', '.db'), ('sqlite', 'SqliteFile', '')),
}
SUFFIXES = tuple(FORMATS)
# Clouds in formats that are not read: each in a folder is a failure, not passed over.
UNREAD_SUFFIXES = ('.pts', '.xyzi', '.xyzrgb', '.zlas', '.fls', '.zfs', '.rxp', '.rdbx')
LOW_NOISE, MAX_CLASS = 7, 255  # ASPRS classes: low point, noise; the largest number
COPC = '.copc.laz'  # LAZ with an octree
_COPIES = {'.e57': '.ply'}  # of formats that are only read, the format of copies


@dataclass(frozen=True)
class Change:
    """How a copy of a file of N points differs from it.

    Attributes
    ----------
    keep : (N,) bool or None
        The points of the copy; None: all.
    noise : (N,) bool or None
        The points whose classification becomes ``code``; only where the format has classes.
    code : 7, low noise, or another class
    high : (N,) bool or None
        Those whose classification becomes 18, high noise; likewise.
    withheld : (N,) bool or None
        Those that get the flag "withheld"; likewise.
    added : columns by name, (N,) each
        New columns, behind the existing ones.

    """

    keep: Bools | None = None
    noise: Bools | None = None
    code: int = LOW_NOISE
    high: Bools | None = None
    withheld: Bools | None = None
    added: Mapping[str, NDArray[Any]] = field(default_factory=dict)

    def count(self, total: int) -> int:
        """Count the points of the copy of a file with ``total`` points."""
        return total if self.keep is None else int(np.count_nonzero(self.keep))

    def part(self, rows: slice) -> 'Change':
        """Return the change of some of the points, in a format without classes."""
        added = {name: values[rows] for name, values in self.added.items()}
        return Change(None if self.keep is None else self.keep[rows], added=added)


class CloudFile(Protocol):
    """A file of points, which can be read repeatedly, chunk by chunk, and copied with changes.

    Attributes
    ----------
    columns : the columns with one number per point, and their types, in file order
    classes : whether points have a classification
    max_class : the largest number of a class
    gaps : whether points left out of a copy become missing returns, to keep the grid; columns
        cannot be added then
    whole : why points cannot be left out of a copy; empty if they can
    crs, wkt : name and WKT of the coordinate system; empty where the file names none
    metres : metres per unit of the columns with coordinates that are not in metres
    about : properties of the format, by name, such as its version
    octree : that of a COPC file, which its copies may keep
    grids : columns and rows of each scan whose points, missing returns among them, come column by
        column; empty where they do not

    """

    path: Path
    columns: Mapping[str, np.dtype[Any]]
    classes: bool = False
    max_class: int = MAX_CLASS
    gaps: bool = False
    whole: str = ''
    crs: str = ''
    wkt: str = ''
    metres: Mapping[str, float] = MappingProxyType({})
    about: Mapping[str, str] = MappingProxyType({})
    octree: object | None = None
    grids: Sequence[tuple[int, int]] = ()
    _count: int

    def __len__(self) -> int:
        """Count the points, missing returns among them."""
        return self._count

    def read(self, names: Sequence[str]) -> Iterator[tuple[NDArray[Any], ...]]:
        """Read columns chunk by chunk: for each name an array (n,), in the order of the names.

        Integer columns with missing values are masked arrays; other missing numbers are NaN.
        """

    def copy(self, path: Path, change: Change) -> Iterator[int]:
        """Write a copy to a new file; yield, now and then, how many points are done.

        Every byte that the change does not concern is kept.
        """


def open_cloud(path: Path, table: str | None = None) -> CloudFile:
    """Open a cloud by the suffix of its name.

    Parameters
    ----------
    path : the file
    table : the table of a database; None: the only one

    """
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise CloudError(f'the file {path}', f'one of {" ".join(FORMATS)}', repr(path.suffix))
    module, name, extra = FORMATS[suffix]
    if table is not None and module != 'sqlite':
        raise CloudError('the table', f'given for a database only, not for {suffix}', repr(table))
    with readable(path):
        check_file(path)
        try:
            kind = getattr(import_module(f'{__package__}.{module}'), name)
        except ModuleNotFoundError as err:
            must_be = f"installed, as by pip install 'lidar_outlier_filter[{extra}]'"
            raise CloudError(f'the module {err.name} for {suffix} files', must_be, 'none') from err
        opened: CloudFile = kind(path) if table is None else kind(path, table)
        if len(opened) == 0:
            raise CloudError(f'the cloud {path}', 'of at least one point', 0)
        return opened


def check_file(path: Path) -> None:
    """Refuse folders, and pipes and devices, on which reading may block."""
    if not path.is_file():
        got = 'a folder' if path.is_dir() else 'a pipe or device' if path.exists() else 'none'
        raise CloudError(f'the file {path}', 'a file', got)


def copy_suffix(path: Path) -> str:
    """Return the suffix of copies: that of the file, where its format is written."""
    return _COPIES.get(path.suffix.lower(), path.suffix)


def split_name(path: Path) -> tuple[str, str]:
    """Split the name of a file before the suffix of its copies, of which .copc.laz is one."""
    if is_copc(path):
        return path.name[: -len(COPC)], path.name[-len(COPC) :]
    return path.stem, copy_suffix(path)


def is_copc(path: Path) -> bool:
    """Return whether a file is COPC by its name."""
    return path.name.lower().endswith(COPC)


def read(
    file: CloudFile, names: Sequence[str], *, exact: bool = False
) -> Iterator[tuple[NDArray[Any], ...]]:
    """Read columns of a file chunk by chunk; a damaged file is refused in one sentence.

    Missing numbers are NaN. If ``exact``, integer columns with missing values are masked
    arrays: a float would round large ones.
    """
    for name in names:
        if name not in file.columns:
            must_be = f'one of {", ".join(file.columns) or "none"}'
            raise CloudError(f'a column of {file.path}', must_be, repr(name))
    count = 0
    with readable(file.path):
        for read_values in file.read(names):
            chunk = tuple(map(_quiet, read_values))
            count += len(chunk[0])
            yield chunk if exact else tuple(map(filled, chunk))
        check_count(file.path, len(file), count)


def _quiet(values: NDArray[Any]) -> NDArray[Any]:
    """Make NaN of signalling NaN, of which each conversion and comparison would warn."""
    if values.dtype.kind != 'f':
        return values
    with np.errstate(invalid='ignore'):
        quiet: NDArray[Any] = values * values.dtype.type(1)
    return quiet


def filled(values: NDArray[Any]) -> NDArray[Any]:
    """Put NaN where a masked array has no number; others stay as they are."""
    if not np.ma.is_masked(values):
        return np.ma.getdata(values)
    with_nan: NDArray[Any] = np.ma.filled(values.astype(np.float64), np.nan)
    return with_nan


def copy(file: CloudFile, path: Path, change: Change) -> Iterator[int]:
    """Write a changed copy; a damaged file is refused in one sentence.

    Raises
    ------
    CloudError
        If the file cannot be read, or cannot be changed so.
    OSError
        If the copy cannot be written.

    """
    if change.keep is not None and file.whole:
        raise CloudError(f'rejected points of {file.path}', 'marked', f'removed: {file.whole}')
    for name in change.added:
        if name in file.columns:
            got = ', '.join(file.columns)
            raise CloudError(f'the columns of {file.path}', f'without {name}', got)
    with readable(file.path, OSError):
        yield from file.copy(path, change)


def readable(path: Path, ignored: type[Exception] = FilterError) -> AbstractContextManager[None]:
    """Turn any error of a reader but ``ignored`` into a refusal in one sentence."""
    return refusing(CloudError, f'the file {path}', 'readable', passed=ignored)


def check_names(path: Path, names: Iterable[str]) -> None:
    """Refuse duplicate column names."""
    double = sorted(name for name, count in Counter(names).items() if count > 1)
    if double:
        raise CloudError(f'the columns of {path}', 'of different names', ', '.join(double))


def parse_number(text: str) -> float:
    """Parse a number of ASCII digits; ``1_000`` is not one.

    Raises
    ------
    ValueError
        If it is not a number.

    """
    if '_' in text or not text.isascii():
        raise ValueError(text)
    return float(text)


def parse_count(path: Path, what: str, text: str) -> int:
    """Read a whole number of a header, or refuse it."""
    digits = text.removeprefix('-')
    if not (digits.isascii() and digits.isdigit() and len(digits) <= _MAX_DIGITS):
        raise CloudError(f'{what} of {path}', 'a whole number', repr(text[:40]))
    return int(text)


def check_fits(path: Path, what: str, count: int, each: int, size: int) -> None:
    """Refuse a count of things, of at least ``each`` bytes, that do not fit into ``size`` bytes.

    Items of no bytes cannot be counted by their bytes: at most one per byte of the file is allowed.
    """
    most = max(0, size) // max(1, each)
    if not 0 <= count <= most:
        raise CloudError(f'{what} of {path}', f'from 0 to {most}, which it has room for', count)


def check_offset(path: Path, what: str, offset: int, low: int, high: int) -> None:
    """Refuse an offset (byte) that is not between two others, both of them included."""
    if not low <= offset <= high:
        raise CloudError(f'{what} of {path}', f'from byte {low} to byte {high}', offset)


def check_points(path: Path, said: int, each: int, begin: int, end: int) -> None:
    """Refuse points of ``each`` bytes that are more or fewer than lie between two offsets (bytes).

    Behind the points there may be zeros, with which some programs fill pages, or a rest that is
    shorter than a point.
    """
    if each <= 0:
        raise CloudError(f'the size of a point of {path}', 'at least 1 byte', each)
    found = max(0, end - begin) // each
    if found < said or (found > said and _is_written(path, begin + said * each, end)):
        check_count(path, said, found)


def _is_written(path: Path, begin: int, end: int) -> bool:
    """Return whether any byte between two offsets is not zero."""
    with path.open('rb') as stream:
        stream.seek(begin)
        while part := stream.read(min(_BYTES_AT_ONCE, end - stream.tell())):
            if part.count(0) < len(part):
                return True
    return False


def check_count(path: Path, said: int, found: int) -> None:
    """Refuse a file with more or fewer points than its header says."""
    if found != said:
        raise CloudError(f'the file {path}', f'of {said} points, as it says', f'{found}')
