# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The manifest of an archive: what became of each recording, a line of JSON each."""

from __future__ import annotations

import json
import os
import sys
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, TYPE_CHECKING, Any, NamedTuple

from lidar_outlier_filter.archive.places import place_of
from lidar_outlier_filter.errors import RecordingError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from lidar_outlier_filter.archive.places import Place
    from lidar_outlier_filter.recordings.remote_path import RecordingPath, RemotePath

if sys.platform != 'win32':
    import fcntl

NAME = 'manifest.jsonl'
DONE, FAILED = 'done', 'failed'
BROKEN_OFF = 'the run that wrote it must be ended, got broken off'  # until a run writes more


@dataclass(frozen=True)
class Entry:
    """What became of one recording.

    Attributes
    ----------
    source, size : where it lies, and its bytes
    hash : of the source: SHA-256, or ``etag:`` and the mark that a store gave it
    source_state, output_state : times of the files, or marks of the store, when this was written
    parameters, version, model : of the filter: SHA-256 of the values, version, SHA-256 of the files
    output, output_hash : where the result lies, and its SHA-256, or ``etag:`` …
    state, error : ``done``, or ``failed`` and the sentence that says why
    topics : of each topic of clouds, counts by their names
    unread : messages that the recording counts, and that were not found in it
    lost : what could not be salvaged of a damaged recording, a sentence each
    seconds, duration : that it took, and of sensor time
    worker : who judged it
    finished : when, as ISO 8601

    """

    source: str
    size: int
    hash: str
    parameters: str
    version: str
    model: str
    output: str
    state: str
    output_hash: str = ''
    source_state: str = ''
    output_state: str = ''
    error: str | None = None
    topics: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    unread: int = 0
    lost: Sequence[str] = ()
    seconds: float = 0.0
    duration: float = 0.0
    worker: str = ''
    finished: str = ''

    @property
    def refused(self) -> int:
        """Count the clouds without an answer."""
        return sum(int(counts['refused']) for counts in self.topics.values())

    @property
    def untested(self) -> Mapping[str, str]:
        """The topics of which no point could be tested, and why."""
        found = {name: counts.get('untested_because', '') for name, counts in self.topics.items()}
        return {name: reason for name, reason in found.items() if reason}

    @property
    def is_complete(self) -> bool:
        """Whether every message is in the output, and every cloud has an answer that was judged."""
        lacks = self.refused or self.untested or self.unread or self.lost
        return self.state == DONE and not lacks


class How(NamedTuple):
    """What decides what is written of a source, as an entry has it."""

    parameters: str
    version: str
    model: str


def begun(source: Place, output: RecordingPath, how: How) -> Entry:
    """Make the entry of a source that is begun: what a killed run leaves is ours by it."""
    return Entry(
        source=str(source.path),
        size=source.size,
        hash='',
        output=str(output),
        state=FAILED,
        source_state=source.state,
        error=BROKEN_OFF,
        **how._asdict(),
    )


class Manifest:
    """The entries of an output folder, by their sources; the last one of a source counts."""

    def __init__(self, path: Path, stream: IO[bytes], sync: Callable[[], object]) -> None:
        """Read what is there; ``stream`` is open for reading and appending.

        ``sync`` is called when the file has changed.
        """
        self._path, self._stream, self._sync = path, stream, sync
        self.entries: dict[str, Entry] = {}
        stream.seek(0)
        whole = 0
        for number, line in enumerate(stream, 1):
            if not line.endswith(b'\n'):
                break  # the process was killed while it wrote
            entry = self._read(number, line)
            self.entries[entry.source] = entry
            whole += len(line)
        stream.truncate(whole)

    def add(self, entry: Entry) -> None:
        """Write what became of a recording; it is on the disk when this returns."""
        self._stream.write(_line(entry))
        self._stream.flush()
        os.fsync(self._stream.fileno())
        self._sync()
        self.entries[entry.source] = entry

    def _read(self, number: int, line: bytes) -> Entry:
        known = {item.name for item in fields(Entry)}
        try:
            values = json.loads(line)
            return Entry(**{name: value for name, value in values.items() if name in known})
        except (ValueError, TypeError, AttributeError) as err:
            what = f'line {number} of {self._path}'
            raise RecordingError(what, 'an entry of a manifest', f'"{err}"') from err

    def tidy(self) -> None:
        """Leave one line for each source, in the order of their names."""
        beside = self._path.with_name(f'.{self._path.name}.partial')
        lines = [_line(self.entries[source]) for source in sorted(self.entries)]
        beside.write_bytes(b''.join(lines))
        beside.replace(self._path)
        self._sync()


@contextmanager
def opened_manifest(folder: RecordingPath) -> Iterator[Manifest]:
    """Open the manifest of a folder, which is made where there is none; one run at a time.

    That of a store is a file of this machine meanwhile, and goes there whole after each line. So
    it says there, too, what was begun and what is done, however this run ends.

    Raises
    ------
    RecordingError
        If it is no manifest, or another run uses it, or it cannot be written.

    """
    if isinstance(folder, Path):
        with _opened(folder / NAME, lambda: None) as manifest:
            yield manifest
        return
    with TemporaryDirectory(prefix='.lidar_outlier_filter-') as scratch:
        there, here = folder / NAME, Path(scratch, NAME)
        upload = _Upload(here, there)
        if there.exists():
            here.write_text(there.read_text('utf-8'), 'utf-8')
        with _opened(here, upload) as manifest:
            yield manifest


class _Upload:
    """Writes a file to a store again and again, as long as nobody else does."""

    def __init__(self, here: Path, there: RemotePath) -> None:
        self._here, self._there = here, there
        self._state = place_of(there).state

    def __call__(self) -> None:
        """Write it there, in place of what this run has written or found there."""
        if place_of(self._there).state != self._state:
            must_be = 'written by one run at a time'
            raise RecordingError(f'the manifest {self._there}', must_be, 'two that write')
        self._there.write_from(self._here)
        self._state = place_of(self._there).state


@contextmanager
def _opened(path: Path, sync: Callable[[], object]) -> Iterator[Manifest]:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        stream = path.open('ab+')
    except OSError as err:
        raise RecordingError(f'the manifest {path}', 'writable', err.strerror) from err
    with stream:
        _lock(path, stream)
        manifest = Manifest(path, stream, sync)
        yield manifest
        manifest.tidy()


def _line(entry: Entry) -> bytes:
    return json.dumps(asdict(entry), sort_keys=True).encode() + b'\n'


def _lock(path: Path, stream: IO[bytes]) -> None:
    """Refuse a second run; the system lets go of the lock however this one ends."""
    if sys.platform == 'win32':
        return
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as err:
        raise RecordingError(f'the manifest {path}', 'used by one run at a time', 'two') from err
