# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Where recordings lie: folders of this machine, and whatever fsspec opens, such as ``s3://``.

Credentials and addresses of a store are those of fsspec and of its file system, from the
environment or their own files.
"""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, NamedTuple

from lidar_outlier_filter.errors import CloudError, RecordingError
from lidar_outlier_filter.recordings.remote_path import RemotePath, reached

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from lidar_outlier_filter.recordings.remote_path import RecordingPath

METADATA = 'metadata.yaml'  # in the folder of a recording of ROS 2
SUFFIXES = ('.mcap', '.db3', '.bag')
MOST_STAGED = 64 * 2**30  # bytes of a recording that is copied to this machine


class _State(NamedTuple):
    """The size of a file in bytes, and what changes with its content."""

    size: int
    mark: str


@dataclass(frozen=True)
class Location:
    """A recording that was found: where, how large, and which state of it.

    Attributes
    ----------
    path : what :class:`Recording` opens
    size : bytes of all its files
    state : ``etag:`` and the store's mark of the content, or ``mtime:`` and the times of its files
    by_ranges : whether it can be read where it lies; else :func:`staged` copies it first
    is_folder : whether it is a folder of files

    """

    path: RecordingPath
    size: int
    state: str
    by_ranges: bool
    is_folder: bool = False

    def check_unchanged(self, what: str = 'recording') -> None:
        """Refuse a recording, or whatever it is, that is no longer the one that was found.

        Raises
        ------
        RecordingError
            If its size, a time or a mark of the store has changed.

        """
        now = location_of(self.path)
        if (now.size, now.state) != (self.size, self.state):
            got = f'{now.size} bytes and {now.state} after {self.size} bytes and {self.state}'
            raise RecordingError(f'the {what} {self.path}', 'unchanged while it is read', got)


def path_at(address: str) -> RecordingPath:
    """Return the path for an address: one of this machine, or ``PROTOCOL://…``.

    Raises
    ------
    RecordingError
        If nothing is installed that opens it.

    """
    if '://' not in address:
        return Path(address)
    try:
        from fsspec.core import url_to_fs  # noqa: PLC0415  paths of this machine need none
    except ModuleNotFoundError as err:
        must_be = 'installed for such addresses (pip install lidar_outlier_filter[archive,s3])'
        raise RecordingError('the module fsspec', must_be, address) from err
    with reached(address):
        system, key = url_to_fs(address, use_listings_cache=False)
    if 'file' in system.protocol:
        return Path(key)
    return RemotePath(system, key.rstrip('/'))


def find(addresses: Iterable[str]) -> list[Location]:
    """Find the recordings at addresses: each a recording, a folder of recordings, or a pattern.

    A folder is searched to its depth. What begins with a dot is passed over.

    Raises
    ------
    RecordingError
        If there is none at an address, or the address cannot be reached.

    """
    found: dict[str, Location] = {}
    for address in addresses:
        path = path_at(address)
        with reached(address):
            locations = [location for one in _matching(path) for location in _recordings(one)]
        if not locations:
            must_be = 'a recording, a folder of recordings, or a pattern for some'
            raise RecordingError(f'what is at {address}', must_be, 'no recording')
        found.update((str(location.path), location) for location in locations)
    return [found[name] for name in sorted(found)]


def find_files(folder: Path, suffixes: Sequence[str]) -> list[Path]:
    """Find the files of a folder, to its depth, whose names end so; see :func:`find`.

    Raises
    ------
    CloudError
        If there are none.

    """
    found = [
        path
        for path in sorted(folder.rglob('*'))
        if path.suffix.lower() in suffixes
        and path.is_file()
        and not any(part.startswith('.') for part in path.relative_to(folder).parts)
    ]
    if not found:
        raise CloudError(f'the folder {folder}', f'one with files of {" ".join(suffixes)}', 'none')
    return found


def listed(folder: RecordingPath) -> dict[str, Location]:
    """Describe all recordings in a folder, to its depth, by their paths; none if it is not there.

    Raises
    ------
    RecordingError
        If it cannot be reached.

    """
    with reached(folder):
        return {str(one.path): one for one in _recordings(folder)} if folder.is_dir() else {}


def location_of(path: RecordingPath) -> Location:
    """Describe a recording as it is now.

    Raises
    ------
    RecordingError
        If it cannot be reached.

    """
    with reached(path):
        return _location(path, _files(path))


@contextmanager
def staged(
    location: Location, scratch: Path | None = None, most: int = MOST_STAGED
) -> Iterator[RecordingPath]:
    """Give a path by which a recording can be read; copy it to this machine where it must be.

    Parameters
    ----------
    location : the recording
    scratch : folder for the copy, which is removed at the end; None: the system's
    most : bytes that a copy may have

    Raises
    ------
    RecordingError
        If it has more bytes, cannot be reached, or has changed since it was found.

    """
    if isinstance(location.path, Path) or location.by_ranges:
        yield location.path
        return
    if location.size > most:
        must_be = f'of at most {most} bytes, to be copied to this machine'
        raise RecordingError(f'the recording {location.path}', must_be, location.size)
    with TemporaryDirectory(prefix='.lidar_outlier_filter-', dir=scratch) as folder:
        target = Path(folder, location.path.name)
        with reached(location.path):
            _copy(location.path, target)
        location.check_unchanged()
        yield target


def _matching(path: RecordingPath) -> list[RecordingPath]:
    """Return the path, or what fits it, if it is a pattern and nothing has it as its name."""
    if not any(letter in str(path) for letter in '*?[') or path.exists():
        return [path]
    found: list[RecordingPath]
    if isinstance(path, Path):
        found = [*Path(path.anchor).glob(str(path.relative_to(path.anchor)))]
    else:
        found = [RemotePath(path.system, key) for key in path.system.glob(path.key)]
    return [one for one in found if not one.name.startswith('.')]


def _recordings(path: RecordingPath) -> Iterator[Location]:
    """Describe a recording, or those below a folder."""
    files = _files(path)
    folders = {str(file.parent) for file in files if file.name == METADATA}
    groups: dict[str, dict[RecordingPath, _State]] = {}
    for file, state in files.items():
        inside = str(file)[len(str(path)) :].lstrip('/')
        if any(part.startswith('.') for part in inside.split('/')):
            continue
        if str(file.parent) in folders:
            groups.setdefault(str(file.parent), {})[file] = state
        elif file.suffix in SUFFIXES:
            yield _location(file, {file: state})
    for group in groups.values():
        yield _location(next(iter(group)).parent, group)


def _location(path: RecordingPath, files: dict[RecordingPath, _State]) -> Location:
    """Describe a recording by its files."""
    states = sorted((file.name, *state) for file, state in files.items())
    size = sum(state.size for state in files.values())
    by_ranges = all(file.suffix in {'.mcap', '.yaml'} for file in files)
    if isinstance(path, Path):
        kind, by_ranges = 'mtime', True
    else:
        kind = 'etag'
    mark = states[0][-1] if len(states) == 1 else sha256(repr(states).encode()).hexdigest()
    return Location(path, size, f'{kind}:{mark}', by_ranges, path not in files)


def _files(path: RecordingPath) -> dict[RecordingPath, _State]:
    """List all files of a folder, to its depth, with their states; or the one file."""
    if isinstance(path, Path):
        inside = sorted(path.rglob('*')) if path.is_dir() else [path]
        stats = {file: file.stat() for file in inside if file.is_file()}
        return {
            file: _State(stat.st_size, f'{stat.st_mtime_ns} {stat.st_ino}')
            for file, stat in stats.items()
        }
    found = path.system.find(path.key, detail=True)
    return {
        RemotePath(path.system, key): _State(int(info['size']), _mark(info))
        for key, info in sorted(found.items())
    }


def _mark(info: Mapping[str, object]) -> str:
    """Return what a store changes with the content of a file."""
    names = ('ETag', 'etag', 'version_id', 'LastModified', 'mtime', 'created')
    return next((str(info[name]).strip('"') for name in names if info.get(name)), '')


def _copy(source: RemotePath, target: Path) -> None:
    if not source.is_dir():
        source.system.get_file(source.key, str(target))
        return
    target.mkdir()
    for file in source.iterdir():
        if file.is_file():
            source.system.get_file(file.key, str(target / file.name))
