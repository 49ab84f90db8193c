# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Streams of tagged points, and what a census of them counts."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np

from lidar_outlier_filter.core.engine.blocks import Blocks
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.engine.stream_cloud import StreamCloud
from lidar_outlier_filter.core.points.points import SECOND, Points
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.errors import JudgingError
from lidar_outlier_filter.parameters.filter import FilterParameters

BLOCK, HALO = 10_000_000, 2_000_000  # nanoseconds


@dataclass
class Census:
    """Stands in for a chain: the score of a point says which points were judged with it."""

    bit: int = 1
    blocks: list[list[int]] = field(default_factory=list)

    def judge(self, points: Points) -> Verdict:
        """Score every point by the sum of what was seen."""
        self.blocks.append(points.t.tolist())
        verdict = Verdict.untested(len(points))
        verdict.score[:] = number_of(points.t.tolist())
        verdict.detectors[:] = self.bit
        verdict.settle(1)
        return verdict


def number_of(times: Sequence[int]) -> int:
    """Give a number that differs where the times do, exact in float32."""
    return sum(t // 1000 % 9973 for t in times) % 2**23


@dataclass(eq=False)
class TaggedCloud(StreamCloud):
    """A cloud with a name."""

    tag: Any = None


class TaggedStream:
    """A stream of clouds with names: points and tag in, tag and verdict out.

    Attributes
    ----------
    stream : the stream itself
    errors : of the clouds that could not be judged, by tag

    """

    def __init__(self, parameters: FilterParameters) -> None:
        """Make the stream."""
        self.stream: Blocks[TaggedCloud] = Blocks(parameters)
        self.errors: dict[Any, JudgingError] = {}

    @property
    def waiting(self) -> int:
        """Count the clouds without output."""
        return len(self.stream.pending)

    @property
    def held(self) -> int:
        """Count the points held."""
        return max(self.stream._seen_points, self.stream._pending_points)

    @property
    def resets(self) -> int:
        """Count how often the clock was set back."""
        return self.stream.resets

    @property
    def oldest(self) -> Any:
        """The tag of the cloud that has waited longest."""
        return self.stream.pending[0].tag if self.stream.pending else None

    def push(self, points: Points, tag: Any = None, frame: str = '') -> list[tuple[Any, Verdict]]:
        """Push a cloud."""
        return self._verdicts(self.stream.push(TaggedCloud(points, frame, tag)))

    def take_finished(self) -> list[tuple[Any, Verdict]]:
        """Return what is finished."""
        return self._verdicts(self.stream.take_finished())

    def flush_pending(self) -> list[tuple[Any, Verdict]]:
        """Judge all that is pending, and go on."""
        return self._verdicts(self.stream.flush_pending())

    def flush(self) -> list[tuple[Any, Verdict]]:
        """Judge all pending clouds, and reset."""
        return self._verdicts(self.stream.flush())

    def _verdicts(self, finished: list[TaggedCloud]) -> list[tuple[Any, Verdict]]:
        self.errors.update((cloud.tag, cloud.error) for cloud in finished if cloud.error)
        return [(cloud.tag, cloud.verdict) for cloud in finished]


def stream(**values: object) -> tuple[TaggedStream, Census]:
    """Make a stream with short blocks and a census for a chain."""
    short = {'block': BLOCK / SECOND, 'halo': HALO / SECOND}
    made = TaggedStream(FilterParameters().changed(short | values))
    census = Census()
    made.stream.chain = cast('Chain', census)
    return made, census


def points_at(times: Sequence[int], no_return: Sequence[bool] = ()) -> Points:
    """Make points at these nanoseconds."""
    count = len(times)
    valid = ~np.array(no_return, np.bool_) if len(no_return) else np.ones(count, np.bool_)
    t = np.where(valid, np.array(times, np.int64), 0)
    return Points(np.zeros((count, 3)), t, np.zeros(count, np.int64), valid)
