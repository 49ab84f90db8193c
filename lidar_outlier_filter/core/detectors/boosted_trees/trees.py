# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Ensembles of decision trees of depth 3, and the model files that hold them."""

import json
from functools import lru_cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Floats, Reals, Singles
from lidar_outlier_filter.core.detectors.boosted_trees import features
from lidar_outlier_filter.errors import FilterError

VERSION = 1
PATTERN_MODEL = 'pattern_model.json'  # of spinning sensors
FREE_MODEL = 'free_model.json'  # of scanners without rings
PROFILE_MODEL = 'profile_model.json'
SURVEY_MODEL = 'survey_model.json'  # of the nearest neighbours
SWEEP_MODEL = 'sweep_model.json'  # of those in a sweep without rings
MIXED_MODEL = 'mixed_model.json'  # of mixed pixels: one ensemble
# The features of both passes.
FEATURE_NAMES = {
    PATTERN_MODEL: ((*features.WINDOW,), (*features.WINDOW, *features.SECOND_PASS)),
    PROFILE_MODEL: (
        (*features.WINDOW, *features.PROFILE),
        (*features.WINDOW, *features.PROFILE, *features.SECOND_PASS),
    ),
    SURVEY_MODEL: (
        (*features.NEAR, *features.SWEEP),
        (*features.NEAR, *features.SWEEP, *features.FAR),
    ),
}
FEATURE_NAMES[FREE_MODEL] = FEATURE_NAMES[PATTERN_MODEL]
FEATURE_NAMES[SWEEP_MODEL] = FEATURE_NAMES[SURVEY_MODEL]
OF_GHOSTS = (*features.WINDOW, *features.SECOND_PASS, *features.PANE)
QUESTIONS, VALUES = 7, 8  # inner nodes and leaves of a tree of depth 3
MIN_LOG_ODDS = -8.0  # a score of 0
# find_valleys() tries log-odds in steps, and counts the points within NEAR_LOG_ODDS of each. It
# keeps a threshold that fewer points exceed than this share, or this number.
STEP_LOG_ODDS, NEAR_LOG_ODDS = 0.1, 0.5
MIN_HILL_SHARE, MIN_HILL_POINTS = 0.005, 50


class Trees(NamedTuple):
    """An ensemble of T complete trees: vector instructions evaluate them without branches.

    Attributes
    ----------
    feature : (T, 7) int32
        Row of the feature that each inner node compares with its limit: the root, its children from
        left to right, and theirs. A point goes right where its feature is greater.
    limit : (T, 7) float32
    value : (T, 8) float32
        Of the leaves, from left to right.
    start : float32
        The sum without trees.

    """

    feature: NDArray[np.int32]
    limit: Singles
    value: Singles
    start: np.float32


NO_TREES = Trees(
    np.empty((0, QUESTIONS), np.int32),
    np.empty((0, QUESTIONS), np.float32),
    np.empty((0, VALUES), np.float32),
    np.float32(0.0),
)


class TreeModel(NamedTuple):
    """A trained model.

    Attributes
    ----------
    first, again : the trees of both passes; their sums are log-odds
    doubtful : log-odds of the first pass above which the second judges a point
    threshold : log-odds above which a point is rejected
    drop : log-odds by which :func:`find_valleys` may lower the threshold of a block
    mixed : trees on mixed pixels alone, which have the features of the first pass; not all have any
    ghosts : trees on ghosts alone, whose features are ``OF_GHOSTS``; not all have any

    """

    first: Trees
    again: Trees
    doubtful: float
    threshold: float
    drop: float
    mixed: Trees = NO_TREES
    ghosts: Trees = NO_TREES


@lru_cache
def load(name: str = PATTERN_MODEL) -> TreeModel:
    """Read a model of this package.

    Raises
    ------
    FilterError
        If its version or a feature is unknown.

    """
    return parse(read_file(name), name)


def parse(data: dict[str, Any], name: str) -> TreeModel:
    """Read a model of a file's content; ``name`` says the features."""
    names, names_again = FEATURE_NAMES[name]
    return TreeModel(
        read_trees(data['first'], names),
        read_trees(data['again'], names_again),
        float(data['doubtful']),
        float(data['threshold']),
        float(data.get('drop', 0.0)),
        read_trees(data['mixed'], names) if 'mixed' in data else NO_TREES,
        read_trees(data['ghosts'], OF_GHOSTS) if 'ghosts' in data else NO_TREES,
    )


def read_file(name: str) -> dict[str, Any]:
    """Read the file of a model of this package; refuse another version."""
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


def find_valleys(log_odds: Reals, thresholds: Floats, drop: float) -> Floats:
    """Return thresholds (T,), each lowered by up to ``drop`` to the sparsest of the log-odds (N,).

    Outliers make one hill in the histogram of a block's log-odds, good points another; between
    them, the fewest points are uncertain (Prewitt and Mendelsohn 1966,
    https://doi.org/10.1111/j.1749-6632.1965.tb11715.x). A threshold that only a few points exceed
    shows no hill, and stays.
    """
    some = np.sort(log_odds[log_odds >= thresholds.min() - drop - NEAR_LOG_ODDS])
    edges = thresholds[:, None] - np.arange(0.0, drop + STEP_LOG_ODDS / 2, STEP_LOG_ODDS)
    near = np.searchsorted(some, edges + NEAR_LOG_ODDS)
    near -= np.searchsorted(some, edges - NEAR_LOG_ODDS)
    above = len(some) - np.searchsorted(some, thresholds, 'right')
    valley = edges[np.arange(len(edges)), near.argmin(axis=1)]
    hill = max(MIN_HILL_SHARE * len(log_odds), MIN_HILL_POINTS)
    return np.where(above >= hill, valley, thresholds)


def contribute(trees: Trees, values: Singles) -> Singles:
    """Return what each feature adds to the log-odds of W points with these values, both (F, W)."""
    added = np.zeros(values.shape, np.float32)
    _kernels.add_contributions(trees, find_means(trees), np.ascontiguousarray(values), added)
    return added


def find_means(trees: Trees) -> Singles:
    """Return the mean value (T, 15) of the leaves below each node of full trees.

    The inner nodes come first, as in ``Trees``, then the leaves.
    """
    means = np.empty((len(trees.value), QUESTIONS + VALUES), np.float32)
    means[:, QUESTIONS:] = trees.value
    for node in range(QUESTIONS - 1, -1, -1):
        means[:, node] = np.float32(0.5) * (means[:, 2 * node + 1] + means[:, 2 * node + 2])
    return means
