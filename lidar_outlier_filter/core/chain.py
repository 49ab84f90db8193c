# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The chain: detectors in their order, each on what the earlier ones left, or all on everything."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.core.points import Points
from lidar_outlier_filter.core.seen import Seen
from lidar_outlier_filter.core.verdict import Verdict

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lidar_outlier_filter.parameters.filter import FilterParameters


def along_lines(chain: Sequence[str]) -> str:
    """List those detectors of a chain that need scan lines, for people; empty: none does."""
    return ', '.join(name for name in chain if DETECTORS[name].needs_lines)


class Chain:
    """The detectors of one set of parameters."""

    def __init__(self, parameters: FilterParameters) -> None:
        """Choose the detectors that ``parameters.chain`` names."""
        self.parameters = parameters
        self.passes = 0  # the most that a detector has needed
        self._detectors = [DETECTORS[name] for name in parameters.chain]
        # The lists that all detectors share are as long as the longest that one asks for.
        self._neighbours = max(1, *(one.neighbours(parameters) for one in self._detectors))

    def judge(self, points: Points) -> Verdict:
        """Judge valid points that lie together in time; the verdict is in their order."""
        parameters = self.parameters
        verdict = Verdict.untested(len(points))
        where = np.arange(len(points))
        seen = Seen(points, parameters, self._neighbours)
        for detector in self._detectors:
            found = detector.detect(seen, parameters)
            verdict.add(detector.bit, where, found.score, found.extra)
            self.passes = max(self.passes, found.passes)
            # Behind the last one nobody looks at what is left.
            if parameters.vote == 0 and detector is not self._detectors[-1]:
                rejected = found.score > 1
                if rejected.any():
                    where, seen = where[~rejected], seen.without(rejected)
        verdict.settle(max(parameters.vote, 1))
        return verdict

    def compile(self) -> None:
        """Run every detector once on a few points, so that its kernels are ready."""
        count = 128  # enough for each detector of the defaults to judge them
        xyz = np.zeros((count, 3))
        xyz[:, 0] = np.arange(count)
        xyz[count // 2, 2] = 10.0
        t = np.arange(count) * 1000
        line, valid = np.zeros(count, np.int64), np.ones(count, np.bool_)
        for order in (np.arange(count), np.arange(count)[::-1]):
            self.judge(Points(xyz, t, line, valid).take(order))
        # Four rings of a spinning sensor.
        turned, ring = np.linspace(0.0, 6.0, count // 4), np.repeat(np.arange(4), count // 4)
        level = np.column_stack([np.cos(turned), np.sin(turned), np.zeros(count // 4)])
        xyz = np.tile(level, (4, 1))
        xyz[:, 2] = 0.1 * ring
        self.judge(Points(xyz, np.tile(t[: count // 4], 4), ring, valid))
        self.passes = 0
