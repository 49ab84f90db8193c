# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The clouds of a recording as detectors receive them, moved or not, or as a run split them."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats, Ints
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.engine.stream_cloud import StreamCloud
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.motion import PoseSource
from lidar_outlier_filter.pipeline.tf import pose_source
from lidar_outlier_filter.pipeline.topics import CLEANED, OUTLIERS, output_topics
from lidar_outlier_filter.recordings.bags import Recording, Topic
from lidar_outlier_filter.recordings.cloud_topic import (
    CloudTopic,
    check_motion,
    cloud_topics,
    read_cloud,
)


@dataclass(frozen=True, eq=False)
class RecordedCloud:
    """A cloud that the filter accepts.

    Attributes
    ----------
    cloud : its valid points as detectors receive them, moved or not
    msg : the message
    number : of the cloud in its topic, from 0
    eye : (M, 4, 3) float64 or None
        Position of the sensor at the time of each valid point, and the positions 1 m along its
        axes, if points were moved. Of the first moved point, if only the path is requested.

    """

    cloud: StreamCloud
    msg: Any
    number: int
    eye: Floats | None = None


class RecordedClouds:
    """The clouds of a topic that the filter accepts; read again at each iteration.

    Attributes
    ----------
    topic : of the clouds
    times : in the recording, of all clouds that the topic has, nanoseconds
    read : the topic as an iteration has read it, with its ``report`` and its ``pipeline``

    """

    read: CloudTopic

    def __init__(
        self,
        recording: Path,
        parameters: FilterParameters,
        topic: str | None = None,
        *,
        with_eyes: bool = False,
        with_path: bool = False,
    ) -> None:
        """Name the recording and the topic; None: the only one."""
        self.topic = ''
        self.times: list[int] = []
        self._recording = recording
        self._parameters = parameters
        self._requested = topic
        self._with_eyes = with_eyes
        self._sees = with_eyes or with_path

    def __iter__(self) -> Iterator[RecordedCloud]:
        """Read them."""
        self.times = []
        taken: list[RecordedCloud] = []
        parameters = self._parameters
        poses = pose_source(parameters) if self._sees else None
        motion = None if poses is None else _Seeing(poses, every=self._with_eyes)

        def take(cloud: StreamCloud, msg: Any, number: int) -> None:
            eye = None if motion is None else motion.taken(cloud.points)
            taken.append(RecordedCloud(cloud, msg, number, eye))

        with Recording(self._recording) as source:
            topic = _choose(source, self._requested)
            self.topic = topic.name
            check_motion(source, parameters.motion)
            self.read = CloudTopic(topic, parameters, chain=_Nothing(parameters), motion=motion)
            self.read.show(take)
            listeners = self.read.listeners
            for channel, time, data in source.messages():
                listener = listeners.get((channel.name, channel.msgtype))
                if listener is None:
                    continue
                if channel is topic:
                    self.times.append(time)
                listener(time, data)
                yield from taken
                taken.clear()
        self.read.finish()
        yield from taken


class _Seeing:
    """A pose source that notes where the sensor was, for each cloud that it moves."""

    def __init__(self, source: PoseSource, *, every: bool) -> None:
        self.topic, self.refusals, self.listeners = source.topic, source.refusals, source.listeners
        self.take, self.reaches, self.reset = source.take, source.reaches, source.reset
        self._source = source
        self._every = every  # for each point, or for one
        # By the identity of the points' array of times, which is kept, so that no other has it.
        self._eyes: dict[int, tuple[Ints, Floats]] = {}

    def taken(self, points: Points) -> Floats | None:
        """Return, once, where the sensor was for points that were moved; None for others."""
        _, eye = self._eyes.pop(id(points.t), (None, None))
        return eye

    def move(self, points: Points, frame: str) -> tuple[Points, Bools]:
        """Move points, and note from where they were seen."""
        moved, known = self._source.move(points, frame)
        if known.any() or not len(known):
            seen = points if self._every else points.take(np.flatnonzero(known)[:1])
            eye = np.empty((len(seen), 4, 3))
            for k, position in enumerate((np.zeros(3), *np.eye(3))):
                xyz = np.tile(position, (len(seen), 1))
                eye[:, k] = self._source.move(replace(seen, xyz=xyz, own=None), frame)[0].xyz
            self._eyes[id(moved.t)] = moved.t, eye
        return moved, known


class _Nothing(Chain):
    """A chain that leaves all points as they are."""

    def judge(self, points: Points) -> Verdict:
        """Judge nothing."""
        return Verdict.untested(len(points))


def _choose(source: Recording, topic: str | None) -> Topic:
    """Find the topic of clouds that is named, or the only one that is not an output.

    Scans are taken where they are named, or where there are no clouds.
    """
    clouds, names = cloud_topics(source), cloud_topics(source, scans=True)
    outputs = {output for name in names for output in output_topics(name)}
    inputs = [name for name in clouds or names if name not in outputs]
    if topic is None and len(inputs) == 1:
        return names[inputs[0]]
    if topic is None or topic not in names:
        must_be = f'one of its topics of clouds ({", ".join(inputs) or "none"})'
        raise RecordingError(f'the topic to learn from in {source.path}', must_be, repr(topic))
    return names[topic]


def filtered_topic(source: Recording, topic: str | None) -> str:
    """Find the topic that was filtered; None: the only one."""
    names = cloud_topics(source)
    inputs = sorted(name.removesuffix(CLEANED) for name in names if name.endswith(CLEANED))
    filtered = [name for name in inputs if name + OUTLIERS in names]
    if topic is None and len(filtered) == 1:
        return filtered[0]
    if topic not in filtered:
        known = ', '.join(filtered) or 'none'
        must_be = f"one of those with '{CLEANED}' and '{OUTLIERS}' ({known})"
        raise RecordingError(f'the topic to score in {source.path}', must_be, repr(topic))
    return str(topic)


def split_clouds(
    source: Recording, topic: str, *, with_inputs: bool = False
) -> Iterator[tuple[bool | None, Any]]:
    """Yield messages, and whether their points were rejected; None: an input."""
    kinds: dict[str, bool | None] = {topic + CLEANED: False, topic + OUTLIERS: True}
    names = cloud_topics(source)
    if with_inputs:
        # Its own name, or that of the compressed one that outputs are not named after.
        given = {name for name in names if output_topics(name)[0] == topic + CLEANED}
        kinds |= dict.fromkeys(given or {topic})
    channels = [channel for name, channel in names.items() if name in kinds]
    if len(channels) < len(kinds):
        must_be = f'with {topic}, which the labels are for'
        raise RecordingError(f'the recording {source.path}', must_be, f'no {topic}')
    for channel, _, data in source.messages(channels):
        yield kinds[channel.name], read_cloud(channel, data)
