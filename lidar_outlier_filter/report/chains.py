# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Chains for a report: one that notes why points are rejected, and many that share neighbours."""

from collections.abc import Hashable, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Bools, Floats, Ints, Singles
from lidar_outlier_filter.core.detectors.declaration import Detector
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.detectors.registry import explanations, reasons
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.engine.stream_cloud import StreamCloud
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.report.steps import Slider, above, exceeded

NEAR_SCORE = 0.8  # points with a larger score are explained
MAX_IN_BLOCK, MAX_IN_CLOUD = 2000, 20_000  # explained points of a block, and of a whole cloud
STRONGEST = 3  # features that are kept of each point
SHARED_BLOCKS = 4  # chains judge a block one after the other, or a few blocks


@cache
def features() -> dict[tuple[str, str], str]:
    """Return a few words for each feature, by method and name."""
    return {
        (method, name): text
        for one in explanations().values()
        for method, texts in one.METHODS.items()
        for name, text in texts.items()
    }


class ExplainingChain(Chain):
    """A chain that notes the features that speak most for a rejection, where detectors can say.

    Attributes
    ----------
    rejected : by detector, how many points each value of its threshold would reject; points that
        are judged twice, as halo too, count twice
    used : the methods of the detectors

    """

    def __init__(self, parameters: FilterParameters, possible: Sequence[Slider]) -> None:
        """Judge by these parameters; ``possible`` has all values of the thresholds."""
        # `scores` adds the strongest reason and changes no verdict.
        super().__init__(parameters.changed({'scores': True}))
        self.rejected = {one.detector: np.zeros(len(one.values), np.int64) for one in possible}
        self.used: set[str] = set()
        self._limits = {one.detector: one.limits for one in possible}
        # By point: its time, and score, features and contributions of each time it was judged.
        self._noted: dict[bytes, tuple[int, list[tuple[float, Ints, Singles]]]] = {}
        self._detectors = [
            replace(one, score=partial(self._detect, one)) for one in self._detectors
        ]

    def _detect(self, one: Detector, seen: DetectorInput, parameters: FilterParameters) -> Scores:
        found = one.detect(seen, parameters)
        if one.name in self._limits:
            limits = self._limits[one.name]
            bins = np.bincount(exceeded(found.score, limits), minlength=len(limits) + 1)
            self.rejected[one.name] += above(bins)
        selected = _to_explain(found.score, MAX_IN_CLOUD if seen.whole else MAX_IN_BLOCK)
        if one.name in explanations() and selected.any():
            self._note(one.name, seen, found.score, parameters, selected)
        return found

    def _note(
        self,
        name: str,
        seen: DetectorInput,
        score: Floats,
        parameters: FilterParameters,
        selected: Bools,
    ) -> None:
        """Note the features that add most to the scores of the selected points."""
        found = explanations()[name].contributions(seen, parameters, selected)
        self.used.add(found.method)
        number = {key: k for k, key in enumerate(features(), 1)}
        numbers = np.array([number[found.method, one] for one in found.names])
        # Features that only say where outliers are likely have no number as reasons.
        named = np.isin(found.names, [one.name for one in reasons().values()])
        speaking = np.where(named[:, None] | ~named.any(), found.added, -np.inf)
        order = np.argsort(-speaking, axis=0, kind='stable')[:STRONGEST]
        added = np.maximum(np.take_along_axis(speaking, order, axis=0), 0)
        where, single = np.flatnonzero(selected), score.astype(np.float32)
        for i, key in enumerate(_keys(seen.points, where)):
            noted = float(single[where[i]]), numbers[order[:, i]], added[:, i]
            self._noted.setdefault(key, (int(seen.points.t[where[i]]), []))[1].append(noted)

    def why(self, cloud: StreamCloud) -> tuple[Ints, Singles]:
        """Return for each point of a finished cloud the features that add most, and what they add.

        Features (N, STRONGEST) are numbers in :func:`features`, from 1; 0: no feature. A point is
        judged several times, also as halo: the explanation with its final score counts.
        """
        score = cloud.verdict.score
        numbers = np.zeros((len(score), STRONGEST), np.int64)
        added = np.zeros((len(score), STRONGEST), np.float32)
        where = np.flatnonzero(score > NEAR_SCORE)
        for index, key in zip(where.tolist(), _keys(cloud.points, where), strict=True):
            for noted, names, values in self._noted.get(key, (0, []))[1]:
                if noted == float(score[index]):
                    numbers[index, : len(names)] = np.where(values > 0, names, 0)
                    added[index, : len(names)] = values
                    break
        # The clouds that follow are later.
        for key in [key for key, (last, _) in self._noted.items() if last < cloud.first]:
            del self._noted[key]
        return numbers, added


def _to_explain(score: Floats, most: int) -> Bools:
    """Choose the rejected points, then others near the threshold, at most so many."""
    near = np.flatnonzero(score > NEAR_SCORE)
    if len(near) > most:
        order = np.lexsort((np.arange(len(near)) * 7919 % len(near), score[near] <= 1))
        near = near[order[:most]]
    selected = np.zeros(len(score), np.bool_)
    selected[near] = True
    return selected


def _keys(points: Points, where: NDArray[np.intp]) -> list[bytes]:
    """Identify points by position, time and line."""
    columns = [points.xyz[where].view(np.int64), points.t[where, None], points.line[where, None]]
    return [row.tobytes() for row in np.hstack(columns)]


class SharedInputs:
    """Gives chains that differ in a threshold only the same input for the same points."""

    def __init__(self) -> None:
        self._known: dict[tuple[object, ...], DetectorInput] = {}

    def __call__(
        self,
        points: Points,
        parameters: FilterParameters,
        neighbours: int,
        *,
        whole: bool,
        kept: dict[Hashable, Any] | None = None,
    ) -> DetectorInput:
        """Return the cached input of equal points, or a new one."""
        columns = (points.xyz, points.t, points.line)
        key = (neighbours, whole, *(column.tobytes() for column in columns))
        if key not in self._known:
            while len(self._known) >= SHARED_BLOCKS:
                del self._known[next(iter(self._known))]
            self._known[key] = DetectorInput(points, parameters, neighbours, whole=whole, kept=kept)
        return self._known[key]
