# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A recording through the filter of the node, without the node: nothing is dropped."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING

from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore

from lidar_outlier_filter.errors import CloudError, ParameterError, RecordingError
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.recordings.bags import RELIABLE, NewBag, Recording, Topic
from lidar_outlier_filter.recordings.odometry import check_motion
from lidar_outlier_filter.stream.cloud_filter import CloudFilter
from lidar_outlier_filter.stream.motion import Odometry
from lidar_outlier_filter.stream.topics import CLOUD, ODOMETRY, answers, check_name, resolve

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping
    from pathlib import Path

    from lidar_outlier_filter.stream.cloud_filter import Answer


@dataclass(frozen=True)
class TopicReport:
    """What became of the clouds of one topic.

    ``refused`` clouds have no answer; ``refusals`` counts them by what was wrong with them.
    ``rejected_by`` and ``undecided_by`` count points for each detector of the chain, in its order.
    """

    topic: str
    messages: int
    points: int
    rejected: int
    untested: int
    invalid: int
    refused: int
    refusals: Mapping[str, int]
    rejected_by: Mapping[str, int]
    undecided_by: Mapping[str, int]


@dataclass(frozen=True)
class ReplayReport:
    """What became of a recording.

    ``recorded`` and ``elapsed`` are seconds: the length of the recording, and the time that the
    replay took. ``unread`` messages are counted in the recording, but were not found in it.
    """

    output: Path
    topics: tuple[TopicReport, ...]
    recorded: float
    elapsed: float
    unread: int

    @property
    def is_complete(self) -> bool:
        """Whether every message is in the output, and every cloud has its answer."""
        return self.unread == 0 and not any(topic.refused for topic in self.topics)


def replay(  # noqa: PLR0913  what the command line offers
    recording: Path,
    output: Path,
    topics: Collection[str] = (),
    parameters: Mapping[str, object] | None = None,
    *,
    drop_input: bool = False,
    progress: Callable[[int, int], object] | None = None,
    inform: Callable[[str], object] = str,
) -> ReplayReport:
    """Write a copy of a recording, with the cleaned and the outlier clouds added.

    Answers have the bag time of their cloud. They stand behind it: first the cleaned, then the
    outlier cloud.

    Parameters
    ----------
    recording : ROS 2 bag folder, ``.mcap``, ``.db3``, or ROS 1 ``.bag``
    output : folder to be made, an MCAP bag
    topics : PointCloud2 topics to filter, each as a stream of its own; none given: all of them
    parameters : of the filter, by flat name
    drop_input : leave the clouds that are filtered out of the copy
    progress : is called after each message: how many of how many have been read
    inform : is called with a sentence on how the clouds of a topic are read, once for each layout

    Raises
    ------
    RecordingError
        If the recording cannot be read or has no such topic, or the output cannot be written.
    ParameterError
        If a parameter makes no sense.

    """
    given = FilterParameters().changed(parameters or {})
    if recording.resolve() in output.resolve().parents:
        raise RecordingError('the output', f'outside of {recording}, which stays as it is', output)
    with Recording(recording) as source, NewBag(output, source.custom_data) as bag:
        chosen = choose_clouds(source, topics, 'a topic to filter')
        _check_motion(source, chosen, given)
        streams = {topic: _Stream(topic, given, inform) for topic in chosen}
        started = perf_counter()
        done = _copy(source, bag, streams, set(streams) if drop_input else set(), progress)
        elapsed = perf_counter() - started
        reports = tuple(stream.report() for stream in streams.values())
        unread = max(0, source.message_count - done)
        return ReplayReport(output, reports, source.duration * 1e-9, elapsed, unread)


def _copy(
    source: Recording,
    bag: NewBag,
    streams: Mapping[Topic, _Stream],
    dropped: Collection[Topic],
    progress: Callable[[int, int], object] | None,
) -> int:
    """Write what is not dropped, and the answers of all streams; count the messages read."""
    for topic in source.topics:
        if topic not in dropped:
            bag.add(topic)
    names = {topic.name for topic in source.topics}
    # By type, too: a topic of a recording may carry several.
    listeners: dict[tuple[str, str], Callable[[int, bytes], object]] = {}
    for topic, stream in streams.items():
        stream.begin(bag, names)
        listeners[topic.name, CLOUD] = stream.feed
        if stream.odometry:
            listeners[stream.odometry, ODOMETRY] = stream.feed_pose
    done = 0
    for topic, time, data in source.messages():
        if topic not in dropped:
            bag.write(topic, time, data)
        listener = listeners.get((topic.name, topic.msgtype))
        if listener is not None:
            listener(time, data)
        done += 1
        if progress is not None:
            progress(done, source.message_count)
    for stream in streams.values():
        stream.finish()
    return done


