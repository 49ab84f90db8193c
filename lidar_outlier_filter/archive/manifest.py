# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The manifest of an archive: what became of each recording or file, a line of JSON each."""

from __future__ import annotations

import json
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from lidar_outlier_filter.archive.logs import NoLog, StoreLog, opened_file
from lidar_outlier_filter.archive.task import last_parts
from lidar_outlier_filter.errors import RecordingError, said_by

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from lidar_outlier_filter.archive.logs import Log
    from lidar_outlier_filter.archive.task import Task
    from lidar_outlier_filter.recordings.remote_path import RecordingPath

NAME = 'manifest.jsonl'
DONE, FAILED, NO_CLOUDS = STATES = ('done', 'failed', 'no clouds')
BROKEN_OFF = 'the run that wrote it must be ended, got broken off'  # until a run writes more


# Of the fields of an entry in JSON, and of what is counted for a topic.
KINDS: Mapping[str, tuple[type, ...]] = {
    'str': (str,),
    'int': (int,),
    'float': (int, float),
    'str | None': (str, type(None)),
    'Sequence[str]': (list, tuple),
    'Mapping[str, Mapping[str, Any]]': (dict,),
}
COUNTED = ('messages', 'points', 'kept', 'rejected', 'untested', 'refused', 'gaps')
BEGIN = b'{"duration": '  # of each line: its fields are sorted


@dataclass(frozen=True)
class Entry:
    """What became of one recording, or one file.

    Attributes
    ----------
    source, size : where it lies below the folder that was searched, and its bytes; a file's name
    hash : of the source: SHA-256, or ``etag:`` and the mark that a store gave it
    source_state, output_state : times of the files, or marks of the store, when this was written
    parameters, version, model : of the filter: SHA-256 of the values, version, SHA-256 of the files
    output, output_hash : where the result lies below the folder of the manifest, and its SHA-256,
        or ``etag:`` …
    state, error : ``done``; ``failed``, or ``no clouds``, and the sentence that says why
    topics : of each topic of clouds, counts by their names; of a file, its one cloud
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
    def is_ours(self) -> bool:
        """Whether a run has written its output, or was about to."""
        return self.state == DONE or self.error == BROKEN_OFF

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


def begun(task: Task, how: How) -> Entry:
    """Make the entry of a source that is begun: what a killed run leaves is ours by it."""
    return Entry(
        source=task.source,
        size=task.location.size,
        hash='',
        output=task.made,
        state=FAILED,
        source_state=task.location.state,
        error=BROKEN_OFF,
        **how._asdict(),
    )


class Manifest:
    """The entries of an output folder, by their sources; the last one of a source counts.

    In the file a refusal does not take the place of what was done: that is still there.
    """

    def __init__(self, log: Log, folder: RecordingPath | None) -> None:
        """Read what a log says of the outputs in ``folder``; None: they have none in common.

        What cannot be read of it is left out, and a sentence each in ``unread``; a log without any
        entry is refused, as it is none of ours.
        """
        self._log, self.folder = log, folder
        self.entries: dict[str, Entry] = {}
        self._done: dict[str, Entry] = {}
        self.unread: list[RecordingError] = []
        whole, name = 0, _name(folder)
        for number, line in enumerate(log.lines(), 1):
            is_ours = whole > 0 or line[: len(BEGIN)] == BEGIN[: len(line)]
            if is_ours and not line.endswith(b'\n'):
                break  # the process was killed while it wrote
            whole += len(line)
            try:
                self._note(read_entry(line, name))
            except (ValueError, TypeError, LookupError, AttributeError) as err:
                what = f'line {number} of {folder and folder / NAME}'
                wrong = RecordingError(what, 'an entry of a manifest', said_by(err))
                self.unread.append(wrong)
        if self.unread and not self.entries:
            raise self.unread[0]
        log.keep(whole)
        noted = (*self._done.values(), *self.entries.values())
        self._written = {one.output: one for one in noted if one.is_ours}

    def add(self, entry: Entry) -> None:
        """Note what became of one; it is there for good after :meth:`flush`."""
        self._note(entry)
        self._log.append(_line(self._kept(entry.source)[-1]))

    def flush(self) -> None:
        """Write what was added."""
        self._log.flush()

    def writer(self, output: str) -> Entry | None:
        """Return what an earlier run said last of an output that is its own, done or broken off."""
        return self._written.get(output)

    def _note(self, entry: Entry) -> None:
        self.entries[entry.source] = entry
        if entry.state == DONE:
            self._done[entry.source] = entry

    def _kept(self, source: str) -> list[Entry]:
        """Give what the file is to say of a source: what is done, and what was begun since."""
        last, done = self.entries[source], self._done.get(source)
        if done is None or last.state != FAILED:
            return [last]
        return [done, last] if last.error == BROKEN_OFF else [done]

    def tidy(self) -> None:
        """Leave the lines that count, in the order of the names of their sources.

        Not that of a source that was not there: its name was mistyped.
        """
        kept = (entry for source in sorted(self.entries) for entry in self._kept(source))
        lines = (_line(one) for one in kept if one.source_state or one.state != FAILED)
        self._log.replace(b''.join(lines))


def read_entry(line: bytes, folder: str) -> Entry:
    """Read an entry for the outputs in a folder of this name.

    Raises
    ------
    ValueError, LookupError, TypeError, AttributeError
        If it is none.

    """
    kinds = {item.name: KINDS[str(item.type)] for item in fields(Entry)}
    values = _named_below(json.loads(line), folder)
    entry = Entry(**{name: value for name, value in values.items() if name in kinds})
    counts = [topic[name] for topic in entry.topics.values() for name in COUNTED]
    right = [isinstance(getattr(entry, name), kind) for name, kind in kinds.items()]
    if not all((*right, *(isinstance(one, int) for one in counts), entry.state in STATES)):
        raise TypeError
    for topic in entry.topics.values():
        topic['rejected_by'].items()
    return entry


def _named_below(values: dict[str, Any], folder: str) -> dict[str, Any]:
    """Name source and output as now: they were absolute, and as typed."""
    source, output = values['source'], values['output']
    if not source.startswith('/') and '://' not in source:
        return values
    made = f'/{output}'.rpartition(f'/{folder}/')[2].strip('/')
    return {**values, 'source': last_parts(source, made.count('/') + 1), 'output': made}


@contextmanager
def opened_manifest(
    folder: RecordingPath | None, inform: Callable[[str], object] = str
) -> Iterator[Manifest]:
    """Open the manifest of a folder, which is made where there is none; one run at a time.

    Without a folder it is that of one run, and forgotten at its end.

    ``inform`` gets a sentence for each line that cannot be read: it costs what it was on.

    Raises
    ------
    RecordingError
        If it is no manifest, or another run uses it, or it cannot be written.

    """
    with ExitStack() as stack:
        log: Log = NoLog()
        if isinstance(folder, Path):
            log = stack.enter_context(opened_file(folder / NAME))
        elif folder is not None:
            log = StoreLog(folder / NAME)
        manifest = Manifest(log, folder)
        for wrong in manifest.unread:
            inform(str(wrong))
        yield manifest
        manifest.tidy()


def _name(folder: RecordingPath | None) -> str:
    if folder is None:
        return ''
    return folder.resolve().name if isinstance(folder, Path) else folder.name


def _line(entry: Entry) -> bytes:
    return json.dumps(asdict(entry), sort_keys=True).encode() + b'\n'
