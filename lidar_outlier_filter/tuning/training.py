# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the tuner learns from: points whose truth is known, judged as the node would judge them."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from lidar_outlier_filter.core.engine.blocks import Blocks
from lidar_outlier_filter.core.engine.chain import Chain, along_lines, uses_lines
from lidar_outlier_filter.core.engine.stream_cloud import StreamCloud
from lidar_outlier_filter.core.engine.whole_cloud import with_rings
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.evaluation.labels import CloudLabels, read_codes_of
from lidar_outlier_filter.files import points as file_points
from lidar_outlier_filter.files.cloud_file import open_cloud
from lidar_outlier_filter.recordings.recorded_clouds import RecordedClouds
from lidar_outlier_filter.tuning.inject import Injection, inject

if TYPE_CHECKING:
    from collections.abc import Sequence, Sized
    from pathlib import Path

    from numpy.typing import NDArray

    from lidar_outlier_filter.core.annotations import Bools, Ints
    from lidar_outlier_filter.core.points.points import Points
    from lidar_outlier_filter.evaluation.labels import Codes
    from lidar_outlier_filter.parameters.filter import FilterParameters


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
    frames: tuple[str, ...] = ()
    parts: tuple[Training, ...] = ()

    def __len__(self) -> int:
        """Count the points."""
        return len(self.bad)

    @property
    def sources(self) -> Ints:
        """The recording that each stretch, (S,), is of."""
        return np.repeat(
            np.arange(len(self.parts) or 1), [p.stretches for p in self.parts or [self]]
        )

    def judge(self, parameters: FilterParameters, seen: Bools | None = None) -> Verdict:
        """Judge all points as the node would, or as if those that are not seen were not there."""
        if self.parts:
            masks = self._split(seen, self.parts)
            return _joined([p.judge(parameters, m) for p, m in zip(self.parts, masks, strict=True)])
        clouds: Sequence[Points] = self.clouds
        if seen is not None:
            masks = self._split(seen, clouds)
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

    @staticmethod
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


def from_recording(  # noqa: PLR0913  what the command line offers
    recording: Path,
    parameters: FilterParameters,
    codes: Codes,
    topic: str | None = None,
    truth: str | Sequence[Path] | Injection = 'label',
    stretches: int = 20,
) -> Training:
    """Read the clouds of a topic and their truth.

    Parameters
    ----------
    recording : any that ``replay`` reads
    parameters : how the clouds are read and moved, and what makes a block
    codes : what the labels mean
    topic : of clouds; None: the only one
    truth : field of the clouds; or a file for each cloud, in order; or how to make outliers of
        points that are good, all of them
    stretches : how many to cut it into, of equal numbers of points

    Raises
    ------
    FilterError
        If the recording cannot be read, or has no such topic, field or truth.

    """
    injected = isinstance(truth, Injection)
    files = () if isinstance(truth, str | Injection) else truth
    field = truth if isinstance(truth, str) else ''
    labels = CloudLabels(topic or 'the topic', field, files)
    source = RecordedClouds(recording, parameters, topic, with_eyes=injected)
    clouds, frames, eyes, read = [], [], [], [np.zeros(0, np.int64)]
    for cloud in source:
        clouds.append(cloud.cloud.points)
        frames.append(cloud.cloud.frame)
        eyes.append(cloud.eye)
        if not injected:
            read.append(labels.read(cloud.number, cloud.msg)[cloud.cloud.where])
    labels.check_count(len(source.times))
    if isinstance(truth, Injection):
        clouds, code = inject(clouds, truth, eyes)
    else:
        code = np.concatenate(read)
    t = np.concatenate([cloud.t for cloud in clouds]) if clouds else np.zeros(0, np.int64)
    found = _checked(clouds, code, codes, cut(t, stretches), stretches, streamed=True)
    refused = len(source.times) - len(clouds)
    return replace(
        found,
        frames=tuple(frames),
        refused=refused,
        without_pose=source.read.pipeline.statistics.without_pose,
    )


def from_file(  # noqa: PLR0913  what the command line offers
    path: Path,
    parameters: FilterParameters,
    codes: Codes,
    label: str = '',
    labels: Path | None = None,
    injection: Injection | None = None,
    stretches: int = 20,
) -> Training:
    """Read a cloud that is a file, to be judged as a whole, as ``clean`` does.

    Parameters
    ----------
    path : any file that ``clean`` reads
    parameters : how it is read
    codes : what the labels mean
    label : column with the truth
    labels : file with the truth, in the same order; None: the cloud itself
    injection : how to make outliers; None: the truth is in the labels
    stretches : how many to cut it into, of equal numbers of points, along its longest side

    Raises
    ------
    FilterError
        If a file cannot be read, has no such column, or lacks what the chain needs.

    """
    file = open_cloud(path)
    along = along_lines(parameters.chain)
    timed = uses_lines(parameters.chain)
    names = file_points.choose_coordinates(file, ())
    loaded = file_points.load(file, names, parameters, timed=timed)
    if along and not loaded.lines:
        must_be = f'without {along}, as {path} has {loaded.lack}'
        raise RecordingError('chain', must_be, ', '.join(parameters.chain))
    valid = loaded.points.valid
    cloud = loaded.points.take(valid)
    if injection is not None:
        (cloud,), code = inject([cloud], injection)
    else:
        code = read_codes_of(labels or path, len(valid), label)[valid]
    longest = int(np.argmax(np.ptp(cloud.xyz, axis=0))) if len(cloud) else 0
    pieces = cut(cloud.xyz[:, longest], stretches)
    whole = with_rings(cloud, parameters)
    return _checked([whole], code, codes, pieces, stretches, streamed=False)


def cut(values: NDArray[Any], stretches: int) -> Ints:
    """Cut points into stretches of equal numbers, by their values (N,) in ascending order."""
    rank = np.empty(len(values), np.int64)
    rank[np.argsort(values, kind='stable')] = np.arange(len(values))
    return rank * stretches // max(len(values), 1)


def _checked(  # noqa: PLR0913  all that is known
    clouds: Sequence[Points],
    code: Ints,
    codes: Codes,
    stretch: Ints,
    stretches: int,
    *,
    streamed: bool,
) -> Training:
    counted, bad = codes.counted(code), codes.bad(code)
    outliers, good = np.count_nonzero(counted & bad), np.count_nonzero(counted & ~bad)
    if outliers == 0 or good == 0:
        got = f'{outliers} outliers and {good} good points'
        raise RecordingError('the points to learn from', 'outliers and good points', got)
    return Training(tuple(clouds), bad & counted, ~bad & counted, stretch, stretches, streamed)
