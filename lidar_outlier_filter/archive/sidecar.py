# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The sidecar of an output: what it was made from, its fingerprint, and counts, as JSON."""

import json
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import lidar_outlier_filter
from lidar_outlier_filter.archive.locations import (
    Location,
    exists,
    file_hash,
    file_state,
    files_below,
    foreign,
    read_all,
)
from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.core.points.mask import content_of
from lidar_outlier_filter.parameters.filter import WITHOUT_EFFECT, FilterParameters
from lidar_outlier_filter.recordings.remote_path import RecordingPath

DONE, FAILED, NO_CLOUDS = 'done', 'failed', 'no clouds'
SUFFIX = '.json'  # after the name of an output
RECORD = 'archive'  # key; others are those of the log of a cleaned file
MAX_BYTES = 2**24  # of a sidecar; a larger file is not one
_BROKEN = (ValueError, TypeError, LookupError, AttributeError, RecursionError)

# Folders of the package whose code decides the bytes of an output.
ROOMS = ('core', 'files', 'messages', 'parameters', 'pipeline', 'recordings')


class FileMark(NamedTuple):
    """The fingerprint of one file: size, SHA-256, and a state to detect changes cheaply.

    ``state`` is the time of modification on a file system, the ETag on a store.
    """

    size: int
    sha256: str
    state: str


@dataclass(frozen=True)
class ArchiveRecord:
    """The result for one recording or file; failed ones are not written.

    Attributes
    ----------
    source, size, source_state, source_hash : the input: its path below the folder that was
        searched, bytes, and fingerprint
    output : path of the output, a file or a folder, below the folder of all outputs
    parameters, code : the hash of parameters and options; version and hash of the code
    state, error : ``done``, ``no clouds`` or ``failed``, and the reason
    outputs : the fingerprints of the files that were written, by path below the output folder
    topics : counts of each topic; a file has one
    unread : messages that the recording counts, but that were not found
    lost : losses of a damaged recording, a sentence each
    seconds, duration : time that it took, and sensor time
    worker, finished : process that did it, and when, as ISO 8601

    """

    source: str
    output: str
    size: int
    source_state: str
    source_hash: str = ''
    parameters: str = ''
    code: str = ''
    state: str = FAILED
    error: str | None = None
    outputs: Mapping[str, FileMark] = field(default_factory=dict)
    topics: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    unread: int = 0
    lost: Sequence[str] = ()
    seconds: float = 0.0
    duration: float = 0.0
    worker: str = ''
    finished: str = ''

    @property
    def is_done(self) -> bool:
        """Whether it has an output."""
        return self.state == DONE

    @property
    def is_failed(self) -> bool:
        """Whether it should have an output, but has none."""
        return self.state == FAILED

    @property
    def refused(self) -> int:
        """Count the clouds without a result."""
        return sum(counts['refused'] for counts in self.topics.values())

    @property
    def untested(self) -> Mapping[str, str]:
        """The topics of which no point could be tested, and why."""
        found = {name: counts['untested_because'] for name, counts in self.topics.items()}
        return {name: reason for name, reason in found.items() if reason}

    @property
    def is_complete(self) -> bool:
        """Whether every message is in the output, and every cloud has a tested result."""
        lacks = self.refused or self.untested or self.unread or self.lost
        return self.is_done and not lacks


def as_text(record: ArchiveRecord, log: Mapping[str, Any]) -> str:
    """Write a sidecar: a log, and the record."""
    return json.dumps({**log, RECORD: asdict(record)}, indent=1) + '\n'


def _parsed(texts: Iterable[bytes]) -> list[ArchiveRecord]:
    """Read the records of sidecars; other texts are passed over."""
    found = []
    for text in texts:
        with suppress(*_BROKEN):
            record = ArchiveRecord(**json.loads(text)[RECORD])
            marks = {name: FileMark(*mark) for name, mark in record.outputs.items()}
            found.append(replace(record, outputs=marks))
    return found


def read(path: RecordingPath) -> ArchiveRecord | None:
    """Read a sidecar; None if it does not exist."""
    if not exists(path):
        return None
    is_small = _is_plain(path) and file_state(path)[0] <= MAX_BYTES
    records = _parsed(read_all([path])) if is_small else []
    if not records:
        raise foreign(path)
    return records[0]


def read_folder(folder: RecordingPath) -> list[ArchiveRecord]:
    """Read all sidecars in a folder, recursively; other and hidden files are skipped."""
    start = len(str(folder))
    return _parsed(
        read_all(
            path
            for path, (size, _) in files_below(folder).items()
            if path.suffix == SUFFIX and size <= MAX_BYTES and '/.' not in str(path)[start:]
        )
    )


def mark_of(path: RecordingPath) -> FileMark:
    """Read a file and return its fingerprint."""
    size, state = file_state(path)
    return FileMark(size, file_hash(path), state)


def agrees(path: RecordingPath, mark: FileMark, *, read: bool = False) -> bool:
    """Return whether a file has the fingerprint; ``read`` does not trust an equal state."""
    if isinstance(path, Path) and not _is_plain(path):
        return False
    size, state = file_state(path)
    is_same = state == mark.state and not read
    return size == mark.size and (is_same or file_hash(path) == mark.sha256)


def _is_plain(path: RecordingPath) -> bool:
    """Return whether a path is a file, and no link to one."""
    return path.is_file() and not (isinstance(path, Path) and path.is_symlink())


def content_hash(location: Location) -> str:
    """Return the SHA-256 of an input (of a folder: names and hashes); on a store, its state.

    A file of a store is not read a second time for this.
    """
    path = location.path
    if not isinstance(path, Path):
        return location.state
    if path.is_file():
        return file_hash(path)
    return _hash_files(file for file in path.iterdir() if file.is_file())


def parameters_hash(parameters: FilterParameters, options: Mapping[str, object]) -> str:
    """Hash the parameters and options that decide the bytes of an output."""
    values = {k: v for k, v in parameters.flat().items() if k not in WITHOUT_EFFECT}
    values['mask'] = content_of(parameters)
    if track := options.get('trajectory'):
        values['trajectory'] = _hash_files([Path(str(track))])
    homes = (DETECTORS[name].home for name in parameters.chain)
    plugins = sorted({home for home in homes if not home.startswith(lidar_outlier_filter.__name__)})
    said = json.dumps([values, options, [_sources(home) for home in plugins]], sort_keys=True)
    return sha256(said.encode()).hexdigest()


@cache
def code_version() -> str:
    """Return the version of the package with a hash of the code and models that judge."""
    root = Path(str(lidar_outlier_filter.__file__)).parent
    files = [file for room in ROOMS for file in (root / room).rglob('*')]
    own = _hash_files(file for file in files if file.suffix in {'.py', '.json'})
    return f'{lidar_outlier_filter.__version__}+{own[:12]}'


@cache
def _sources(module: str) -> str:
    """Hash the source of a plug-in: its module, or all modules of its package."""
    spec = find_spec(module)
    folders = spec.submodule_search_locations if spec is not None else None
    if folders:
        return _hash_files(file for one in folders for file in Path(one).rglob('*.py'))
    return _hash_files([Path(spec.origin)] if spec is not None and spec.origin else [])


def _hash_files(files: Iterable[Path]) -> str:
    said = ''.join(f'{one.name} {file_hash(one)}\n' for one in sorted(files))
    return sha256(said.encode(errors='surrogateescape')).hexdigest()
