# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The sidecar of an output: what it was made from, its fingerprint, and counts, as JSON.

It carries a seal, the hash of its own content. A file without a valid seal was not written by a
run, or was edited since.
"""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.archive.fingerprints import FileMark
from lidar_outlier_filter.archive.storage import exists, files_below, foreign, read_all

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lidar_outlier_filter.archive.storage import State
    from lidar_outlier_filter.recordings.remote_path import RecordingPath

DONE, FAILED, NO_CLOUDS = 'done', 'failed', 'no clouds'
SUFFIX = '.json'  # after the name of an output
RECORD, SEAL = 'archive', 'seal'  # keys; others are those of the log of a cleaned file
MAX_BYTES = 2**24  # of a sidecar; a larger file is not one
_BROKEN = (ValueError, TypeError, LookupError, AttributeError, RecursionError)


@dataclass(frozen=True)
class ArchiveRecord:
    """The result for one recording or file; that of a failed one is not written.

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
        return self.state == DONE and not lacks


def as_text(record: ArchiveRecord, log: Mapping[str, Any]) -> str:
    """Write a sidecar: a log, the record, and the seal."""
    values = json.loads(json.dumps({**log, RECORD: asdict(record)}))
    return json.dumps({**values, SEAL: _seal(values)}, indent=1) + '\n'


def parse(text: bytes) -> ArchiveRecord:
    """Read the record of a sidecar.

    Raises
    ------
    ValueError
        If it is no sidecar, or was changed since it was written.

    """
    try:
        values = json.loads(text)
        if values.pop(SEAL) != _seal(values):
            raise ValueError
        record = ArchiveRecord(**values[RECORD])
        outputs = {name: FileMark(*mark) for name, mark in record.outputs.items()}
        return replace(record, outputs=outputs)
    except _BROKEN as err:
        raise ValueError from err


def _seal(values: Mapping[str, Any]) -> str:
    return sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


def read(path: RecordingPath) -> ArchiveRecord | None:
    """Read a sidecar; None if there is none."""
    records: list[ArchiveRecord] = []
    with suppress(FileNotFoundError):  # removed by a run at the same time
        found = files_below(path)
        if not found and not isinstance(path, Path):
            return None
        if [*found] == [path] and not (isinstance(path, Path) and path.is_symlink()):
            records = _parsed(found)
    if not records and exists(path):
        raise foreign(path)
    return records[0] if records else None


def read_folder(folder: RecordingPath) -> list[ArchiveRecord]:
    """Read all sidecars in a folder, recursively; other and hidden files are skipped."""
    start = len(str(folder))
    found = files_below(folder).items() if exists(folder) else ()
    return _parsed({path: state for path, state in found if '/.' not in str(path)[start:]})


def _parsed(files: Mapping[RecordingPath, State]) -> list[ArchiveRecord]:
    small = [path for path, (size, _) in files.items() if size <= MAX_BYTES]
    found = []
    for text in read_all(path for path in small if path.suffix == SUFFIX):
        with suppress(ValueError):
            found.append(parse(text))
    return found
