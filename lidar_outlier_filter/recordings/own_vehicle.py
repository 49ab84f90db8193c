# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Learns the own vehicle from a recorded drive."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.points.mask import CHANGED, TURN_SPACING_M, Mask, MaskLearner
from lidar_outlier_filter.core.points.points import SECOND, Points, concatenate
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.parameters.declaration import OFF
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.tf import DYNAMIC
from lidar_outlier_filter.pipeline.topics import ODOMETRY
from lidar_outlier_filter.recordings.bags import Recording
from lidar_outlier_filter.recordings.recorded_clouds import RecordedClouds

TURN_NS = SECOND * 9 // 100  # nanoseconds: about a turn
MIN_OTHER_TURNS = 10  # turns from elsewhere
MAX_REACH_M = 30.0  # metres


@dataclass(frozen=True)
class LearntMask:
    """A mask, and the clouds that it was learnt from.

    Attributes
    ----------
    topic : of the clouds
    odometry : topic of the poses; empty: movement was seen from the scene
    turns, taken : turns of the sensor, and those that count, as the vehicle had moved on
    refused : clouds that were refused

    """

    mask: Mask
    topic: str
    odometry: str
    turns: int
    taken: int
    refused: int


def learn_mask(
    recording: Path,
    parameters: FilterParameters,
    topic: str | None = None,
    reach: float = 10.0,
    progress: Callable[[int, int], object] = lambda _done, _total: None,
) -> LearntMask:
    """Learn the points that keep their direction and range while the vehicle moves.

    Parameters
    ----------
    recording : of a drive, ROS 2 bag folder, ``.mcap``, ``.db3``, or ROS 1 ``.bag``
    parameters : how its clouds are read; odometry is used if there is one topic of it
    topic : of the clouds; None: the only one
    reach : metres from the sensor to the farthest point of the vehicle
    progress : is called with the turns so far, and 0

    """
    if not 0 < reach <= MAX_REACH_M:
        must_be = f'above 0 and at most {MAX_REACH_M:g} m'
        raise RecordingError('the reach of the vehicle', must_be, reach)
    parameters = _with_odometry(recording, parameters)
    clouds = RecordedClouds(recording, parameters, topic, with_eyes=True)
    learner = MaskLearner(reach)
    for points, place in _turns(clouds):
        learner.add(points, place)
        progress(learner.turns, 0)
    by = {'odometry': parameters.motion.topic, 'tf': DYNAMIC}.get(parameters.motion.source, '')
    if learner.turns and not clouds.read.pipeline.has_rings:
        must_be = 'the rings of the sensor, by a field or by rows'
        raise RecordingError(
            f'the scan lines of {recording}', must_be, clouds.read.pipeline.convention
        )
    if learner.contradiction:
        must_be = 'the rings of a sensor that spins'
        raise RecordingError(f'the scan lines of {recording}', must_be, learner.contradiction)
    if learner.taken < MIN_OTHER_TURNS:
        how = (
            f'{TURN_SPACING_M:g} m on by {by}'
            if by
            else f'{100 * CHANGED:g} % of far cells changed'
        )
        must_be = (
            f'a drive with at least {MIN_OTHER_TURNS} turns of the sensor from elsewhere ({how})'
        )
        reason = 'the vehicle does not move' if learner.taken <= 1 else 'the drive is too short'
        got = f'{learner.taken} of {learner.turns}: {reason}'
        raise RecordingError(f'the recording {recording}', must_be, got)
    return LearntMask(
        learner.learn(),
        clouds.topic,
        by,
        learner.turns,
        learner.taken,
        clouds.read.report().refused,
    )


def _with_odometry(recording: Path, parameters: FilterParameters) -> FilterParameters:
    """Use the odometry of a recording, where it has one topic of it; no mask is in force."""
    values: dict[str, object] = {'mask': OFF}
    with Recording(recording) as source:
        topics = [one.name for one in source.topics if one.msgtype == ODOMETRY]
    if parameters.motion.source == 'none' and len(topics) == 1:
        values |= {'motion.source': 'odometry', 'motion.topic': topics[0]}
    return parameters.changed(values)


def _turns(clouds: RecordedClouds) -> Iterator[tuple[Points, Floats | None]]:
    """Join clouds to turns of the sensor; yield each with the position of its first point."""
    parts: list[Points] = []
    place, first = None, 0
    for taken in clouds:
        cloud = taken.cloud
        if not len(cloud.points):
            continue
        if not parts:
            first = cloud.first
            place = None if taken.eye is None else np.asarray(taken.eye[0, 0])
        parts.append(cloud.points.in_own_frame)
        if not 0 <= cloud.last - first < TURN_NS:
            yield concatenate(parts), place
            parts = []
    if parts:
        yield concatenate(parts), place
