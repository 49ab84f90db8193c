# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the tuner learns from: points whose truth is known, judged as the node would judge them."""

from collections.abc import Sequence, Sized
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Bools, Ints
from lidar_outlier_filter.core.engine.blocks import Blocks
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.engine.stream_cloud import StreamCloud
from lidar_outlier_filter.core.engine.whole_cloud import with_rings
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.evaluation.labels import CloudLabels, Codes, is_recording, read_codes_of
from lidar_outlier_filter.evaluation.report import STRETCHES
from lidar_outlier_filter.files import points as file_points
from lidar_outlier_filter.files.cloud_file import open_cloud
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.recordings.recorded_clouds import RecordedClouds
from lidar_outlier_filter.tuning.inject import Injection, inject


@dataclass(frozen=True)
class Training:
    """N valid points whose truth is known.

    Attributes
    ----------
    clouds : the messages, in order; or one whole cloud, which is not ``streamed``
    bad, good : (N,) bool
        Truth; points that are neither do not count.
    stretch : (N,) int64
        The stretch that each point is in: by time, or along a whole cloud.
    stretches : how many there are
    streamed : whether the clouds are judged in blocks, as the node judges them
    refused : clouds that the filter refuses, which are not among them
    without_pose : clouds that have no poses, under ``motion.source``
    frames : of the clouds, where they are not all of one; those of different frames are never
        judged together
    parts : several recordings, each judged by itself

    """

    clouds: tuple[Points, ...]
    bad: Bools
    good: Bools
    stretch: Ints
    stretches: int
    streamed: bool = True
    refused: int = 0
    without_pose: int = 0
    frames: Sequence[str] = ()
    parts: tuple['Training', ...] = ()

    def __len__(self) -> int:
        """Count the points."""
        return len(self.bad)

    @property
    def sources(self) -> Ints:
        """The recording that each stretch, (S,), is of."""
        parts = self.parts or (self,)
        return np.repeat(np.arange(len(parts)), [part.stretches for part in parts])

    def judge(self, parameters: FilterParameters, seen: Bools | None = None) -> Verdict:
        """Judge all points as the node would, or as if those that are not seen were not there."""
        if self.parts:
            masks = _split(seen, self.parts)
            return _joined([p.judge(parameters, m) for p, m in zip(self.parts, masks, strict=True)])
        clouds: Sequence[Points] = self.clouds
        if seen is not None:
            masks = _split(seen, clouds)
            clouds = [cloud.take(mask) for cloud, mask in zip(clouds, masks, strict=True)]
        if self.streamed:
            result = _stream(clouds, self.frames or [''] * len(clouds), parameters)
        else:
            result = Chain(parameters, whole=True).judge(clouds[0])
        if seen is None:
            return result
        verdict = Verdict.untested(len(self))
        verdict.put(seen, result)
        return verdict


def _split(seen: Bools | None, parts: Sequence[Sized]) -> list[Any]:
    """Cut a mask of all points into those of the parts."""
    if seen is None:
        return [None] * len(parts)
    return np.split(seen, np.cumsum([len(part) for part in parts])[:-1])


def together(parts: Sequence[Training]) -> Training:
    """Put recordings beside each other: the stretches of the second follow those of the first."""
    if len(parts) == 1:
        return parts[0]
    first = np.cumsum([0, *(part.stretches for part in parts)])
    return Training(
        (),
        np.concatenate([part.bad for part in parts]),
        np.concatenate([part.good for part in parts]),
        np.concatenate([part.stretch + begin for part, begin in zip(parts, first, strict=False)]),
        int(first[-1]),
        refused=sum(part.refused for part in parts),
        without_pose=sum(part.without_pose for part in parts),
        parts=tuple(parts),
    )


def _stream(
    clouds: Sequence[Points], frames: Sequence[str], parameters: FilterParameters
) -> Verdict:
    blocks: Blocks[StreamCloud] = Blocks(parameters)
    finished = []
    for points, frame in zip(clouds, frames, strict=True):
        finished += blocks.push(StreamCloud(points, frame))
    finished += blocks.flush()
    for cloud in finished:
        if cloud.error is not None:
            raise cloud.error
    return _joined([cloud.verdict for cloud in finished])


