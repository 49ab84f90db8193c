# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A recording through the node that filters live: called directly, so that nothing is dropped."""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from time import perf_counter
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import rclpy
from nav_msgs.msg import Odometry
from rclpy.context import Context
from rclpy.exceptions import InvalidTopicNameException
from rclpy.serialization import deserialize_message
from rclpy.validate_topic_name import validate_topic_name
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import PointCloud2

from lidar_outlier_filter.errors import ParameterError, RecordingError
from lidar_outlier_filter.recordings.bags import NewBag, Recording, Topic
from lidar_outlier_filter.recordings.odometry import ODOMETRY, check_motion
from lidar_outlier_filter.ros.node import OutlierFilterNode

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
    from pathlib import Path

    from rclpy.duration import Duration
    from rclpy.qos import QoSProfile

    from lidar_outlier_filter.stream.cloud_filter import Answer

CLOUD = 'sensor_msgs/msg/PointCloud2'


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
    progress : is told after each message how many of how many have been read

    Raises
    ------
    RecordingError
        If the recording cannot be read or has no such topic, or the output cannot be written.
    ParameterError
        If a parameter makes no sense.

    """
    with (
        Recording(recording) as source,
        NewBag(output, source.custom_data) as bag,
        _ros() as context,
        ExitStack() as nodes,
    ):
        streams = {}
        for topic in _choose(source, topics):
            streams[topic] = _Stream(topic, parameters, context)
            nodes.callback(streams[topic].node.destroy_node)
        _check_motion(source, streams)
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


@contextmanager
def _ros() -> Iterator[Context]:
    """Give a ROS context of its own: without command line, and without signal handlers."""
    context = Context()
    rclpy.init(args=[], context=context)
    try:
        yield context
    finally:
        rclpy.shutdown(context=context)


def _choose(source: Recording, wanted: Collection[str]) -> list[Topic]:
    """Find the topics to filter."""
    clouds = {topic.name: topic for topic in source.topics if topic.msgtype == CLOUD}
    if not clouds:
        found = ', '.join(f'{topic.name} ({topic.msgtype})' for topic in source.topics)
        must_be = f'one with a topic of type {CLOUD}'
        raise RecordingError(f'the recording {source.path}', must_be, found or 'no topic at all')
    names = dict.fromkeys(wanted or clouds)
    for name in names:
        if name not in clouds:
            raise RecordingError('a topic to filter', f'one of {", ".join(clouds)}', repr(name))
        try:
            validate_topic_name(name)
        except InvalidTopicNameException as err:  # ROS 1 allowed more
            raise RecordingError('a topic to filter', 'a name that ROS 2 allows', name) from err
    return [clouds[name] for name in names]


def _check_motion(source: Recording, streams: Mapping[Topic, _Stream]) -> None:
    """Refuse motion that the recording cannot tell."""
    for stream in streams.values():
        motion = stream.node.filter_parameters.motion
        if motion.source == 'odometry' and len(streams) > 1:
            must_be = "'none' for several topics, whose sensors are not at the same place"
            raise ParameterError('motion.source', must_be, repr(motion.source))
        check_motion(source, motion, stream.odometry)


class _Stream:
    """A topic of clouds, the node that filters it, and the topics of its answers."""

    def __init__(
        self, topic: Topic, parameters: Mapping[str, object] | None, context: Context
    ) -> None:
        self.topic = topic
        self.node = OutlierFilterNode(
            parameters=parameters,
            input_topic=topic.name,
            context=context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        motion = self.node.filter_parameters.motion
        self.odometry = ''
        if motion.source == 'odometry':
            self.odometry = self.node.resolve_topic_name(motion.topic)
        self._clouds = 0
        self._types = get_typestore(Stores.ROS2_JAZZY)

    def begin(self, bag: NewBag, names: set[str]) -> None:
        """Add the topics of the answers to the bag and to the names in use."""
        self._bag = bag
        self._outputs = []
        for publisher in (self.node.cleaned_publisher, self.node.outliers_publisher):
            name = publisher.topic_name
            if name in names:
                must_be = 'a topic that the recording does not have'
                raise RecordingError(f'the answer to {self.topic.name}', must_be, name)
            qos = _recorded(publisher.qos_profile)
            output = Topic(name, CLOUD, self.topic.definition, self.topic.digest, (qos,))
            bag.add(output)
            names.add(name)
            self._outputs.append(output)

    def feed(self, time: int, data: bytes) -> None:
        """Let the node have a cloud with its bag time, and write the answers it has by now."""
        self._clouds += 1
        try:
            cloud = deserialize_message(data, PointCloud2)
        except RuntimeError:
            self.node.statistics.refusals['the CDR bytes'] += 1
        else:
            self._write(self.node.process(cloud, time))

    def feed_pose(self, _time: int, data: bytes) -> None:
        """Let the node have an odometry, and write the answers it has by now."""
        try:
            msg = deserialize_message(data, Odometry)
        except RuntimeError:
            self.node.statistics.poses['the CDR bytes'] += 1
        else:
            self._write(self.node.take_pose(msg))

    def finish(self) -> None:
        """Write the answers to the last clouds."""
        self._write(self.node.flush())

    def _write(self, answers: Iterable[Answer]) -> None:
        for answer in answers:
            for topic, cloud in zip(self._outputs, (answer.cleaned, answer.outliers), strict=True):
                self._bag.write(topic, answer.tag, self._serialized(cloud))

    def _serialized(self, cloud: PointCloud2) -> memoryview:
        """Turn a cloud into CDR bytes.

        Not with rclpy: its padding between fields is memory that nobody has set, so that the same
        input would not give the same output.
        """
        fields = {name: getattr(cloud, name) for name in cloud.get_fields_and_field_types()}
        fields['data'] = np.frombuffer(cloud.data, np.uint8)
        return self._types.serialize_cdr(SimpleNamespace(**fields), CLOUD)

    def report(self) -> TopicReport:
        """Tell what became of the clouds."""
        counts = self.node.statistics
        chain = self.node.filter_parameters.chain
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


def _recorded(profile: QoSProfile) -> Qos:
    """Turn a QoS profile into its form in recordings; both number the policies alike."""
    return Qos(
        QosHistory(int(profile.history)),
        profile.depth,
        QosReliability(int(profile.reliability)),
        QosDurability(int(profile.durability)),
        _time(profile.deadline),
        _time(profile.lifespan),
        QosLiveliness(int(profile.liveliness)),
        _time(profile.liveliness_lease_duration),
        profile.avoid_ros_namespace_conventions,
    )


def _time(duration: Duration) -> QosTime:
    return QosTime(*divmod(duration.nanoseconds, 10**9))
