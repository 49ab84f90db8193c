# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Mixed pixels of spinning sensors: points between the two surfaces that a beam hit together.

Trees of their own judge the points that are nearer or farther than both returns beside them in
their ring. A point whose ring continues at its range is kept, so edges of surfaces stay.
"""

from functools import lru_cache

import numpy as np

from lidar_outlier_filter.core.annotations import Bools
from lidar_outlier_filter.core.detectors.boosted_trees.features import REASON_NUMBERS, WINDOW
from lidar_outlier_filter.core.detectors.boosted_trees.methods import choose
from lidar_outlier_filter.core.detectors.boosted_trees.pattern_trees import (
    scale,
    stands_off,
    write_odds,
)
from lidar_outlier_filter.core.detectors.boosted_trees.trees import (
    MIN_LOG_ODDS,
    MIXED_MODEL,
    PATTERN_MODEL,
    Trees,
    read_file,
    read_trees,
)
from lidar_outlier_filter.core.detectors.boosted_trees.window import prepare
from lidar_outlier_filter.core.detectors.builtin import MixedPixels
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.scan_pattern.placed_pattern import Pattern
from lidar_outlier_filter.parameters.filter import FilterParameters

# Differences of range from the returns before and after, metres: the lesser and the greater of a
# point that may be mixed are larger.
MIN_LESSER, MIN_GREATER = 0.03, 0.12
REASON = REASON_NUMBERS['between_surfaces']


@lru_cache
def _load() -> tuple[Trees, float]:
    """Read the trees, and the log-odds above which they reject a point."""
    data = read_file(MIXED_MODEL)
    return read_trees(data['trees'], (*WINDOW,)), float(data['threshold'])


def may_be_mixed(pattern: Pattern) -> Bools:
    """Return which positions (M,) of a pattern the trees judge: those that stand off in range."""
    return stands_off(pattern, MIN_LESSER, MIN_GREATER)


def detect(seen: DetectorInput, parameters: FilterParameters) -> Scores:
    """Score the points of a spinning sensor by how likely they lie between two surfaces.

    Parameters
    ----------
    seen : N valid points of a block, or of a whole cloud
    parameters : ``mixed_pixels``, ``boosted_trees.sensor``, ``scores``, ``threads``

    Returns
    -------
    Scores
        ``score`` (N,) float64, max(0, log-odds + 8) ÷ (the model's threshold + 8) ÷ ``threshold``;
        0 for points that do not stand off from the returns beside them. NaN without the scan
        pattern of a spinning sensor's rings.

    """
    found = choose(seen, parameters)[1]
    if found is None or found.model != PATTERN_MODEL:
        return Scores(np.full(len(seen.points), np.nan), scaled=True)
    pattern, (trees, limit) = found.pattern, _load()
    odds = np.full(len(pattern.order), MIN_LOG_ODDS, np.float32)
    prepared = prepare(pattern, seen.threads)
    write_odds(prepared, None, may_be_mixed(pattern), trees, seen.threads, odds)
    most = parameters.of(MixedPixels).threshold * (limit - MIN_LOG_ODDS)
    score, _ = scale(pattern, odds, most, seen.threads)
    reason = np.where(score > 1, REASON, 0).astype(np.uint8) if parameters.scores else None
    return Scores(score, reason=reason, scaled=True)
