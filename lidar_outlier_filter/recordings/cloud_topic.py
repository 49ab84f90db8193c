# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Filter one cloud topic of a recording, messages in, output clouds out; the times of messages."""

import math
from array import array
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from rosbags.serde import SerdeError

from lidar_outlier_filter.core.annotations import Ints
from lidar_outlier_filter.core.detectors.registry import DETECTORS, rejecting
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.engine.stream_cloud import StreamCloud
from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.errors import CloudError, ParameterError, RecordingError, refused_for
from lidar_outlier_filter.parameters.declaration import MASK
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.parameters.node import MotionParameters
from lidar_outlier_filter.pipeline.compressed import decompressed
from lidar_outlier_filter.pipeline.motion import PoseSource
from lidar_outlier_filter.pipeline.pipeline import Pipeline, SplitCloud
from lidar_outlier_filter.pipeline.tf import DYNAMIC, STATIC, pose_source
from lidar_outlier_filter.pipeline.topics import (
    CLOUD,
    COMPRESSED,
    ODOMETRY,
    SCANS,
    TRANSFORMS,
    output_topics,
    resolve,
)
from lidar_outlier_filter.recordings.bags import RELIABLE, NewBag, Recording, Topic
from lidar_outlier_filter.recordings.channels import known_types, unchanged_definition

MAX_SENTENCES = 50  # of refusals that are kept
MAX_TIME_NS = 2**63 - 1  # ns
GAP_MEDIANS = 2.0  # median distances: messages are missing in a longer one


class MessageTimes:
    """The times of the messages of a topic, ns, in the order in which they were recorded."""

    def __init__(self, times: Iterable[int] = ()) -> None:
        self._times = array('q', times)

    def add(self, time: int) -> None:
        """Count a message."""
        self._times.append(min(time, MAX_TIME_NS))

    @property
    def count(self) -> int:
        """Count the messages."""
        return len(self._times)

    @property
    def jumps(self) -> int:
        """Count the times that are earlier than the one before."""
        return int(np.count_nonzero(self._distances() < 0))

    @property
    def longest(self) -> int:
        """The longest distance of two messages, ns."""
        return int(self._distances().max(initial=0))

    @property
    def usual(self) -> float:
        """The median distance of two messages, s; nan of less than two."""
        distances = self._distances()
        middle = (len(distances) - 1) // 2
        if middle < 0:
            return math.nan
        return max(0, int(np.partition(distances, middle)[middle])) / SECOND

    @property
    def rate(self) -> float:
        """The usual number of messages per second; nan if they come at once."""
        usual = self.usual
        return 1 / usual if usual > 0 else math.nan

    @property
    def gaps(self) -> int:
        """Count the gaps."""
        return len(self.gaps_found())

    def gaps_found(self) -> list[tuple[int, int]]:
        """List the time before each gap, and its length, ns."""
        usual, distances = self.usual, self._distances()
        if not usual > 0:
            return []
        found = np.flatnonzero(distances > GAP_MEDIANS * usual * SECOND)
        return [(self._times[i], int(distances[i])) for i in found]

    def _distances(self) -> Ints:
        times: Ints = np.array(self._times, np.int64)
        return times[1:] - times[:-1]


