# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Why the trees on the scan pattern say what they say: what each feature adds to the log-odds.

A tree asks three questions. Each leaves half of the values that were possible before it: what the
mean of the possible values changes by is what the question's feature adds. The sum over the trees,
and what they say on average, are the log-odds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.detectors.boosted_trees.explain.reasons import (
    add_up_reasons,
    find_means,
)
from lidar_outlier_filter.core.detectors.boosted_trees.models import (
    PATTERN_MODEL,
    PROFILE_MODEL,
    load,
)
from lidar_outlier_filter.core.detectors.boosted_trees.pattern.features import COUNT, FEATURES
from lidar_outlier_filter.core.detectors.boosted_trees.pattern.judge import (
    find_either,
    first_pass,
    second_pass,
)
from lidar_outlier_filter.core.detectors.boosted_trees.pattern.profile_features import (
    COUNT_PROFILE,
    PROFILE,
    measure_profile,
)
from lidar_outlier_filter.core.detectors.boosted_trees.pattern.profile_groups import find_groups
from lidar_outlier_filter.core.detectors.boosted_trees.pattern.scores import (
    AGAIN,
    COUNT_AGAIN,
    measure_again,
)
from lidar_outlier_filter.core.detectors.boosted_trees.pattern.window import Prepared, prepare
from lidar_outlier_filter.core.kernels.kernels import kernel
from lidar_outlier_filter.core.scan_pattern.placed_pattern import spread
from lidar_outlier_filter.errors import FilterError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Singles
    from lidar_outlier_filter.core.detectors.boosted_trees.pattern.scores import FirstPass
    from lidar_outlier_filter.core.detectors.boosted_trees.trees import Trees
    from lidar_outlier_filter.core.points.points import Points

REASONS = (*FEATURES, *AGAIN)


class Reasons(NamedTuple):
    """What the trees say of N points, and what of it is due to which feature.

    Attributes
    ----------
    odds : (N,) float32
        Log-odds: above the model's threshold a point is rejected.
    average : (N,) float32
        What the trees that judged the point say on average.
    added : (F, N) float32
        What each feature of ``names`` adds to that; its sum over F and ``average`` are ``odds``. 0
        for points whose reasons nobody wanted.
    names : of the F features
    threshold : log-odds above which the model rejects a point

    """

    odds: Singles
    average: Singles
    added: Singles
    names: tuple[str, ...]
    threshold: float

    @property
    def strongest(self) -> list[str]:
        """Name the feature that adds the most, of each point; '' where none adds anything.

        Only of those that trees asked about: the others add nothing.
        """
        asked = self.added != 0
        largest = np.where(asked, self.added, -np.inf).argmax(axis=0)
        known = asked.any(axis=0)
        return [self.names[f] if one else '' for f, one in zip(largest, known, strict=True)]


def explain(
    points: Points,
    threads: int = 0,
    *,
    sensor: str = 'spinning',
    wanted: NDArray[np.bool_] | None = None,
) -> Reasons:
    """Explain the log-odds of valid points, in the order given.

    Parameters
    ----------
    points : valid ones; of a spinning sensor in its own frame
    threads : at most so many at once; 0 for as many as there are cores
    sensor : 'spinning', 'profile', or 'auto': whichever it is
    wanted : (N,) bool
        The points whose reasons are wanted; None: all.

    Raises
    ------
    FilterError
        If they have no scan pattern: trees do not judge them.

    """
    found = find_either(points, sensor, threads)
    if found is None:
        raise FilterError('the points to explain', 'those of a scan pattern', 'others')
    pattern, there = found.pattern, found.pattern.order >= 0
    model = load(PROFILE_MODEL if found.profile else PATTERN_MODEL)
    prepared = prepare(pattern, threads)
    if found.profile:
        prepared = prepared._replace(groups=find_groups(pattern, prepared.near, threads))
    first = first_pass(prepared, model.first, threads)
    odds = second_pass(prepared, first, model.again, model.doubtful, threads)
    values = _features(prepared, first)
    again = first.score > np.float32(model.doubtful)
    back = np.empty(len(points), np.int64)
    spread(pattern, np.arange(len(there)), back)
    explained = there.copy()
    if wanted is not None:
        explained[:] = False
        explained[back[wanted]] = True
    added = np.zeros_like(values)
    contribute(model.first, values, explained & ~again, added)
    contribute(model.again, values, explained & again, added)
    average = np.where(again, average_of(model.again), average_of(model.first))
    names = (*FEATURES, *PROFILE, *AGAIN) if found.profile else REASONS
    single = average[back].astype(np.float32)
    return Reasons(odds[back], single, added[:, back], names, model.threshold)


def _features(prepared: Prepared, first: FirstPass) -> Singles:
    """Measure all features of both passes, (F, M)."""
    pattern, lines = prepared.pattern, len(prepared.pattern.first)
    values = np.zeros((COUNT_AGAIN, len(pattern.order)), np.float32)
    measure_again(prepared, first, 0, lines, values)
    if len(prepared.groups) == 0:
        return values
    own = np.zeros((COUNT_PROFILE, len(pattern.order)), np.float32)
    measure_profile(prepared, 0, lines, own)
    return np.concatenate([values[:COUNT], own, values[COUNT:]])


def average_of(trees: Trees) -> float:
    """Return what trees say on average, log-odds."""
    return float(trees.start + trees.value.mean(axis=1, dtype=np.float64).sum())


@kernel
def contribute(trees: Trees, features: Singles, wanted: NDArray[np.bool_], added: Singles) -> None:
    """Add what each feature (F, N) adds to the log-odds of the points that are wanted."""
    means = find_means(trees)
    for k in range(len(wanted)):
        if wanted[k]:
            add_up_reasons(trees, means, features[:, k], added[:, k])
