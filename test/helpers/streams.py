# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Streams of tagged points, and what a census of them counts."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np

from lidar_outlier_filter.core.engine.blocks import Blocks
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.engine.stream_cloud import StreamCloud
from lidar_outlier_filter.core.points.points import SECOND, Points
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.parameters.filter import FilterParameters

BLOCK, HALO = 10_000_000, 2_000_000  # nanoseconds


@dataclass
class Census:
    """Stands in for a chain: the score of a point says which points were judged with it.

    ``check`` is called with the times of each block, and may raise.
    """

    blocks: list[list[int]] = field(default_factory=list)
    check: Callable[[list[int]], object] = len

    def judge(self, points: Points) -> Verdict:
        """Score every point by the sum of what was seen."""
        times = points.t.tolist()
        self.blocks.append(times)
        self.check(times)
        verdict = Verdict.untested(len(points))
        verdict.score[:] = number_of(times)
        verdict.detectors[:] = 1
        verdict.settle(1)
        return verdict


def number_of(times: Sequence[int]) -> int:
    """Give a number that differs where the times do, exact in float32."""
    return sum(t // 1000 % 9973 for t in times) % 2**23


@dataclass(eq=False)
class TaggedCloud(StreamCloud):
    """A cloud with a name."""

    tag: Any = None


def stream(**values: object) -> tuple[Blocks[TaggedCloud], Census]:
    """Make a stream with short blocks and a census for a chain."""
    short = {'block': BLOCK / SECOND, 'halo': HALO / SECOND}
    made, census = Blocks[TaggedCloud](FilterParameters().changed(short | values)), Census()
    made.chain = cast('Chain', census)
    return made, census


def push(
    made: Blocks[TaggedCloud], points: Points, tag: Any = None, frame: str = ''
) -> list[TaggedCloud]:
    """Push a cloud with a name."""
    return made.push(TaggedCloud(points, frame, tag))


def held(made: Blocks[TaggedCloud]) -> int:
    """Count the points held."""
    return max(made._seen_points, made._pending_points)


def points_at(times: Sequence[int], no_return: Sequence[bool] = ()) -> Points:
    """Make points at these nanoseconds."""
    count = len(times)
    valid = ~np.array(no_return, np.bool_) if len(no_return) else np.ones(count, np.bool_)
    t = np.where(valid, np.array(times, np.int64), 0)
    return Points(np.zeros((count, 3)), t, np.zeros(count, np.int64), valid)
