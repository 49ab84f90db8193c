# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Why points were rejected, or nearly: what each feature adds, noted while blocks are judged."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.chain import Chain
from lidar_outlier_filter.core.detectors.evidence.pattern_reasons import explain
from lidar_outlier_filter.errors import FilterError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.core.points import Points
    from lidar_outlier_filter.core.stream_cloud import StreamCloud
    from lidar_outlier_filter.core.verdict import Verdict
    from lidar_outlier_filter.parameters.filter import FilterParameters

NEAR = 0.8  # scores above this are explained, too
MOST_IN_BLOCK = 2000  # points that are explained of those judged together
STRONGEST = 8  # features that are kept of each


@dataclass(frozen=True)
class Reason:
    """Why one point has its score.

    Attributes
    ----------
    score : that of the chain, float32
    features : numbers of those that add most or take away most, the largest first
    added : what each adds to the log-odds

    """

    score: float
    features: NDArray[np.uint8]
    added: NDArray[np.float32]


@dataclass(eq=False)
class NotedReasons:
    """The reasons noted so far.

    Attributes
    ----------
    names : of the features; empty: nothing was explained

    """

    names: tuple[str, ...] = ()
    _noted: dict[bytes, tuple[int, list[Reason]]] = field(default_factory=dict)

    def note(self, points: Points, verdict: Verdict, parameters: FilterParameters) -> None:
        """Explain the points of a block that are rejected, or nearly so."""
        wanted = _chosen(verdict)
        if not wanted.any():
            return
        threads, sensor = parameters.threads, parameters.evidence.sensor
        try:
            found = explain(points, threads, sensor=sensor, wanted=wanted)
        except FilterError:  # they have no scan pattern: a weighted sum judged them
            return
        self.names = found.names
        where = np.flatnonzero(wanted)
        added = found.added[:, where]
        order = np.argsort(-np.abs(added), axis=0, kind='stable')[:STRONGEST]
        largest = np.take_along_axis(added, order, axis=0)
        for i, key in enumerate(_keys(points, where)):
            reason = Reason(
                float(verdict.score[where[i]]),
                order[:, i].astype(np.uint8),
                largest[:, i],
            )
            self._noted.setdefault(key, (int(points.t[where[i]]), []))[1].append(reason)

    def of(self, cloud: StreamCloud) -> dict[int, Reason]:
        """Find the reasons of the points of a finished cloud, by their places in it.

        A point is explained as often as it is seen, as halo too: the reason that counts is the one
        whose score it has in the end.
        """
        score = cloud.verdict.score
        where = np.flatnonzero(score > NEAR)
        found = {}
        for place, key in zip(where.tolist(), _keys(cloud.points, where), strict=True):
            for reason in self._noted.get(key, (0, []))[1]:
                if reason.score == float(score[place]):
                    found[place] = reason
                    break
        return found

    def forget_before(self, cloud: StreamCloud) -> None:
        """Forget the points before the first of a finished cloud: those that follow are later."""
        for key in [key for key, (last, _) in self._noted.items() if last < cloud.first]:
            del self._noted[key]


class ExplainingChain(Chain):
    """A chain that notes the reasons of what it rejects."""

    def __init__(self, parameters: FilterParameters) -> None:
        """Note reasons where the default judges alone: those of trees."""
        # Under `scores` detectors give the strongest reason, too; no verdict depends on it.
        super().__init__(parameters.changed({'scores': True}))
        self.reasons = NotedReasons()
        self._explains = tuple(parameters.chain) == ('evidence',)

    def judge(self, points: Points) -> Verdict:
        """Judge valid points, and explain some of them."""
        verdict = super().judge(points)
        if self._explains:
            self.reasons.note(points, verdict, self.parameters)
        return verdict


def _chosen(verdict: Verdict) -> NDArray[np.bool_]:
    """Choose the rejected points, then those nearest to it, as far as the bound allows."""
    near = np.flatnonzero(verdict.score > NEAR)
    if len(near) > MOST_IN_BLOCK:
        rejected = verdict.rejected[near]
        order = np.lexsort((np.arange(len(near)) * 7919 % len(near), ~rejected))
        near = near[order[:MOST_IN_BLOCK]]
    wanted = np.zeros(len(verdict), np.bool_)
    wanted[near] = True
    return wanted


def _keys(points: Points, where: NDArray[np.intp]) -> list[bytes]:
    """Name points by all that is known of them."""
    columns = [points.xyz[where].view(np.int64), points.t[where, None], points.line[where, None]]
    return [row.tobytes() for row in np.hstack(columns)]
