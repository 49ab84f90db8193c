# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""One topic of clouds of a recording: its messages in, its answers out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore

from lidar_outlier_filter.errors import CloudError, RecordingError
from lidar_outlier_filter.recordings.bags import RELIABLE, Topic
from lidar_outlier_filter.stream.cloud_filter import CloudFilter
from lidar_outlier_filter.stream.motion import Odometry
from lidar_outlier_filter.stream.topics import CLOUD, ODOMETRY, answers, resolve

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from lidar_outlier_filter.core.chain import Chain
    from lidar_outlier_filter.parameters.filter import FilterParameters
    from lidar_outlier_filter.recordings.bags import NewBag
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


class CloudTopic:
    """A topic of clouds, its filter, and the topics of its answers."""

    def __init__(
        self,
        topic: Topic,
        parameters: FilterParameters,
        inform: Callable[[str], object] = str,
        chain: Chain | None = None,
    ) -> None:
        """Take a topic; ``chain`` stands in for that of the parameters."""
        self.topic = topic
        self._parameters = parameters
        motion = Odometry(parameters) if parameters.motion.source == 'odometry' else None
        self.odometry = '' if motion is None else resolve(motion.topic)
        self._motion = motion
        name = resolve(topic.name)

        def say(text: str) -> None:
            inform(f'{name}: {text}')

        self._filter = CloudFilter(parameters, say, say, motion)
        if chain is not None:
            self._filter.judge_by(chain)
        self._filter.wanted = (False, False)
        self._clouds = 0
        self._types = get_typestore(Stores.ROS2_JAZZY)

    @property
    def settled(self) -> bool:
        """Whether the first clouds have decided all that they decide for those to come."""
        return self._filter.settled

    @property
    def listeners(self) -> Mapping[tuple[str, str], Callable[[int, bytes], None]]:
        """What takes the messages of a topic, by its name and type: a topic may carry several."""
        found: dict[tuple[str, str], Callable[[int, bytes], None]]
        found = {(self.topic.name, CLOUD): self.feed}
        if self.odometry:
            found[self.odometry, ODOMETRY] = self.feed_pose
        return found

    def begin(self, bag: NewBag, names: set[str]) -> None:
        """Add the topics of the answers to the bag and to the names in use.

        Where it is not called, no answers are made.
        """
        self._bag = bag
        self._outputs: list[Topic] = []
        self._filter.wanted = (True, True)
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
        if not any(self._filter.wanted):
            return
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
