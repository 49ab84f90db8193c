# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings and files, on this machine or on a store that fsspec opens, such as ``s3://``.

They are found, listed and copied here, and small ones are read.

Credentials and endpoints of a store are those of fsspec and of its file system.
"""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import file_digest, sha256
from pathlib import Path
from tempfile import TemporaryDirectory

from lidar_outlier_filter.errors import FilterError, RecordingError
from lidar_outlier_filter.recordings.remote_path import RecordingPath, RemotePath, reached

State = tuple[int, str]  # bytes, and what changes with the content

METADATA = 'metadata.yaml'  # in the folder of a ROS 2 recording
RECORDING_SUFFIXES = ('.mcap', '.db3', '.bag')
MAX_STAGED_BYTES = 64 * 2**30
PATTERN = '*?['
_MARKS = ('ETag', 'etag', 'version_id', 'LastModified', 'mtime', 'created')


@dataclass(frozen=True)
class Location:
    """A recording or file that was found.

    Attributes
    ----------
    path : what :class:`Recording` opens
    size : bytes of all its files
    state : changes with the content: ``mtime:`` and times, or ``etag:`` and the mark of a store
    by_ranges : whether it is read where it lies; otherwise :func:`staged` copies it first
    is_folder : whether it is a folder of files

    """

    path: RecordingPath
    size: int
    state: str
    by_ranges: bool = True
    is_folder: bool = False

    def check_unchanged(self, what: str = 'recording') -> None:
        """Refuse a recording or file that changed since it was found."""
        now = location_of(self.path)
        if (now.size, now.state) != (self.size, self.state):
            got = f'{now.size} bytes and {now.state} after {self.size} bytes and {self.state}'
            raise RecordingError(f'the {what} {self.path}', 'unchanged while it is read', got)


def path_at(address: str) -> RecordingPath:
    """Return the path of an address: a path of this machine, or ``PROTOCOL://…``."""
    if not address:
        raise FilterError('a path', 'given', "''")
    if '://' not in address:
        return Path(address)
    try:
        from fsspec.core import url_to_fs  # noqa: PLC0415  an extra
    except ModuleNotFoundError as err:
        must_be = 'installed for such addresses (pip install lidar_outlier_filter[archive,s3])'
        raise RecordingError('the module fsspec', must_be, address) from err
    with reached(address):
        system, key = url_to_fs(address, use_listings_cache=False)
    return Path(key) if 'file' in system.protocol else RemotePath(system, key.rstrip('/'))


def is_recording(path: RecordingPath) -> bool:
    """Return whether a path is a single recording.

    One that was not closed has no metadata, but files that are named after its folder.
    """
    if not path.is_dir():
        return path.suffix in RECORDING_SUFFIXES
    return (path / METADATA).exists() or any(
        one.suffix in {'.mcap', '.db3'} and one.name.startswith(path.name) for one in path.iterdir()
    )


def find(address: str) -> list[Location]:
    """Find the recordings at an address: a recording, a folder of recordings, or a pattern.

    Folders are searched recursively; hidden files are skipped.
    """
    with reached(address):
        locations = [one for path in _matching(path_at(address)) for one in _recordings(path)]
    if not locations:
        must_be = 'a recording, a folder of recordings, or a pattern for some'
        raise RecordingError(f'what is at {address}', must_be, 'no recording')
    found = {str(location.path): location for location in locations}
    return [found[name] for name in sorted(found)]


def find_files(folder: Path, suffixes: Sequence[str]) -> list[Path]:
    """Find the files of a folder that have one of the suffixes; see :func:`find`."""
    return [
        path
        for path in sorted(folder.rglob('*'))
        if path.suffix.lower() in suffixes
        and path.is_file()
        and not any(part.startswith('.') for part in path.relative_to(folder).parts)
    ]


def location_of(path: RecordingPath) -> Location:
    """Describe a recording or file as it is now."""
    return _location(path, files_below(path))


@contextmanager
def staged(location: Location, most: int = MAX_STAGED_BYTES) -> Iterator[RecordingPath]:
    """Give a path by which a recording can be read; copy it to this machine if necessary."""
    if isinstance(location.path, Path) or location.by_ranges:
        yield location.path
        return
    if location.size > most:
        must_be = f'of at most {most} bytes, to be copied to this machine'
        raise RecordingError(f'the recording {location.path}', must_be, location.size)
    with TemporaryDirectory(prefix='.lidar_outlier_filter-') as folder:
        target = Path(folder, location.path.name)
        with reached(location.path):
            location.path.system.get(location.path.key, str(target), recursive=location.is_folder)
        location.check_unchanged()
        yield target


