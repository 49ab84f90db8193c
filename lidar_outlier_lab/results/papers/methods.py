# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The methods of the papers exactly as published: ``config/papers/NAME.yaml`` has the same of each.

What a paper leaves open is chosen here, and its page under ``doc/papers`` says so.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from time import perf_counter
from types import MappingProxyType

import numpy as np

from lidar_outlier_filter.core.annotations import Bools
from lidar_outlier_filter.evaluation.confusion import Confusion, confusion
from lidar_outlier_filter.evaluation.truth import Kind
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_lab.results.samples import Sample

# The smoother as in Leslar, Wang and Hu (2010): each point is tested once, in a window around it.
SMOOTHER: Mapping[str, object] = MappingProxyType(
    {
        'chain': ['alpha_beta_gamma'],
        'alpha_beta_gamma.sides': 'both',
        'alpha_beta_gamma.order': 2,
        'alpha_beta_gamma.before': 5,
        'alpha_beta_gamma.after': 5,
        'alpha_beta_gamma.significance': 0.001,
        'alpha_beta_gamma.passes': 1,
    }
)
A_PRIORI = 0.2  # metres: with it (a) finds about as much of cloud A as in the paper

# `config/classic.yaml`: the papers' three in sequence, with our defaults.
CLASSIC: Mapping[str, object] = MappingProxyType({'chain': ['alpha_beta_gamma', 'quadric', 'lof']})
# `config/classic_vegetation.yaml`: thresholds chosen on streets that no table shows.
VEGETATION: Mapping[str, object] = MappingProxyType(
    {**CLASSIC, 'alpha_beta_gamma.sigma_floor': 1.5, 'lof.min_pts': 30, 'lof.threshold': 2.5}
)
_SMOOTHER: Mapping[str, object] = {**SMOOTHER, 'alpha_beta_gamma.sigma': A_PRIORI}
_SURFACE: Mapping[str, object] = {
    'quadric.model': 'always',
    'quadric.significance': 0.001,
    # The paper knows none.
    'quadric.sigma_floor': 1e-6,
}

METHODS: Mapping[str, Mapping[str, object]] = MappingProxyType(
    {
        'leslar2010_a': _SMOOTHER,
        'leslar2010_b': {'chain': ['quadric'], 'quadric.window': 'patch', **_SURFACE},
        'leslar2010_c': {'chain': ['quadric'], 'quadric.window': 'section', **_SURFACE},
        'leslar2010_ab': {
            **_SMOOTHER,
            'quadric.window': 'patch',
            **_SURFACE,
            'chain': ['alpha_beta_gamma', 'quadric'],
        },
        'sotoodeh2006': {'chain': ['lof'], 'lof.min_pts': 20, 'lof.threshold': 1.2},
        'sotoodeh2007': {
            'chain': ['hierarchical'],
            'hierarchical.global_confidence': 0.99,
            'hierarchical.local_confidence': 0.95,
            'hierarchical.min_cluster': 100,
        },
        'pirotti2018_sor2': {
            'chain': ['sor'],
            'sor.statistic': 'sor2',
            'sor.k': 60,
            'sor.limit': 0.25,
        },
        'pirotti2018_lof': {'chain': ['lof'], 'lof.min_pts': 10, 'lof.threshold': 1.1},
        'kang2018': {
            'chain': ['elevation'],
            'elevation.gap': 5.0,
            'elevation.k': 30,
            'elevation.multiplier': 3.0,
            'elevation.sides': 'low',
        },
    }
)


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