@dataclass(frozen=True)
class TopicReport:
    """Counts of the clouds of one topic.

    ``refused`` clouds have no output; ``refusals`` counts them by reason, and
    ``sentences`` has the first sentence for each. ``gaps`` counts gaps between clouds.
    Under ``motion.source``, ``without_pose`` counts clouds with points that were not moved.
    ``rejected_by`` and ``undecided_by`` count points for each detector of the chain, in its order;
    those on the own vehicle are rejected by ``mask``. ``methods`` names how the default judged.
    """

    topic: str
    messages: int
    points: int
    rejected: int
    untested: int
    invalid: int
    dropped: int
    refused: int
    refusals: Mapping[str, int]
    rejected_by: Mapping[str, int]
    undecided_by: Mapping[str, int]
    sentences: Mapping[str, str]
    gaps: int = 0
    without_pose: int = 0
    methods: tuple[str, ...] = ()

    @property
    def refused_because(self) -> str:
        """Why clouds were refused, and how often."""
        return refused_for(self.refusals, self.sentences)

    @property
    def untested_because(self) -> str:
        """Why no point could be tested; empty if one was, or if no cloud was filtered."""
        masked = self.rejected_by.get(MASK, 0)
        if self.messages == self.refused or self.points > self.untested + self.invalid + masked:
            return ''
        if self.points == self.invalid + masked:
            of_vehicle = ', or on the own vehicle' if masked else ''
            return f'all are missing returns{of_vehicle}' if self.points else 'its clouds have none'
        return ', '.join(f'{name} needs {DETECTORS[name].lack}' for name in self.undecided_by)


class CloudTopic:
    """A topic of clouds, the pipeline that filters it, and its output topics."""

    def __init__(
        self,
        topic: Topic,
        parameters: FilterParameters,
        inform: Callable[[str], object] = str,
        chain: Chain | None = None,
        motion: PoseSource | None = None,
    ) -> None:
        """Filter a topic; ``chain`` and ``motion`` replace those of the parameters."""
        self.topic = topic
        self._parameters = parameters
        self._motion = motion = pose_source(parameters) if motion is None else motion
        name = resolve(topic.name)

        def say(text: str) -> None:
            inform(f'{name}: {text}')

        self.pipeline = Pipeline(parameters, say, say, motion)
        if chain is not None:
            self.pipeline.use_chain(chain)
        self.pipeline.requested_outputs = (False, False)
        self.pipeline.refuse = self._note_refusal
        self._sentences: dict[str, str] = {}
        self._clouds = 0  # read so far
        self._times = MessageTimes()
        self._types = known_types()
        self._take: Callable[[StreamCloud, Any, int], object] | None = None
        self._shown: list[tuple[StreamCloud, Any]] = []  # not passed on yet

    def show(self, take: Callable[[StreamCloud, Any, int], object]) -> None:
        """Call with each cloud that is judged, its message and its number in the topic, from 0."""
        self.pipeline.show = [lambda cloud, msg: self._shown.append((cloud, msg))]
        self._take = take

    @property
    def listeners(self) -> Mapping[tuple[str, str], Callable[[int, bytes], None]]:
        """The methods that receive messages, by topic name and type."""
        found: dict[tuple[str, str], Callable[[int, bytes], None]]
        found = {(self.topic.name, self.topic.msgtype): self.feed}
        if self._motion is not None:
            for (name, msgtype), take in self._motion.listeners.items():
                found[resolve(name), msgtype] = partial(self._feed_pose, msgtype, take)
        return found

    def begin(self, bag: NewBag, names: set[str]) -> None:
        """Add the output topics to the bag and to the names in use.

        Unless it is called, no output clouds are made.
        """
        self._bag = bag
        self._outputs: list[Topic] = []
        self.pipeline.requested_outputs = (True, True)
        msgtype, definition = self.topic.msgtype, (self.topic.definition, self.topic.digest)
        if msgtype == COMPRESSED:
            msgtype, definition = CLOUD, unchanged_definition(CLOUD)
        for name in output_topics(resolve(self.topic.name)):
            if name in names:
                must_be = 'new to the recording'
                raise RecordingError(f'the output topic of {self.topic.name}', must_be, name)
            output = Topic(name, msgtype, *definition, (RELIABLE,))
            bag.add(output)
            names.add(name)
            self._outputs.append(output)

    def feed(self, time: int, data: bytes) -> None:
        """Filter a cloud with its bag time, and write the output clouds that it completes."""
        self._clouds += 1
        self._times.add(time)
        try:
            cloud = read_cloud(self.topic, data)
        except CloudError as err:
            self.pipeline.refused(err)
            return
        try:
            finished = self.pipeline.process(cloud, (self._clouds, time))
        except CloudError as err:  # counted by the pipeline; others may be complete all the same
            self._note_refusal(err)
            finished = self.pipeline.advance()
        self._write(finished)

    def _feed_pose(
        self, msgtype: str, take: Callable[[Any], None], _time: int, data: bytes
    ) -> None:
        """Pass on a message with poses, and write the output clouds that it completes."""
        try:
            msg = self._types.deserialize_cdr(data, msgtype)
        except SerdeError:
            self.pipeline.statistics.poses.note('the CDR bytes')
            return
        take(msg)
        self._write(self.pipeline.advance())

    def finish(self) -> None:
        """Write the output clouds that are left."""
        self._write(self.pipeline.flush())

    def _note_refusal(self, err: CloudError) -> None:
        if len(self._sentences) < MAX_SENTENCES:
            self._sentences.setdefault(err.what, str(err))

    def _write(self, finished: Sequence[SplitCloud]) -> None:
        if self._take is not None:
            for (cloud, msg), result in zip(self._shown, finished, strict=True):
                self._take(cloud, msg, result.tag[0] - 1)
            self._shown.clear()
        if not any(self.pipeline.requested_outputs):
            return
        for result in finished:
            _, time = result.tag
            for topic, msg in zip(self._outputs, (result.cleaned, result.outliers), strict=True):
                self._bag.write(topic, time, bytes(self._types.serialize_cdr(msg, topic.msgtype)))

    def report(self) -> TopicReport:
        """Count the clouds."""
        counts, parameters = self.pipeline.statistics, self._parameters
        return TopicReport(
            self.topic.name,
            self._clouds,
            counts.points,
            counts.outliers,
            counts.untested,
            counts.invalid,
            counts.dropped,
            self._clouds - counts.messages,
            dict(counts.refusals),
            {name: counts.rejected[name] for name in rejecting(parameters)},
            {name: counts.undecided[name] for name in parameters.chain},
            dict(self._sentences),
            self._times.gaps,
            counts.without_pose,
            tuple(counts.methods),
        )


