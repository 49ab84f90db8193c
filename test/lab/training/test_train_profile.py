# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Training the trees for profile scanners: what is written is what was learnt."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from lidar_outlier_filter.core.detectors.boosted_trees.features import PROFILE, SECOND_PASS, WINDOW
from lidar_outlier_filter.core.detectors.boosted_trees.trees import NAMES, PROFILE_MODEL
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_lab.simulation.scenes.profile_streets import training_street
from lidar_outlier_lab.training.folds import train_in_folds
from lidar_outlier_lab.training.train_profile import RECIPE, Street, measured

FEW = RECIPE._replace(rounds=(3, 4))  # trees
pytestmark = pytest.mark.usefixtures('few_edges')


@cache
def streets() -> tuple[Street, ...]:
    """Return short pieces of a few streets."""
    drives = [training_street(seed) for seed in range(3)]
    return tuple(
        measured(f'street {seed}', replace(drive, lines=8)) for seed, drive in enumerate(drives)
    )


def test_streets_differ_and_repeat() -> None:
    """No two seeds have the same scanner and way; one seed is always the same drive."""
    some = [training_street(seed) for seed in range(6)]
    assert len({(drive.sensor.noise, drive.trajectory) for drive in some}) == len(some)
    one, again = streets()[0], measured('again', replace(training_street(0), lines=8))
    assert_array_equal(one.points.xyz, again.points.xyz)
    assert_array_equal(one.code, again.code)
    assert (np.diff(one.points.t) > 0).all()


@pytest.mark.slow
def test_file_is_complete_and_repeats() -> None:
    """The same seed gives the same bytes; the file says what it is."""
    about = {'about': 'a test', 'trained_on': {'streets': 3}}
    text = train_in_folds(streets(), FEW, about, 1).text
    assert train_in_folds(streets(), FEW, about, 1).text == text
    data = json.loads(text)
    assert data.items() >= about.items()
    assert (data['seed'], data['streets']) == (1, [f'street {n}' for n in range(3)])
    assert data['uses'] == [*[*WINDOW][: [*WINDOW].index('bright')], *PROFILE, *SECOND_PASS]
    assert [len(data[key]['values']) for key in ('first', 'again')] == [3, 4]
    asked = {name for tree in data['first']['features'] for name in tree}
    assert asked <= {*NAMES[PROFILE_MODEL][0]}
    assert data['held_out']['lost_of_median_kind'] <= 2.5e-5 or data['threshold'] == 6.0
    assert data['held_out']['recall']


def test_what_cannot_be_trained_on() -> None:
    """Few streets, and streets without outliers, are refused."""
    with pytest.raises(FilterError, match='at least 3, got 2'):
        train_in_folds(streets()[:2], RECIPE, {})
    with pytest.raises(FilterError, match='outliers'):
        train_in_folds([replace(one, code=one.code * 0) for one in streets()], RECIPE, {})
