# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The table of what can be tuned: complete, consistent, and true of the detectors themselves."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from helpers.scans import road
from numpy.typing import NDArray

from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.filter import FilterParameters, describe
from lidar_outlier_filter.tuning.search import levels
from lidar_outlier_filter.tuning.search_space import searches

PARAMETERS = {item.name: item for item in describe()}
SMOOTHER = FilterParameters().changed({'chain': ['alpha_beta_gamma']})
FORMS: list[dict[str, object]] = [
    {'chain': ['alpha_beta_gamma'], 'alpha_beta_gamma.passes': 1},
    {
        'chain': ['alpha_beta_gamma'],
        'alpha_beta_gamma.passes': 1,
        'alpha_beta_gamma.sigma': 0.01,
    },
    {'chain': ['lof']},
    {'chain': ['lof'], 'lof.statistic': 'lof2'},
    {'chain': ['sor'], 'sor.range_scaled': True},
    {'chain': ['sor'], 'sor.statistic': 'sor2', 'sor.range_scaled': True},
    {'chain': ['sor'], 'sor.statistic': 'radius'},
    {'chain': ['boosted_trees'], 'boosted_trees.sensor': 'spinning'},
]


def street() -> Points:
    """Measure a few scan lines of a road with points above it, 10 m from the sensor."""
    points, _ = road(5, 10, 300, 0.03)
    return replace(points, xyz=points.xyz + np.array([10.0, 0.0, 0.0]))


def test_every_detector_can_be_tuned() -> None:
    """Whatever a chain can hold, the tuner can tune; it sets parameters of the detector."""
    assert tuple(DETECTORS) == PARAMETERS['chain'].choices
    for form in [{'chain': [name]} for name in DETECTORS] + FORMS:
        parameters = FilterParameters().changed(form)
        (search,) = searches(parameters)
        names = {search.threshold.name, *(name for one in search.settings for name in one)}
        assert all(name.startswith(f'{search.detector}.') for name in names)
        assert not any(PARAMETERS[name].fixed for name in names)
        assert (np.diff(search.threshold.criticals()) > 0).all()  # the strictest first
        assert search.threshold.name not in {name for one in search.settings for name in one}


@pytest.mark.parametrize('form', FORMS, ids=str)
def test_one_run_gives_what_every_threshold_rejects(form: Mapping[str, object]) -> None:
    """Legal values, the strictest first; the sweep rejects what the detector rejects at them."""
    points = street()
    parameters = FilterParameters().changed(form)
    (search,) = searches(parameters)
    threshold = search.threshold
    assert (np.diff(threshold.criticals()) > 0).all()
    assert len(threshold.values) < 2**16
    for setting in search.settings:
        parameters.changed(setting)

    def score_of(changes: Mapping[str, object]) -> NDArray[np.float32]:
        return Chain(parameters.changed(changes)).judge(points).score

    default = PARAMETERS[threshold.name].default
    level = levels(threshold, threshold.statistic(score_of, default))
    seen = set()
    for number in range(0, len(threshold.values), 10):
        changed = parameters.changed({threshold.name: threshold.values[number]})
        rejected = Chain(changed).judge(points).rejected
        # Scores are rounded to float32: a point at its limit may fall on either side.
        assert np.count_nonzero(rejected != (level > number)) <= 1
        seen.add(int(np.count_nonzero(rejected)))
    assert len(seen) > 3


@pytest.mark.parametrize('name', DETECTORS)
def test_a_sweep_is_exact_where_it_was_run(name: str) -> None:
    """Also of a detector with a second pass: at the value it ran with."""
    points = street()
    parameters = FilterParameters().changed({'chain': [name]})
    (search,) = searches(parameters)
    threshold = search.threshold
    value = threshold.values[len(threshold.values) // 2]
    parameters = parameters.changed({threshold.name: value})

    def score_of(changes: Mapping[str, object]) -> NDArray[np.float32]:
        return Chain(parameters.changed(changes)).judge(points).score

    level = levels(threshold, threshold.statistic(score_of, value))
    rejected = Chain(parameters).judge(points).rejected
    assert np.count_nonzero(rejected != (level > threshold.values.index(value))) <= 1


def test_settings_are_all_that_are_possible() -> None:
    """Windows that are too short for their order are left out, the others are complete."""
    (search,) = searches(SMOOTHER)
    found = {tuple(setting.values()) for setting in search.settings}
    assert len(found) == 6 * 2 * 2 - 1
    assert (3, 3, 1, 'either') in found
    assert (3, 3, 2, 'either') not in found
    assert (3, 3, 2, 'both') in found


def test_given_values_replace_the_usual_ones() -> None:
    """Values for a searched parameter, for a threshold, and for one that is not searched."""
    parameters = FilterParameters().changed({'chain': ['lof']})
    requested: dict[str, list[object]] = {'lof.min_pts': [4, 9], 'lof.threshold': [3.0, 1.5, 2]}
    (search,) = searches(parameters, requested)
    assert search.settings == ({'lof.min_pts': 4}, {'lof.min_pts': 9})
    assert search.threshold.values == (1.5, 2.0, 3.0)
    requested = {'alpha_beta_gamma.sigma_floor': [0.01, 0.02], 'alpha_beta_gamma.before': [6]}
    (search,) = searches(SMOOTHER, requested)
    assert {setting['alpha_beta_gamma.sigma_floor'] for setting in search.settings} == {0.01, 0.02}
    # The window's parameters are gone as a whole: `after` stays as it is.
    assert {setting['alpha_beta_gamma.before'] for setting in search.settings} == {6}
    assert not any('alpha_beta_gamma.after' in setting for setting in search.settings)


def test_kept_parameters_stay() -> None:
    """A parameter, and a threshold, may be left unchanged."""
    parameters = FilterParameters().changed({'chain': ['lof'], 'lof.threshold': 1.7})
    (search,) = searches(parameters, kept=['lof.min_pts', 'lof.threshold'])
    assert search.settings == ({'lof.min_pts': 20},)
    assert search.threshold.values == (1.7,)


@pytest.mark.parametrize(
    ('requested', 'kept', 'sentence'),
    [
        ({'lof.k': [1]}, (), "must be those of alpha_beta_gamma, got 'lof.k'"),
        ({'sigma_field': ['a']}, (), "must be those of alpha_beta_gamma, got 'sigma_field'"),
        (
            {'alpha_beta_gamma.order': [2]},
            ['alpha_beta_gamma.order'],
            'alpha_beta_gamma.order must be searched or kept, got both',
        ),
        ({}, ['chain'], "must be those of alpha_beta_gamma, got 'chain'"),
        ({'alpha_beta_gamma.order': ['x']}, (), "order must be a whole number, got 'x'"),
        ({'alpha_beta_gamma.significance': [2.0]}, (), 'significance must be from 1e-15 to 0.5'),
        (
            {'alpha_beta_gamma.before': [0], 'alpha_beta_gamma.after': [0]},
            (),
            'alpha_beta_gamma must be possible together',
        ),
    ],
)
def test_refused_searches(
    requested: dict[str, list[object]], kept: list[str], sentence: str
) -> None:
    """Parameters of other detectors, and values that cannot be."""
    with pytest.raises(ParameterError) as caught:
        searches(SMOOTHER, requested, kept)
    assert sentence in str(caught.value)