def choose_clouds(source: Recording, wanted: Collection[str], what: str) -> list[Topic]:
    """Find topics of clouds, which errors call ``what``; none wanted: all of them.

    Raises
    ------
    RecordingError
        If there is none, or not one of those wanted.

    """
    clouds = {topic.name: topic for topic in source.topics if topic.msgtype == CLOUD}
    if not clouds:
        found = ', '.join(f'{topic.name} ({topic.msgtype})' for topic in source.topics)
        must_be = f'one with a topic of type {CLOUD}'
        raise RecordingError(f'the recording {source.path}', must_be, found or 'no topic at all')
    names = dict.fromkeys(wanted or clouds)
    for name in names:
        if name not in clouds:
            raise RecordingError(what, f'one of {", ".join(clouds)}', repr(name))
        check_name(what, name)  # ROS 1 allowed more
    return [clouds[name] for name in names]


def _check_motion(
    source: Recording, chosen: Collection[Topic], parameters: FilterParameters
) -> None:
    """Refuse motion that the recording does not hold."""
    motion = parameters.motion
    if motion.source == 'odometry' and len(chosen) > 1:
        must_be = "'none' for several topics, whose sensors are not at the same place"
        raise ParameterError('motion.source', must_be, repr(motion.source))
    check_motion(source, motion)


class _Stream:
    """A topic of clouds, its filter, and the topics of its answers."""

    def __init__(
        self, topic: Topic, parameters: FilterParameters, inform: Callable[[str], object]
    ) -> None:
        self.topic = topic
        self._parameters = parameters
        motion = Odometry(parameters) if parameters.motion.source == 'odometry' else None
        self.odometry = '' if motion is None else resolve(motion.topic)
        self._motion = motion
        name = resolve(topic.name)

        def say(text: str) -> None:
            inform(f'{name}: {text}')

        self._filter = CloudFilter(parameters, say, say, motion)
        self._clouds = 0
        self._types = get_typestore(Stores.ROS2_JAZZY)

    def begin(self, bag: NewBag, names: set[str]) -> None:
        """Add the topics of the answers to the bag and to the names in use."""
        self._bag = bag
        self._outputs = []
        for name in answers(resolve(self.topic.name)):
            if name in names:
                must_be = 'a topic that the recording does not have'
                raise RecordingError(f'the answer to {self.topic.name}', must_be, name)
            output = Topic(name, CLOUD, self.topic.definition, self.topic.digest, (RELIABLE,))
            bag.add(output)
            names.add(name)
            self._outputs.append(output)

    def feed(self, time: int, data: bytes) -> None:
        """Filter a cloud with its bag time, and write the answers that are finished by it."""
        self._clouds += 1
        try:
            cloud = self._types.deserialize_cdr(data, CLOUD)
        except SerdeError as err:
            self._filter.refused(CloudError('the CDR bytes', 'a whole cloud', err))
            return
        try:
            finished = self._filter.push(cloud, time)
        except CloudError:  # counted by the filter; others may be finished all the same
            finished = self._filter.advance()
        self._write(finished)

    def feed_pose(self, _time: int, data: bytes) -> None:
        """Take an odometry, and write the answers that are finished by it."""
        if self._motion is None:
            return
        try:
            msg = self._types.deserialize_cdr(data, ODOMETRY)
        except SerdeError:
            self._motion.refuse('the CDR bytes')
            return
        self._motion.take(msg)
        self._write(self._filter.advance())

    def finish(self) -> None:
        """Write the answers to the last clouds."""
        self._write(self._filter.flush())

    def _write(self, finished: Iterable[Answer]) -> None:
        for answer in finished:
            for topic, cloud in zip(self._outputs, (answer.cleaned, answer.outliers), strict=True):
                self._bag.write(topic, answer.tag, self._types.serialize_cdr(cloud, CLOUD))

    def report(self) -> TopicReport:
        """Say what became of the clouds."""
        counts, chain = self._filter.statistics, self._parameters.chain
        return TopicReport(
            self.topic.name,
            self._clouds,
            counts.points,
            counts.outliers,
            counts.untested,
            counts.invalid,
            self._clouds - counts.messages,
            dict(counts.refusals),
            {name: counts.rejected[name] for name in chain},
            {name: counts.undecided[name] for name in chain},
        )
