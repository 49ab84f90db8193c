# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The methods of the default detector, and the choice between them."""

from __future__ import annotations

from enum import Enum

import numpy as np

from lidar_outlier_filter.core.detectors.boosted_trees import neighbour_trees as survey
from lidar_outlier_filter.core.detectors.boosted_trees.pattern_trees import FoundPattern, judge
from lidar_outlier_filter.core.detectors.builtin import BoostedTrees
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.neighbours.floor import measure_floor
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.points.scan_lines import has_lines, order_by_line
from lidar_outlier_filter.core.scan_pattern.own_frame import find_own_frame
from lidar_outlier_filter.core.scan_pattern.profile_pattern import find_profile_pattern
from lidar_outlier_filter.core.scan_pattern.recovered_rings import as_turn, in_bands
from lidar_outlier_filter.core.scan_pattern.scan_pattern import find_pattern
from lidar_outlier_filter.parameters.filter import FilterParameters


class Method(Enum):
    """How the default detector scores a cloud, in words for users."""

    PATTERN = 'trees on the scan pattern'
    NEIGHBOURS = 'trees on the neighbours of each point'
    UNTESTED = 'no trees, untested: a single scan line without a scan pattern'


def find_either(points: Points, sensor: str, threads: int = 0) -> FoundPattern | None:
    """Find the scan pattern of points; None if there is no pattern for the trees.

    Parameters
    ----------
    points : valid ones
    sensor : 'spinning', 'profile', 'auto' (either), or 'free' (a scanner without rings)
    threads : maximum number of threads; 0: all cores

    """
    if sensor == 'free':
        pattern = find_pattern(in_bands(points).in_own_frame, threads, spins=True)
        return None if pattern is None else FoundPattern(pattern, profile=False)
    # A spinning sensor's lines are measured at once, a profile scanner's are not: at most one of
    # the two fits. The own frame of points that may have been moved is sought after both, as it
    # takes long.
    recovered = points.ring is not None
    # Azimuths are known in the sensor's own frame only.
    turned, spins = as_turn(points).in_own_frame, recovered or sensor == 'spinning'
    order = order_by_line(turned)
    if sensor != 'profile':
        pattern = find_pattern(turned, threads, order, spins=spins)
        if pattern is not None:
            return FoundPattern(pattern, profile=False)
    if sensor != 'spinning':
        pattern = find_profile_pattern(points, threads, None if recovered else order)
        if pattern is not None:
            return FoundPattern(pattern, profile=True)
    if sensor == 'profile':
        return None
    pattern = None
    if points.own is None and not recovered:
        moved = find_own_frame(points, order)
        pattern = None if moved is None else find_pattern(moved.in_own_frame, threads, order)
    if pattern is None:
        # Rows of a range image, in whose columns azimuths are not sorted.
        pattern = find_pattern(turned, threads, order, spins=spins, in_rows=True)
    return None if pattern is None else FoundPattern(pattern, profile=False)


def choose(seen: DetectorInput, parameters: FilterParameters) -> tuple[Method, FoundPattern | None]:
    """Choose the method for a cloud; return the scan pattern too, where there is one.

    Without a scan pattern, a point needs neighbours on other scan lines: unless ``sensor`` is
    ``survey``, the points of a block with a single line stay untested.
    """
    points, sensor = seen.points, parameters.of(BoostedTrees).sensor
    is_lined = has_lines(points) or points.ring is not None
    if sensor == 'survey' or (seen.whole and not is_lined and sensor != 'free'):
        return Method.NEIGHBOURS, None
    found = seen.cached(('pattern', sensor), lambda: find_either(points, sensor, seen.threads))
    if found is not None:
        return Method.PATTERN, found
    if seen.whole or (len(points) > 0 and np.ptp(points.line) > 0):
        return Method.NEIGHBOURS, None
    return Method.UNTESTED, None


def detect(seen: DetectorInput, parameters: FilterParameters) -> Scores:
    """Score every point by gradient-boosted trees.

    Points with a scan pattern are compared with the returns next to them on their own scan line and
    on two lines on each side; other points with their 8 and 60 nearest neighbours.

    Parameters
    ----------
    seen : N valid points of a block, or of a whole cloud
    parameters : ``boosted_trees``, ``scores``, ``threads``

    Returns
    -------
    Scores
        ``score`` (N,) float64, max(0, log-odds + 8) ÷ (the model's threshold + 8) ÷ ``threshold``.
        NaN where no method applies, or points have fewer than 8 others.

    Examples
    --------
    >>> import numpy as np
    >>> from lidar_outlier_filter.core.detectors.boosted_trees.methods import detect
    >>> from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
    >>> from lidar_outlier_filter.core.points.points import Points
    >>> from lidar_outlier_filter.parameters.filter import FilterParameters
    >>> x, y = np.divmod(np.arange(900.0), 30)
    >>> xyz = np.column_stack([x, y, 0.01 * np.sin(x)])
    >>> xyz[77, 2] = 6.0  # above a floor
    >>> zeros = np.zeros(900, np.int64)
    >>> points = Points(xyz, zeros, zeros, np.ones(900, np.bool_))
    >>> parameters = FilterParameters()
    >>> found = detect(DetectorInput(points, parameters, whole=True), parameters)
    >>> np.flatnonzero(found.score > 1).tolist()
    [77]

    """
    points, threshold = seen.points, parameters.of(BoostedTrees).threshold
    method, found = choose(seen, parameters)
    if method is Method.UNTESTED:
        return Scores(np.full(len(points), np.nan), scaled=True, method=method.value)
    if found is None:
        around = measure_floor(points.xyz, np.arange(len(points)), parameters.threads)
        odds = survey.measure(points.xyz, around, parameters.threads, seen.allocate)
        return Scores(survey.score(odds, threshold), scaled=True, method=method.value)
    reason = np.zeros(len(points), np.uint8) if parameters.scores else None
    score = judge(found.pattern, threshold, seen.threads, profile=found.profile, reason=reason)
    return Scores(score, reason=reason, scaled=True, method=method.value)
