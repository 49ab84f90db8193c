# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A field out of its bounds, in a band of ranges: such as dust near the sensor, which is dark."""

import numpy as np

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.detectors.builtin import FieldRange
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.parameters.filter import FilterParameters


def score(seen: DetectorInput, parameters: FilterParameters) -> Scores:
    """Score every point of a chain's input; none is tested where the field is missing."""
    points, own = seen.points, parameters.of(FieldRange)
    if points.field is None:
        return Scores(np.full(len(points), np.nan))
    return Scores(detect(points.field, points.range, own))


def detect(values: Floats, reach: Floats, parameters: FieldRange) -> Floats:
    """Score points by a field; values at a limit are kept.

    Parameters
    ----------
    values : (N,) float64, of the field
    reach : (N,) float64, distances from the sensor, metres
    parameters : see :class:`~.builtin.FieldRange`

    Returns
    -------
    (N,) float64
        ``max_range`` ÷ range for values out of bounds, from ``min_range`` on; 0 for others. NaN
        where the value is not finite.

    References
    ----------
    .. [1] Rules of ouster-ros, https://github.com/ouster-lidar/ouster-ros/pull/568

    Examples
    --------
    >>> import numpy as np
    >>> from lidar_outlier_filter.core.detectors import field_range
    >>> from lidar_outlier_filter.core.detectors.builtin import FieldRange
    >>> reflectivity, reach = np.array([2.0, 30.0, 2.0]), np.array([4.0, 4.0, 40.0])
    >>> dark_and_near = FieldRange(min_value=5.0, max_range=10.0)
    >>> (field_range.detect(reflectivity, reach, dark_and_near) > 1).tolist()
    [True, False, False]

    """
    outside = (values < parameters.min_value) | (values > parameters.max_value)
    with np.errstate(divide='ignore', over='ignore'):  # at the sensor itself
        found = np.where(outside & (reach >= parameters.min_range), parameters.max_range / reach, 0)
    found[~np.isfinite(values)] = np.nan
    return found