def _joined(verdicts: Sequence[Verdict]) -> Verdict:
    columns: dict[str, Any] = {
        field.name: np.concatenate([getattr(verdict, field.name) for verdict in verdicts])
        for field in fields(Verdict)
    }
    return Verdict(**columns)


def read_training(  # noqa: PLR0913  what the command line offers
    path: Path,
    parameters: FilterParameters,
    codes: Codes,
    *,
    topic: str | None = None,
    label: str = '',
    files: Sequence[Path] = (),
    injection: Injection | None = None,
) -> Training:
    """Read points and their truth: clouds of a recording, or a file, which is judged as a whole.

    Parameters
    ----------
    path : recording that ``replay`` reads, or file that ``clean`` reads
    parameters : how the clouds are read and moved, and what makes a block
    codes : what the labels mean
    topic : of clouds; None: the only one
    label : field or column with the truth; empty: the usual one
    files : with the truth: one for each cloud, in order; none: it is in the clouds
    injection : how to make outliers of points that are good, all of them; None: there are labels

    Returns
    -------
    Training
        In stretches of equal numbers of points: by time, or along the longest side of a file.

    """
    if is_recording(path):
        labels = CloudLabels(topic or 'the topic', label, files)
        clouds, code, facts = _read_recording(path, parameters, topic, labels, injection)
        along = np.concatenate([cloud.t for cloud in clouds] or [code])
    else:
        clouds, code = _read_file(path, parameters, label, files, injection)
        facts, xyz = {'streamed': False}, clouds[0].xyz
        along = xyz[:, int(np.argmax(np.ptp(xyz, axis=0))) if len(xyz) else 0]
    counted, bad = codes.counted(code), codes.bad(code)
    bad, good = bad & counted, ~bad & counted
    if not (bad.any() and good.any()):
        got = f'{np.count_nonzero(bad)} outliers and {np.count_nonzero(good)} good points'
        raise RecordingError('the points to learn from', 'outliers and good points', got)
    return Training(tuple(clouds), bad, good, cut(along, STRETCHES), STRETCHES, **facts)


def _read_recording(
    path: Path,
    parameters: FilterParameters,
    topic: str | None,
    labels: CloudLabels,
    injection: Injection | None,
) -> tuple[Sequence[Points], Ints, dict[str, Any]]:
    """Read the clouds of a topic, the code of each point, and what else training has of them."""
    source = RecordedClouds(path, parameters, topic, with_eyes=injection is not None)
    clouds, frames, eyes, read = [], [], [], [np.zeros(0, np.int64)]
    for cloud in source:
        clouds.append(cloud.cloud.points)
        frames.append(cloud.cloud.frame)
        eyes.append(cloud.eye)
        if injection is None:
            read.append(labels.read(cloud.number, cloud.msg)[cloud.cloud.where])
    labels.check_count(len(source.times))
    code = np.concatenate(read)
    if injection is not None:
        clouds, code = inject(clouds, injection, eyes)
    refused = len(source.times) - len(clouds)
    facts = {
        'frames': frames,
        'refused': refused,
        'without_pose': source.read.pipeline.statistics.without_pose,
    }
    return clouds, code, facts


def _read_file(
    path: Path,
    parameters: FilterParameters,
    label: str,
    files: Sequence[Path],
    injection: Injection | None,
) -> tuple[Sequence[Points], Ints]:
    """Read the points of a file as one cloud, and the code of each."""
    file = open_cloud(path)
    names = file_points.choose_coordinates(file, ())
    loaded = file_points.load(file, names, parameters)
    valid = loaded.points.valid
    cloud = loaded.points.take(valid)
    if injection is None:
        code = read_codes_of(files[0] if files else path, len(valid), label)[valid]
    else:
        (cloud,), code = inject([cloud], injection)
    return [with_rings(cloud, parameters)], code


def cut(values: NDArray[Any], stretches: int) -> Ints:
    """Cut points into stretches of equal numbers, by their values (N,) in ascending order."""
    rank = np.empty(len(values), np.int64)
    rank[np.argsort(values, kind='stable')] = np.arange(len(values))
    return rank * stretches // max(len(values), 1)
