# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Training the trees for clouds without scan lines."""

import json

import numpy as np
import pytest

from lidar_outlier_filter.core.detectors.boosted_trees.trees import NAMES, SURVEY_MODEL
from lidar_outlier_lab.simulation.scenes.survey_errors import add_errors
from lidar_outlier_lab.simulation.scenes.survey_scenes import KINDS, SurveyScene, training_scene
from lidar_outlier_lab.training.folds import train_in_folds
from lidar_outlier_lab.training.train_survey import RECIPE, SCENES, see

WALLS = (3, 9, 13, 19)  # seeds of small scenes
pytestmark = pytest.mark.usefixtures('few_edges')


@pytest.fixture(scope='module')
def walls() -> list[SurveyScene]:
    """Simulate some small scenes."""
    return [training_scene(seed) for seed in WALLS]


def test_scenes_differ_and_repeat(walls: list[SurveyScene]) -> None:
    """A seed gives the same points each time, another seed others."""
    again = training_scene(WALLS[1])
    np.testing.assert_array_equal(again.xyz, walls[1].xyz)
    np.testing.assert_array_equal(again.cause, walls[1].cause)
    assert len({len(scene.xyz) for scene in walls}) == len(walls)
    assert all(scene.name.startswith('walls') for scene in walls)
    assert any(scene.cause.any() for scene in walls)
    assert SCENES % len(KINDS) == 0


def test_errors_come_behind_the_points() -> None:
    """A few of them, and each with a cause."""
    rng = np.random.default_rng(1)
    good = rng.uniform((0.0, 0.0, 0.0), (20.0, 20.0, 0.01), (3000, 3))
    xyz, cause = add_errors(good, 0.02, rng)
    np.testing.assert_array_equal(xyz[:3000], good)
    assert not cause[:3000].any()
    assert cause[3000:].all()
    assert 0 < len(xyz) - 3000 < 150


def test_file_is_complete_and_repeats(walls: list[SurveyScene]) -> None:
    """The same scenes give the same bytes, which say what they saw."""
    scenes, few = [see(one) for one in walls], RECIPE._replace(rounds=(4, 4))
    first, second = (train_in_folds(scenes, few, {'about': 'a test'}) for _ in range(2))
    assert first.text == second.text
    data = json.loads(first.text)
    assert data['uses'] == list(NAMES[SURVEY_MODEL][1])
    assert data['scenes'] == [scene.name for scene in walls]
    assert len(data['first']['features']) == len(data['again']['features']) == 4
    assert set(data['held_out']['kinds']) == {'walls'}
