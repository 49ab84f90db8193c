# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated clouds in memory, ready to be judged: what a preset and a seed give."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lidar_outlier_filter.core.annotations import Bytes, Floats, Ints
from lidar_outlier_filter.core.engine.chain import along_lines
from lidar_outlier_filter.evaluation.judged import SURFACE
from lidar_outlier_filter.evaluation.report import STRETCHES
from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.tuning.training import Training, cut
from lidar_outlier_lab.simulation import presets
from lidar_outlier_lab.simulation.world.recording import FRAME, TOPIC, Cloud, to_message

# How clouds are read whose fields have other than the usual names.
READING: Mapping[str, Mapping[str, object]] = {
    'kang-urban': {'time_field': 'gps_time'},
    'kang-mountain': {'time_field': 'gps_time'},
}


@dataclass(frozen=True)
class Sample:
    """One simulated cloud or recording whose truth is known.

    Attributes
    ----------
    name : of the preset; with the topic, where it has several
    seed : that it was made of
    data : its points, and how they are judged: a recording in blocks, one cloud as a whole
    code : (N,) int64, cause of each outlier; 0 of good points
    timed : whether its points have times, so that it has scan lines
    in_own_frame : whether its sensor is the origin, and each cloud a sweep that stands for itself
    surface : (N,) uint8, what each point lies on, a :class:`Kind`; None where that is not known

    """

    name: str
    seed: int
    data: Training
    code: Ints
    timed: bool
    in_own_frame: bool
    surface: Bytes | None = None

    def suits(self, chain: Sequence[str]) -> bool:
        """Return whether all detectors of a chain can test it."""
        return self.timed or not along_lines(chain)

    @property
    def clouds(self) -> list[Floats]:
        """The coordinates (M, 3) of what filters without a stream see at once.

        Sweeps in their own frame one by one, anything else together.
        """
        parts = [cloud.xyz for cloud in self.data.clouds]
        return parts if self.in_own_frame else [np.concatenate(parts)]


def simulated(
    preset: str, seed: int, progress: Callable[[float], object] = lambda _: None
) -> list[Sample]:
    """Simulate a preset, one sample for each of its topics."""
    by_topic: dict[str, list[Cloud]] = {}
    for cloud in presets.make(preset, seed, progress=progress):
        by_topic.setdefault(cloud.topic, []).append(cloud)
    return [
        _sample(preset if topic == TOPIC else f'{preset}{topic}', preset, seed, clouds)
        for topic, clouds in by_topic.items()
    ]


def _sample(name: str, preset: str, seed: int, clouds: Sequence[Cloud]) -> Sample:
    decoder = Decoder(FilterParameters().changed(READING.get(preset, {})))
    decoded = [
        decoder.decode(to_message(cloud.stamp, cloud.points, cloud.frame)) for cloud in clouds
    ]
    code = np.concatenate([cloud.points['label'] for cloud in clouds]).astype(np.int64)
    valid = np.concatenate([points.valid for points in decoded])
    points = tuple(each.take(each.valid) for each in decoded)
    code = code[valid]
    t = np.concatenate([each.t for each in points])
    timed = bool(np.ptp(t) > 0)
    xyz = np.concatenate([each.xyz for each in points])
    along = t if timed else xyz[:, int(np.argmax(np.ptp(xyz, axis=0)))]
    data = Training(
        points, code != 0, code == 0, cut(along, STRETCHES), STRETCHES, streamed=len(points) > 1
    )
    surface = None
    if SURFACE in (clouds[0].points.dtype.names or ()):
        surface = np.concatenate([cloud.points[SURFACE] for cloud in clouds])[valid]
    return Sample(name, seed, data, code, timed, clouds[0].frame != FRAME, surface)
