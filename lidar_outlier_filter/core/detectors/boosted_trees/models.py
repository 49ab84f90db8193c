# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The trained models: files beside this one, which say what they saw."""

from __future__ import annotations

import json
from functools import lru_cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np

from lidar_outlier_filter.core.detectors.boosted_trees.pattern.features import FEATURES
from lidar_outlier_filter.core.detectors.boosted_trees.pattern.profile_features import PROFILE
from lidar_outlier_filter.core.detectors.boosted_trees.pattern.scores import AGAIN
from lidar_outlier_filter.core.detectors.boosted_trees.survey import far as survey_far
from lidar_outlier_filter.core.detectors.boosted_trees.survey import near as survey_near
from lidar_outlier_filter.core.detectors.boosted_trees.trees import QUESTIONS, VALUES, Trees
from lidar_outlier_filter.errors import FilterError

VERSION = 1
PATTERN_MODEL = 'pattern_model.json'  # of spinning sensors
PROFILE_MODEL = 'profile_model.json'
SURVEY_MODEL = 'survey_model.json'
# The features of both passes.
NAMES = {
    PATTERN_MODEL: (FEATURES, (*FEATURES, *AGAIN)),
    PROFILE_MODEL: ((*FEATURES, *PROFILE), (*FEATURES, *PROFILE, *AGAIN)),
    SURVEY_MODEL: (survey_near.NEAR, survey_far.NAMES),
}


class TreeModel(NamedTuple):
    """What was trained.

    Attributes
    ----------
    first, again : the trees of both passes; their sums are log-odds
    doubtful : log-odds of the first pass from which on the second judges a point
    threshold : log-odds from which on a point is rejected
    threshold_bright : the same of points whose intensity is known

    """

    first: Trees
    again: Trees
    doubtful: float
    threshold: float
    threshold_bright: float


@lru_cache
def load(name: str = PATTERN_MODEL) -> TreeModel:
    """Read a model of this package.

    Raises
    ------
    FilterError
        If it is of another version, or asks for features that there are not.

    """
    data, (names, names_again) = read_file(name), NAMES[name]
    return TreeModel(
        read_trees(data['first'], names),
        read_trees(data['again'], names_again),
        float(data['doubtful']),
        float(data['threshold']),
        float(data.get('threshold_bright', data['threshold'])),
    )


def read_file(name: str) -> dict[str, Any]:
    """Read the file of a model of this package; refuse one of another version."""
    text = (files(__package__) / name).read_text(encoding='utf-8')
    data: dict[str, Any] = json.loads(text)
    if data['version'] != VERSION:
        raise FilterError(f'the version of {name}', f'{VERSION}', data['version'])
    return data


def read_trees(data: dict[str, Any], names: tuple[str, ...]) -> Trees:
    """Read an ensemble whose questions name these features."""
    known = {name: number for number, name in enumerate(names)}
    unknown = sorted({name for tree in data['features'] for name in tree} - set(known))
    if unknown:
        raise FilterError('the features of a model', 'known ones', ', '.join(unknown))
    feature = np.array([[known[name] for name in tree] for tree in data['features']], np.int32)
    limit = np.array(data['limits'], np.float32)
    value = np.array(data['values'], np.float32)
    shapes = feature.shape, limit.shape, value.shape
    count = len(feature)
    if shapes != ((count, QUESTIONS), (count, QUESTIONS), (count, VALUES)):
        raise FilterError('the trees of a model', f'{QUESTIONS} questions, {VALUES} values', shapes)
    return Trees(feature, limit, value, np.float32(data['start']))
