# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Why points were rejected, or nearly: what each feature adds, noted while blocks are judged."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.detectors.registry import explanations
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.report.score_counts import above, exceeded

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from lidar_outlier_filter.core.detectors.declaration import Detector
    from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
    from lidar_outlier_filter.core.detectors.explanation import Explanation
    from lidar_outlier_filter.core.detectors.scores import Scores
    from lidar_outlier_filter.core.engine.stream_cloud import StreamCloud
    from lidar_outlier_filter.core.points.points import Points
    from lidar_outlier_filter.parameters.filter import FilterParameters
    from lidar_outlier_filter.report.sliders import SliderValues

NEAR = 0.8  # scores above this are explained, too
MOST_IN_BLOCK = 2000  # points that are explained of those judged together
MOST_IN_CLOUD = 20_000  # of a whole cloud
STRONGEST = 6  # features that are kept of each
ADDED = STRONGEST + 2
REST = (('others', 'all other features together'), ('average', 'what the trees say on average'))


class Vocabulary(NamedTuple):
    """The features of all detectors that explain their scores.

    Attributes
    ----------
    features : (name, few words) of each; a name may mean different things. REST follows
    of_sum : from there on, features add up to scores; the others to log-odds
    number : number of a feature, by way and name

    """

    features: tuple[tuple[str, str], ...]
    of_sum: int
    number: dict[tuple[str, str], int]


@cache
def vocabulary() -> Vocabulary:
    """Put the features of all ways into one order."""
    odds: list[tuple[str, Mapping[str, str]]] = []
    sums: list[tuple[str, Mapping[str, str]]] = []
    for one in explanations().values():
        for way, texts in one.ways.items():
            (sums if way in one.of_score else odds).append((way, texts))
    every = [(way, name, text) for way, texts in odds + sums for name, text in texts.items()]
    index = {(way, name): number for number, (way, name, _) in enumerate(every)}
    features = tuple((name, text) for _, name, text in every)
    return Vocabulary(features, sum(len(texts) for _, texts in odds), index)


@dataclass(frozen=True)
class Reason:
    """Why one point has its score.

    Attributes
    ----------
    score : that of the chain, float32
    features : (ADDED,) uint16
        Indices in the vocabulary of those that add or take away most, the largest first; then those
        of ``REST``.
    added : (ADDED,) float32
        What each adds to the log-odds, or to the score.

    """

    score: float
    features: NDArray[np.uint16]
    added: NDArray[np.float32]


@dataclass(eq=False)
class NotedReasons:
    """The reasons noted so far.

    Attributes
    ----------
    ways : how detectors judged

    """

    ways: set[str] = field(default_factory=set)
    _noted: dict[bytes, tuple[int, list[Reason]]] = field(default_factory=dict)

    def note(
        self,
        explanation: Explanation,
        seen: DetectorInput,
        score: NDArray[np.float64],
        parameters: FilterParameters,
    ) -> None:
        """Explain the points that a detector rejects, or nearly so."""
        wanted = _chosen(score, MOST_IN_CLOUD if seen.whole else MOST_IN_BLOCK)
        if not wanted.any():
            return
        points, single = seen.points, score.astype(np.float32)
        found = explanation.explain(seen, parameters, wanted)
        self.ways.add(found.way)
        known = vocabulary()
        indices = np.array([known.number[found.way, name] for name in found.names], np.uint16)
        where = np.flatnonzero(wanted)
        order = np.argsort(-np.abs(found.added), axis=0, kind='stable')[:STRONGEST]
        largest = np.take_along_axis(found.added, order, axis=0)
        others = found.added.sum(axis=0) - largest.sum(axis=0)
        added = np.concatenate([largest, [others, found.average]])
        rest = len(known.features) + np.arange(len(REST), dtype=np.uint16)
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
    """A chain that notes the reasons of what its detectors reject, where they can say.

    Attributes
    ----------
    rejected : by detector, how many points each of its values would reject; points that are judged
        twice, as halo too, count twice

    """

    def __init__(self, parameters: FilterParameters, possible: Sequence[SliderValues]) -> None:
        """Note reasons where a detector of the chain explains its scores."""
        # Under `scores` detectors give the strongest reason, too; no verdict depends on it.
        super().__init__(parameters.changed({'scores': True}))
        self.reasons = NotedReasons()
        self.rejected = {one.detector: np.zeros(len(one.values), np.int64) for one in possible}
        self._limits = {one.detector: one.limits for one in possible}
        self._detectors = [replace(one, score=partial(self._noted, one)) for one in self._detectors]

    def _noted(self, one: Detector, seen: DetectorInput, parameters: FilterParameters) -> Scores:
        found = one.detect(seen, parameters)
        if one.name in self._limits:
            limits = self._limits[one.name]
            bins = np.bincount(exceeded(found.score, limits), minlength=len(limits) + 1)
            self.rejected[one.name] += above(bins)
        if one.name in explanations():
            self.reasons.note(explanations()[one.name], seen, found.score, parameters)
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


def _keys(points: Points, where: NDArray[np.intp]) -> list[bytes]:
    """Name points by all that is known of them."""
    columns = [points.xyz[where].view(np.int64), points.t[where, None], points.line[where, None]]
    return [row.tobytes() for row in np.hstack(columns)]
