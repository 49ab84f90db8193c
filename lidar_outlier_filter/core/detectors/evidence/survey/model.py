# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The trained model of :mod:`.survey`: a file beside this one, which says what it saw."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

from lidar_outlier_filter.core.detectors.evidence.models import read_file, read_trees
from lidar_outlier_filter.core.detectors.evidence.survey.far import NAMES
from lidar_outlier_filter.core.detectors.evidence.survey.near import NEAR

if TYPE_CHECKING:
    from lidar_outlier_filter.core.detectors.evidence.trees import Trees

SURVEY_MODEL = 'survey_model.json'


class SurveyModel(NamedTuple):
    """What was trained.

    Attributes
    ----------
    first, again : the trees of both passes; their sums are log-odds
    doubtful : log-odds of the first pass from which on the second judges a point
    threshold : log-odds from which on a point is rejected

    """

    first: Trees
    again: Trees
    doubtful: float
    threshold: float


@lru_cache
def load() -> SurveyModel:
    """Read the model of this package.

    Raises
    ------
    FilterError
        If it is of another version, or asks for features that there are not.

    """
    data = read_file(SURVEY_MODEL)
    return SurveyModel(
        read_trees(data['first'], NEAR),
        read_trees(data['again'], NAMES),
        float(data['doubtful']),
        float(data['threshold']),
    )
