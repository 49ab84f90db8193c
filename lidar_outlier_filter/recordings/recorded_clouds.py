# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The clouds of a recording as the filter's detectors get them, moved by its odometry or not."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from lidar_outlier_filter.core.judging.blocks import Stream
from lidar_outlier_filter.core.judging.chain import Chain
from lidar_outlier_filter.core.judging.stream_cloud import StreamCloud
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.errors import CloudError, RecordingError
from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_filter.recordings.bags import Recording
from lidar_outlier_filter.recordings.odometry import check_motion
from lidar_outlier_filter.stream.motion import Odometry
from lidar_outlier_filter.stream.moving import MovingStream
from lidar_outlier_filter.stream.topics import CLEANED, CLOUD, ODOMETRY, OUTLIERS, resolve

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from lidar_outlier_filter.core.points.points import Points
    from lidar_outlier_filter.parameters.filter import FilterParameters

    Floats = NDArray[np.float64]


@dataclass(eq=False, kw_only=True)
class RecordedCloud(StreamCloud):
    """A cloud that the filter takes, its points as the detectors get them: moved, or not.

    Attributes
    ----------
    msg : the message
    number : of the cloud in its topic, from 0
    eye : (M, 4, 3) float64 or None
        Where the sensor was at the time of each valid point, and what lay 1 m off on each of its
        axes, if points were moved.

    """

    msg: Any
    number: int
    eye: Floats | None = None


class RecordedClouds:
    """The clouds of a topic that the filter takes, as a replay would; read again at each iteration.

    Attributes
    ----------
    topic : of the clouds
    count : clouds that the topic has
    unmoved : clouds that were taken without poses, though there is odometry
    refusals : clouds that were refused, by what was wrong with them
    sentences : the first one for each of these
    convention : how the clouds are read, for people; empty: no cloud had a valid point

    """

    def __init__(
        self,
        recording: Path,
        parameters: FilterParameters,
        topic: str | None = None,
        *,
        with_eyes: bool = False,
    ) -> None:
        """Name the recording and the topic; None: the only one."""
        self.topic = ''
        self.count = self.unmoved = 0
        self.refusals: Counter[str] = Counter()
        self.sentences: dict[str, str] = {}
        self.convention = ''
        self._recording = recording
        self._parameters = parameters
        self._wanted = topic
        self._with_eyes = with_eyes

    def __iter__(self) -> Iterator[RecordedCloud]:
        """Read them.

        Raises
        ------
        FilterError
            If the recording cannot be read, has no such topic, or lacks the odometry.

        """
        self.count = self.unmoved = 0
        self.refusals.clear()
        self.sentences.clear()
        parameters, decoder = self._parameters, Decoder(self._parameters)
        motion = Odometry(parameters) if parameters.motion.source == 'odometry' else None
        stream = _Recorder(parameters, motion if self._with_eyes else None)
        moving = None if motion is None else MovingStream(stream, motion, parameters, self._refused)
        for kind, message in self._messages():
            if kind == ODOMETRY and motion is not None and moving is not None:
                motion.take(message)
                moving.advance()
            if kind == CLOUD:
                self.count += 1
                try:
                    msg = _readable(message)
                    points, number = decoder.decode(msg), self.count - 1
                    frame = '' if moving is None else str(msg.header.frame_id)
                    (moving or stream).push(RecordedCloud(points, frame, msg=msg, number=number))
                except CloudError as err:
                    self._refused(err)
                    decoder.undo()
            yield from stream.taken()
        (moving or stream).flush()
        yield from stream.taken()
        self.unmoved = 0 if moving is None else moving.unmoved
        self.convention = str(decoder.convention or '')

    def _refused(self, err: CloudError) -> None:
        self.refusals[err.what] += 1
        self.sentences.setdefault(err.what, str(err))

    def _messages(self) -> Iterator[tuple[str, Any | None]]:
        """Yield type and message of clouds and odometry; None for a cloud that cannot be read."""
        store = get_typestore(Stores.ROS2_JAZZY)
        with Recording(self._recording) as source:
            self.topic = _choose(source, self._wanted)
            wanted = {(self.topic, CLOUD)}
            odometry = resolve(self._parameters.motion.topic)
            check_motion(source, self._parameters.motion)
            if self._parameters.motion.source == 'odometry':
                wanted.add((odometry, ODOMETRY))
            for channel, _, data in source.messages():
                if (channel.name, channel.msgtype) in wanted:
                    try:
                        message = store.deserialize_cdr(data, channel.msgtype)
                    except Exception:  # noqa: BLE001  it raises whatever it comes upon
                        message = None
                    if message is not None or channel.msgtype == CLOUD:
                        yield channel.msgtype, message


def _readable(message: Any | None) -> Any:
    if message is None:
        raise CloudError('the CDR bytes', 'those of a cloud', 'others')
    return message


class _Recorder(Stream[RecordedCloud]):
    """A stream that judges nothing, and notes what it takes."""

    def __init__(self, parameters: FilterParameters, motion: Odometry | None) -> None:
        """Take the motion that says where the sensor was; None: nobody asks."""
        super().__init__(parameters)
        self.chain = _Nothing(parameters)
        self._taken: list[RecordedCloud] = []
        self._motion = motion

    def push(self, cloud: RecordedCloud) -> list[RecordedCloud]:
        """Take the next cloud, in its own frame or moved."""
        finished = super().push(cloud)
        if self._motion is not None and (not cloud.frame or cloud.points.fixed is not None):
            cloud.eye = _see(self._motion, cloud.points, str(cloud.msg.header.frame_id))
        self._taken.append(cloud)
        return finished

    def taken(self) -> list[RecordedCloud]:
        """Give away the clouds that were taken since."""
        taken, self._taken = self._taken, []
        return taken


def _see(motion: Odometry, points: Points, frame: str) -> Floats:
    """Return where the sensor's origin, and 1 m on its axes, were at the time of each point."""
    found = np.empty((len(points), 4, 3))
    for k, position in enumerate((np.zeros(3), *np.eye(3))):
        xyz = np.tile(position, (len(points), 1))
        moved, _ = motion.move(replace(points, xyz=xyz, own=None), frame)
        found[:, k] = moved.xyz
    return found


class _Nothing(Chain):
    """A chain that leaves all points as they are."""

    def judge(self, points: Points) -> Verdict:
        """Judge nothing."""
        return Verdict.untested(len(points))


def _choose(source: Recording, topic: str | None) -> str:
    """Find the topic of clouds that is named, or the only one; answers are none."""
    names = [channel.name for channel in source.topics if channel.msgtype == CLOUD]
    inputs = [
        name
        for name in names
        if not any(
            name.endswith(answer) and name.removesuffix(answer) in names
            for answer in (CLEANED, OUTLIERS)
        )
    ]
    if topic is None and len(inputs) == 1:
        return inputs[0]
    if topic is None or topic not in names:
        known = ', '.join(inputs) or 'none'
        must_be = f'one of its topics of clouds ({known})'
        raise RecordingError(f'the topic to learn from in {source.path}', must_be, repr(topic))
    return topic
