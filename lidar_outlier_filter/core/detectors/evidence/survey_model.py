# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The trained model of :mod:`.survey`: a file beside this one, which says what it saw."""

from __future__ import annotations

import json
from functools import lru_cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any, NamedTuple

from lidar_outlier_filter.core.detectors.evidence.pattern_model import read_trees
from lidar_outlier_filter.core.detectors.evidence.survey_far import NAMES
from lidar_outlier_filter.core.detectors.evidence.survey_near import NEAR
from lidar_outlier_filter.errors import FilterError

if TYPE_CHECKING:
    from lidar_outlier_filter.core.detectors.evidence.trees import Trees

VERSION = 1
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
    text = (files(__package__) / SURVEY_MODEL).read_text(encoding='utf-8')
    data: dict[str, Any] = json.loads(text)
    if data['version'] != VERSION:
        raise FilterError(f'the version of {SURVEY_MODEL}', f'{VERSION}', data['version'])
    return SurveyModel(
        read_trees(data['first'], NEAR),
        read_trees(data['again'], NAMES),
        float(data['doubtful']),
        float(data['threshold']),
    )