def read_cloud(topic: Topic, data: bytes) -> Any:
    """Read a cloud from the CDR bytes of a message, compressed or not, or of a scan.

    Raises
    ------
    CloudError
        If it is damaged.

    """
    if topic.msgtype == COMPRESSED:
        data = decompressed(data)
    try:
        return known_types().deserialize_cdr(
            data, topic.msgtype if topic.msgtype in SCANS else CLOUD
        )
    except SerdeError as err:
        raise CloudError('the CDR bytes', 'a whole cloud', err) from err


def cloud_topics(source: Recording, *, scans: bool = False) -> dict[str, Topic]:
    """Name the topics of clouds, without compressed copies of a topic that is recorded, too.

    With ``scans``, those of 2-D scanners, too.
    """
    kinds = {CLOUD, COMPRESSED, *(SCANS if scans else ())}
    found = {one.name: one for one in source.topics if one.msgtype in kinds}
    return {
        name: topic
        for name, topic in found.items()
        if topic.msgtype != COMPRESSED or name.rpartition('/')[0] not in found
    }


def check_motion(source: Recording, motion: MotionParameters) -> None:
    """Refuse motion that a recording does not hold."""
    kinds = {channel.name: channel.msgtype for channel in source.topics}
    if motion.source == 'tf' and TRANSFORMS not in {kinds.get(DYNAMIC), kinds.get(STATIC)}:
        must_be = f"'none' or 'odometry' for a recording without {DYNAMIC} and {STATIC}"
        raise ParameterError('motion.source', must_be, repr(motion.source))
    topic = resolve(motion.topic)
    names = [channel.name for channel in source.topics if channel.msgtype == ODOMETRY]
    if motion.source == 'odometry' and topic not in names:
        must_be = 'one of the odometry topics ' + (', '.join(names) or '(none)')
        raise RecordingError('motion.topic', must_be, repr(topic))
