# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Points out of range, and inside or outside a box: PCL's CropBox as a detector."""

import numpy as np

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.detectors.builtin import CropBox
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.parameters.filter import FilterParameters


def score(seen: DetectorInput, parameters: FilterParameters) -> Scores:
    """Score every point of a chain's input."""
    return Scores(detect(seen.points.in_own_frame.xyz, parameters.of(CropBox)))


def detect(xyz: Floats, parameters: CropBox) -> Floats:
    """Score points by their range and the box; points at a limit are kept.

    Parameters
    ----------
    xyz : (N, 3) float64, in the frame of the sensor, metres
    parameters : see :class:`~.builtin.CropBox`

    Returns
    -------
    (N,) float64
        Range ÷ ``max_range``; inf for points nearer than ``min_range``, and for those outside the
        box, or inside with ``negative``.

    References
    ----------
    .. [1] CropBox of PCL, https://pointclouds.org, and crop_box_filter of Autoware

    Examples
    --------
    >>> import numpy as np
    >>> from lidar_outlier_filter.core.detectors import crop_box
    >>> from lidar_outlier_filter.core.detectors.builtin import CropBox
    >>> xyz = np.array([[0.2, 0.0, 0.0], [5.0, 0.0, 0.0], [5.0, 0.0, 3.0]])
    >>> (crop_box.detect(xyz, CropBox(min_range=0.5, max_z=2.5)) > 1).tolist()
    [True, False, True]

    """
    low = (parameters.min_x, parameters.min_y, parameters.min_z)
    high = (parameters.max_x, parameters.max_y, parameters.max_z)
    inside = ((xyz >= low) & (xyz <= high)).all(axis=1)
    reach = np.sqrt(np.einsum('ij,ij->i', xyz, xyz))
    removed = (inside == parameters.negative) | (reach < parameters.min_range)
    return np.where(removed, np.inf, reach / parameters.max_range)
