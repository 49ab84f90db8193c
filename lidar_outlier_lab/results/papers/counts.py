# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What one set of parameters says of one sample, counted as the papers count."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.evaluation.confusion import Confusion, confusion
from lidar_outlier_filter.messages.truth import Kind
from lidar_outlier_filter.parameters.filter import FilterParameters

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lidar_outlier_filter.core.annotations import Bools
    from lidar_outlier_lab.results.samples import Sample


NONE_OF_ITS_PRESETS = 'None of its presets were in this run.'


@dataclass(frozen=True)
class Counted:
    """One set of parameters on one sample.

    Attributes
    ----------
    whole : of all points
    road : share of the good points of the road that were rejected; NaN without a road
    seconds : that it took, once
    rejected : (N,) bool

    """

    whole: Confusion
    road: float
    seconds: float
    rejected: Bools


def count(sample: Sample, values: Mapping[str, object]) -> Counted:
    """Judge a sample with the defaults, some of them changed."""
    parameters = FilterParameters().changed(values)
    begin = perf_counter()
    rejected = sample.data.judge(parameters).rejected
    seconds = perf_counter() - begin
    return Counted(
        confusion(sample.data.bad, rejected), _lost_road(sample, rejected), seconds, rejected
    )


def _lost_road(sample: Sample, rejected: Bools) -> float:
    if sample.surface is None:
        return float('nan')
    road = (sample.surface == Kind.ROAD) & sample.data.good
    return float(np.mean(rejected[road])) if road.any() else float('nan')
