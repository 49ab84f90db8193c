# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Notes that a run keeps beside its unfinished output, and what a killed run left.

A run that goes on reads its input from the beginning, so that its state is that of an unbroken run.
Only the clouds are not judged again whose answers the killed run has left in whole chunks: these
answers are taken as they are, if their checksum is the noted one.
"""

from __future__ import annotations

import json
import shutil
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple
from zlib import crc32

from lidar_outlier_filter.disk.new_files import held_leftovers
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.pipeline.topics import output_topics, resolve
from lidar_outlier_filter.recordings.salvage.losses import Losses
from lidar_outlier_filter.recordings.salvage.mcap import DamagedMcap

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

NOTES = '.notes-of-the-run'
_MOST = 2**62  # bytes of a message: our own output is not bounded


class Done(NamedTuple):
    """How far one topic is.

    Attributes
    ----------
    read, checksum : clouds read, and the checksum of their bytes
    answered : number of the last cloud that is answered, from 1
    counts : of :class:`~lidar_outlier_filter.pipeline.statistics.Statistics`, for those answered

    """

    read: int
    checksum: int
    answered: int
    counts: Mapping[str, Any]


class Left:
    """The answers that a killed run left: the first ``answers`` of the output, and how far it was.

    ``topics`` has, by the name of the topic of clouds, what was done.
    """

    def __init__(self, folder: Path, bag: Path, lines: list[dict[str, Any]]) -> None:
        """Find the last note whose answers are all there, with the noted checksum."""
        self.folder = folder
        self.answers = 0
        self.topics: dict[str, Done] = {}
        self._file = DamagedMcap(bag, _MOST, Losses()) if bag.is_file() else None
        self._names = {
            name for line in lines for one in line['topics'] for name in output_topics(resolve(one))
        }
        noted = {line['answers']: line for line in lines}
        count = checksum = 0
        for k, (_, data) in enumerate(self._stored()):
            checksum, count = crc32(data, checksum), (k + 1) // 2
            if k % 2 and count in noted:
                if noted[count]['checksum'] != checksum:
                    break
                self.answers = count
                self.topics = {name: Done(*done) for name, done in noted[count]['topics'].items()}
        self._next = self._stored()

    def take(self, names: tuple[str, str]) -> list[bytes]:
        """Take the next answer: the cleaned and the outlier cloud, on topics of these names."""
        found = [next(self._next, ('', b'')) for _ in names]
        if tuple(name for name, _ in found) != names:
            refuse_other(self.folder, 'recording')
        return [data for _, data in found]

    def _stored(self) -> Iterator[tuple[str, bytes]]:
        """Read the topic and bytes of all answers in whole chunks, in their order."""
        if self._file is None:
            return
        topics = {one.id: one.topic for one in self._file.connections if one.topic in self._names}
        for number, _, data in self._file.messages():
            if number in topics:
                yield topics[number], data


class Journal:
    """Notes on the answers that are written, a line for each time that some are."""

    def __init__(self, folder: Path, head: Mapping[str, Any], left: Left | None = None) -> None:
        """Begin the notes in a folder; ``left`` are answers that need not be made again."""
        self.left = left
        self._stream = (folder / NOTES).open('x', encoding='utf-8', buffering=1)
        self._answers = self._checksum = 0
        self._topics: dict[str, Done] = {}
        self._write(head)

    def done(self, topic: str) -> Done:
        """Return how far the killed run was with a topic."""
        nothing = Done(0, 0, 0, {})
        return nothing if self.left is None else self.left.topics.get(topic, nothing)

    def answer(self, pair: list[bytes]) -> None:
        """Count an answer that is written."""
        self._answers += 1
        for data in pair:
            self._checksum = crc32(data, self._checksum)

    def note(self, topic: str, done: Done) -> None:
        """Note how far a topic is, once all that was left is taken."""
        self._topics[topic] = done
        if self.left is None or self._answers >= self.left.answers:
            self._write(
                {'answers': self._answers, 'checksum': self._checksum, 'topics': self._topics}
            )

    def stop(self) -> None:
        """Note no more: what comes cannot be gone on from."""
        self._stream.close()

    def _write(self, line: Mapping[str, Any]) -> None:
        if not self._stream.closed:
            self._stream.write(json.dumps(line) + '\n')


@contextmanager
def left_for(output: Path, head: Mapping[str, Any]) -> Iterator[Left | None]:
    """Find what killed runs left for an output; remove it at the end, unless there is an error.

    Raises
    ------
    RecordingError
        If the runs were others: of another recording, or with other parameters.

    """
    head = json.loads(json.dumps(head))
    with held_leftovers(output) as folders:
        lefts: list[Left] = []
        others: list[tuple[Path, str]] = []
        for folder in folders:
            first, *lines = _lines(folder / NOTES) or [{}]
            if first == head:
                bag = folder / output.name / f'{output.name}.mcap'
                lefts.append(Left(folder, bag, lines))
            elif first:
                others.append(
                    (folder, next((key for key in head if first.get(key) != head[key]), 'version'))
                )
        if others and not lefts:
            refuse_other(*others[0])
        yield max(lefts, key=lambda left: left.answers, default=None)
        for folder in folders:
            shutil.rmtree(folder, ignore_errors=True)


def refuse_other(folder: Path, what: str) -> None:
    """Refuse to go on from a run that was another one."""
    raise RecordingError(f'the {what} of the killed run that left {folder}', 'the same', 'another')


def _lines(path: Path) -> list[dict[str, Any]]:
    """Read notes up to the first that was not written in full."""
    lines: list[dict[str, Any]] = []
    if path.is_file():
        for text in path.read_text('utf-8', errors='replace').splitlines():
            try:
                lines.append(json.loads(text))
            except ValueError:
                break
    return lines
