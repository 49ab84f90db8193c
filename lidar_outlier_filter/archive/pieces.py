# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Pieces of a recording: stretches of bag time that are judged apart, each by whoever is free.

A piece is read as the replay would read it, but for what comes long before: first the clouds that
decide how all others are read and cut, then those shortly before the piece, without being judged.
"""

from __future__ import annotations

import threading
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import pairwise
from time import perf_counter
from typing import TYPE_CHECKING

from lidar_outlier_filter.archive.fingerprints import judging_code
from lidar_outlier_filter.archive.known_chain import NotingChain
from lidar_outlier_filter.archive.locations import staged
from lidar_outlier_filter.archive.worker_start import name_of_worker
from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.recordings.bags import Recording
from lidar_outlier_filter.recordings.cloud_topic import CloudTopic
from lidar_outlier_filter.recordings.replay import choose_clouds
from lidar_outlier_filter.recordings.unpack import LARGEST

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from lidar_outlier_filter.archive.locations import Location
    from lidar_outlier_filter.recordings.bags import Topic

LENGTH = 10.0  # seconds of bag time of a piece
SHORTEST = 0.8  # of pieces at the end of the last recording, so that all workers end together
TAKEN = 2 / 3  # by a piece there, of what every worker has left
LEAST = 8  # messages of a piece, on average: one without costs as much as one with many
SLACK = 0.5  # seconds read before a piece beyond what is computed: clouds come late, and span time


@dataclass(frozen=True, eq=False)  # one is not another, however alike
class Piece:
    """A stretch of a recording and how it is to be judged.

    Attributes
    ----------
    recording : where it lies, and in what state it was found
    topics : of clouds
    parameters : of the filter, those that are given
    start, stop : bag times, ns; None: from its beginning, to its end
    largest : bytes that a message, or a chunk of messages, may have

    """

    recording: Location
    topics: tuple[str, ...]
    parameters: Mapping[str, object]
    start: int | None
    stop: int | None
    largest: int = LARGEST


@dataclass(frozen=True)
class JudgedPiece:
    """The verdicts of a piece, by the digest of the points; who judged it, for how long, by what.

    ``code`` is of :func:`.fingerprints.judging_code`.
    """

    verdicts: Mapping[bytes, bytes]
    worker: str
    seconds: float
    code: str


def cut(  # noqa: PLR0913  what a piece is made of
    location: Location,
    topics: Collection[str] = (),
    parameters: Mapping[str, object] | None = None,
    length: float = LENGTH,
    largest: int = LARGEST,
    *,
    workers: int = 0,
) -> list[Piece]:
    """Cut a recording into pieces of about so many seconds of bag time.

    Where ``workers`` are given, nothing follows that they could judge meanwhile: then pieces become
    shorter towards the end, each two thirds of what every worker has left.

    Raises
    ------
    RecordingError
        If the recording cannot be read or has no such topic.

    """
    with staged(location) as path, Recording(path, largest) as source:
        chosen = tuple(topic.name for topic in choose_clouds(source, topics, 'a topic to filter'))
        # The length of a recording is one more than the distance of its first and last message.
        duration, begin = source.duration - 1, source.start
        least = duration * LEAST // max(source.message_count, 1)
    steps = _even(duration, round(length * SECOND), least)
    if workers:
        steps = _shrinking(duration, round(length * SECOND), least, workers)
    inner = [begin + sum(steps[:number]) for number in range(1, len(steps))]
    bounds = [None, *inner, None]
    given = dict(parameters or {})
    return [Piece(location, chosen, given, *pair, largest) for pair in pairwise(bounds)]


def _even(duration: int, length: int, least: int) -> list[int]:
    """Cut a duration into stretches of a length at most, but of ``least`` where there are several.

    All are nanoseconds.
    """
    count = max(1, min(duration // max(least, 1), -(-duration // length)))
    ends = [duration * number // count for number in range(count + 1)]
    return [end - begin for begin, end in pairwise(ends)]


def _shrinking(duration: int, length: int, least: int, workers: int) -> list[int]:
    """Cut a duration into stretches that shrink, each a share of what every worker has left.

    None is longer than ``length``, or shorter than ``least`` and ``SHORTEST``.
    """
    least = max(least, min(length, round(SHORTEST * SECOND)))
    steps: list[int] = []
    left = duration
    while left >= 2 * least:
        steps.append(max(least, min(length, round(TAKEN * left / workers))))
        left -= steps[-1]
    return [*steps, left]


def starts(pieces: Sequence[Piece]) -> list[int]:
    """List the bag times, ns, at which all pieces of a recording but the first begin."""
    return [piece.start for piece in pieces if piece.start is not None]


def judge_piece(piece: Piece) -> JudgedPiece:
    """Judge the blocks that messages of a piece complete, with kernels on one thread.

    Raises
    ------
    RecordingError
        If the recording cannot be read.

    """
    began = perf_counter()
    parameters = FilterParameters().changed({**piece.parameters, 'threads': 1})
    chain = NotingChain(parameters)
    source = _opened(piece.recording, piece.largest)
    chosen = choose_clouds(source, piece.topics, 'a topic to filter')
    streams = [CloudTopic(topic, parameters, chain=chain) for topic in chosen]
    listeners = {key: feed for stream in streams for key, feed in stream.listeners.items()}
    begin = None
    if piece.start is not None:
        begin = piece.start - round(warm_up(parameters) * SECOND)
        for stream in streams:
            _settle(source, stream, begin)
    for topic, time, data in source.messages(_topics(source, listeners), begin, piece.stop):
        chain.awake = piece.start is None or time >= piece.start
        listeners[topic.name, topic.msgtype](time, data)
    if piece.stop is None:
        chain.awake = True
        for stream in streams:
            stream.finish()
    return JudgedPiece(chain.verdicts, name_of_worker(), perf_counter() - began, judging_code())


def warm_up(parameters: FilterParameters) -> float:
    """Return how long before a piece clouds decide which of its points are judged together, s.

    A block that a message of the piece completes, and its halo, may have begun so long before.
    """
    seconds = 2 * (parameters.block + parameters.halo) + parameters.lateness + SLACK
    if parameters.motion.source != 'none':
        seconds += parameters.max_delay + parameters.motion.max_gap
    return seconds


def _settle(source: Recording, stream: CloudTopic, before: int) -> None:
    """Let a stream take its first clouds, up to a bag time, until they have decided."""
    for topic, time, data in source.messages(_topics(source, stream.listeners), None, before):
        stream.listeners[topic.name, topic.msgtype](time, data)
        if stream.settled:
            return


def _topics(
    source: Recording, listeners: Mapping[tuple[str, str], Callable[[int, bytes], object]]
) -> list[Topic]:
    return [topic for topic in source.topics if (topic.name, topic.msgtype) in listeners]


class _Opened(threading.local):
    """The recording that a thread has read a piece of: the next one is likely of the same."""

    def __init__(self) -> None:
        self.key: tuple[Location, int] | None = None
        self.source: Recording | None = None
        self.stack = ExitStack()


_kept = _Opened()


def _opened(location: Location, largest: int) -> Recording:
    """Open a recording, or take the one that is open; refuse one that has changed since."""
    if _kept.source is not None and (location, largest) == _kept.key:
        return _kept.source
    _kept.stack.close()
    _kept.source = None
    location.check_unchanged()
    path = _kept.stack.enter_context(staged(location))
    _kept.source = _kept.stack.enter_context(Recording(path, largest))
    _kept.key = location, largest
    return _kept.source