def _matching(path: RecordingPath) -> list[RecordingPath]:
    """Return the path, or what matches if it is a pattern and no name."""
    if not any(letter in str(path) for letter in PATTERN) or path.exists():
        return [path]
    found: list[RecordingPath]
    if isinstance(path, Path):
        found = [*Path(path.anchor).glob(str(path.relative_to(path.anchor)))]
    else:
        found = [RemotePath(path.system, key) for key in path.system.glob(path.key)]
    return [one for one in found if not one.name.startswith('.')]


def _recordings(path: RecordingPath) -> Iterator[Location]:
    """Describe a recording, or the recordings below a folder."""
    files = files_below(path)
    folders = {str(file.parent) for file in files if file.name == METADATA}
    groups: dict[str, dict[RecordingPath, State]] = {}
    for file, state in files.items():
        inside = str(file)[len(str(path)) :].lstrip('/')
        if any(part.startswith('.') for part in inside.split('/')):
            continue
        if str(file.parent) in folders:
            groups.setdefault(str(file.parent), {})[file] = state
        elif file.suffix in RECORDING_SUFFIXES:
            yield _location(file, {file: state})
    for group in groups.values():
        yield _location(next(iter(group)).parent, group)


def _location(path: RecordingPath, files: Mapping[RecordingPath, State]) -> Location:
    states = sorted((file.name, *state) for file, state in files.items())
    state = states[0][-1] if states else ''
    if len(states) > 1:
        kind, total = state.partition(':')[0], repr(states).encode()
        state = f'{kind}:{sha256(total).hexdigest()}'
    by_ranges = isinstance(path, Path) or all(file.suffix in {'.mcap', '.yaml'} for file in files)
    size = sum(size for size, _ in files.values())
    return Location(path, size, state, by_ranges, path not in files)


def foreign(path: RecordingPath) -> FilterError:
    """Return the error for a file, in the place of an output, that no run left so."""
    must_be = 'new, or an unchanged output of an earlier run'
    return FilterError('the output', must_be, f'{path}, which exists')


def exists(path: RecordingPath) -> bool:
    """Return whether a path is taken, as by a broken link."""
    return os.path.lexists(path) if isinstance(path, Path) else path.exists()


def file_state(path: RecordingPath) -> State:
    """Return the state of a file: ``mtime:`` and its time, or ``etag:`` and the mark of a store."""
    if isinstance(path, Path):
        stat = path.stat()
        return stat.st_size, f'mtime:{stat.st_mtime_ns}'
    with reached(path):
        return _state_of(path.system.info(path.key))


def files_below(path: RecordingPath) -> dict[RecordingPath, State]:
    """List the files of a folder, recursively, with their states; of a file, itself."""
    if isinstance(path, Path):
        inside = [path]
        if path.is_dir():
            inside = sorted(Path(here, name) for here, _, names in os.walk(path) for name in names)
        states: dict[RecordingPath, State] = {}
        for file in inside:
            if file.is_file():
                states[file] = file_state(file)
        return states
    with reached(path):
        found = path.system.find(path.key, detail=True)
    return {RemotePath(path.system, key): _state_of(info) for key, info in sorted(found.items())}


def _state_of(info: Mapping[str, object]) -> State:
    mark = next((str(info[name]).strip('"') for name in _MARKS if info.get(name)), '')
    return int(str(info['size'])), f'etag:{mark}'


def file_hash(path: RecordingPath) -> str:
    """Return the SHA-256 of a file."""
    with path.open('rb') as stream, reached(path):
        return file_digest(stream, 'sha256').hexdigest()  # type: ignore[arg-type]


def read_all(paths: Iterable[RecordingPath]) -> list[bytes]:
    """Read small files of one folder; a store is asked for all of them at once."""
    files = [*paths]
    local = [path.read_bytes() for path in files if isinstance(path, Path)]
    remote = [path for path in files if isinstance(path, RemotePath)]
    if not remote:
        return local
    with reached(remote[0]):
        texts = remote[0].system.cat([path.key for path in remote])
    return [texts[path.key] for path in remote] if isinstance(texts, dict) else [texts]
