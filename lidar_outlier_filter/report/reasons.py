# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Why points were rejected, or nearly: what each feature adds, noted while blocks are judged."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.detectors.evidence.declaration import DETECTOR as EVIDENCE
from lidar_outlier_filter.core.detectors.evidence.declaration import Way
from lidar_outlier_filter.core.detectors.evidence.explain.contributions import contributions
from lidar_outlier_filter.core.detectors.evidence.explain.pattern_reasons import REASONS
from lidar_outlier_filter.core.detectors.evidence.pattern.profile_features import PROFILE
from lidar_outlier_filter.core.detectors.evidence.survey.far import NAMES
from lidar_outlier_filter.core.detectors.evidence.weighted_sum.detector import PARTS
from lidar_outlier_filter.core.judging.chain import Chain

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.core.detectors.scores import Scores
    from lidar_outlier_filter.core.detectors.seen import Seen
    from lidar_outlier_filter.core.judging.stream_cloud import StreamCloud
    from lidar_outlier_filter.core.points.points import Points
    from lidar_outlier_filter.parameters.filter import FilterParameters

NEAR = 0.8  # scores above this are explained, too
MOST_IN_BLOCK = 2000  # points that are explained of those judged together
MOST_IN_CLOUD = 20_000  # of a whole cloud
STRONGEST = 6  # features that are kept of each
# Features of every way to judge; one name may mean different things. Parts of a sum stand last.
OF_WAY = {Way.PATTERN: (*REASONS, *PROFILE), Way.SURVEY: NAMES, Way.SUM: PARTS}
FEATURES = tuple(name for names in OF_WAY.values() for name in names)
OF_SUM = len(FEATURES) - len(PARTS)
# Behind them: all other features together, and what trees say on average.
OTHERS, AVERAGE = len(FEATURES), len(FEATURES) + 1
ADDED = STRONGEST + 2


@dataclass(frozen=True)
class Reason:
    """Why one point has its score.

    Attributes
    ----------
    score : that of the chain, float32
    features : (ADDED,) uint8
        Indices in ``FEATURES`` of those that add or take away most, the largest first; then
        ``OTHERS`` and ``AVERAGE``.
    added : (ADDED,) float32
        What each adds to the log-odds; from ``OF_SUM`` on, to the score.

    """

    score: float
    features: NDArray[np.uint8]
    added: NDArray[np.float32]


@dataclass(eq=False)
class NotedReasons:
    """The reasons noted so far.

    Attributes
    ----------
    ways : how the default judged

    """

    ways: set[Way] = field(default_factory=set)
    _noted: dict[bytes, tuple[int, list[Reason]]] = field(default_factory=dict)

    def note(self, seen: Seen, score: NDArray[np.float64], parameters: FilterParameters) -> None:
        """Explain the points that the default rejects, or nearly so."""
        wanted = _chosen(score, MOST_IN_CLOUD if seen.whole else MOST_IN_BLOCK)
        if not wanted.any():
            return
        points, single = seen.points, score.astype(np.float32)
        found = contributions(seen, parameters, wanted)
        self.ways.add(found.way)
        indices = _indices(found.way, found.names)
        where = np.flatnonzero(wanted)
        order = np.argsort(-np.abs(found.added), axis=0, kind='stable')[:STRONGEST]
        largest = np.take_along_axis(found.added, order, axis=0)
        others = found.added.sum(axis=0) - largest.sum(axis=0)
        added = np.concatenate([largest, [others, found.average]])
        rest = np.array([OTHERS, AVERAGE], np.uint8)
        for i, key in enumerate(_keys(points, where)):
            features = np.concatenate([indices[order[:, i]], rest])
            reason = Reason(float(single[where[i]]), features, added[:, i])
            self._noted.setdefault(key, (int(points.t[where[i]]), []))[1].append(reason)

    def of(self, cloud: StreamCloud) -> dict[int, Reason]:
        """Find the reasons of the points of a finished cloud, by their indices in it.

        A point is explained as often as it is seen, as halo too: the reason that counts is the one
        whose score it has in the end.
        """
        score = cloud.verdict.score
        where = np.flatnonzero(score > NEAR)
        found = {}
        for index, key in zip(where.tolist(), _keys(cloud.points, where), strict=True):
            for reason in self._noted.get(key, (0, []))[1]:
                if reason.score == float(score[index]):
                    found[index] = reason
                    break
        return found

    def forget_before(self, cloud: StreamCloud) -> None:
        """Forget the points before the first of a finished cloud: those that follow are later."""
        for key in [key for key, (last, _) in self._noted.items() if last < cloud.first]:
            del self._noted[key]


class ExplainingChain(Chain):
    """A chain that notes the reasons of what the default rejects."""

    def __init__(self, parameters: FilterParameters) -> None:
        """Note reasons where the default is one of the chain."""
        # Under `scores` detectors give the strongest reason, too; no verdict depends on it.
        super().__init__(parameters.changed({'scores': True}))
        self.reasons = NotedReasons()
        self._detectors = [
            replace(one, detect=self._explained) if one is EVIDENCE else one
            for one in self._detectors
        ]

    def _explained(self, seen: Seen, parameters: FilterParameters) -> Scores:
        found = EVIDENCE.detect(seen, parameters)
        self.reasons.note(seen, found.score, parameters)
        return found


def _chosen(score: NDArray[np.float64], most: int) -> NDArray[np.bool_]:
    """Choose the rejected points, then those nearest to it, as far as the bound allows."""
    near = np.flatnonzero(score > NEAR)
    if len(near) > most:
        order = np.lexsort((np.arange(len(near)) * 7919 % len(near), score[near] <= 1))
        near = near[order[:most]]
    wanted = np.zeros(len(score), np.bool_)
    wanted[near] = True
    return wanted


def _indices(way: Way, names: tuple[str, ...]) -> NDArray[np.uint8]:
    """Find the features of one way in ``FEATURES``."""
    before = {Way.PATTERN: 0, Way.SURVEY: len(OF_WAY[Way.PATTERN]), Way.SUM: OF_SUM}[way]
    return np.array([before + OF_WAY[way].index(name) for name in names], np.uint8)


def _keys(points: Points, where: NDArray[np.intp]) -> list[bytes]:
    """Name points by all that is known of them."""
    columns = [points.xyz[where].view(np.int64), points.t[where, None], points.line[where, None]]
    return [row.tobytes() for row in np.hstack(columns)]
