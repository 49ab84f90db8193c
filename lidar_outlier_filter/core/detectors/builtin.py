# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The detectors of this package."""

from __future__ import annotations

from lidar_outlier_filter.core.detectors.alpha_beta_gamma.parameters import AlphaBetaGamma
from lidar_outlier_filter.core.detectors.boosted_trees.parameters import BoostedTrees
from lidar_outlier_filter.core.detectors.declaration import Detector
from lidar_outlier_filter.core.detectors.elevation.parameters import Elevation
from lidar_outlier_filter.core.detectors.hierarchical.parameters import Hierarchical
from lidar_outlier_filter.core.detectors.lof.parameters import Lof
from lidar_outlier_filter.core.detectors.quadric.parameters import Quadric
from lidar_outlier_filter.core.detectors.sor.parameters import Sor

DEFAULT = 'boosted_trees'  # the chain
# Detectors that explain their scores, each by an Explanation.
EXPLANATIONS = {
    'boosted_trees': f'{__package__}.boosted_trees.explanation:EXPLANATION',
}
_EVERY = (
    Detector(
        name='alpha_beta_gamma',
        bit=1,
        section=AlphaBetaGamma,
        score=f'{__package__}.alpha_beta_gamma.detector:score',
        lines='needs',
        large='files',
        rejects='is improbable after the points before and behind it in its line segment',
    ),
    Detector(
        name='quadric',
        bit=2,
        section=Quadric,
        score=f'{__package__}.quadric.detector:score',
        neighbours=lambda parameters: parameters.of(Quadric).list_length,
        large='tiles',
        rejects='lies on none of the planes, paraboloids or quadrics through its neighbourhood: '
        '`window: section` tests all points of a section at once, `patch` each in its own patch',
    ),
    Detector(
        name='lof',
        bit=4,
        section=Lof,
        score=f'{__package__}.lof.detector:score',
        neighbours=lambda parameters: parameters.of(Lof).min_pts,
        large='files',
        rejects='lies in a place much less dense than its neighbours do (local outlier factor, or '
        'LOF2)',
    ),
    Detector(
        name='sor',
        bit=8,
        section=Sor,
        score=f'{__package__}.sor.detector:score',
        neighbours=lambda parameters: parameters.of(Sor).list_length,
        large='files',
        rejects='is too far from its nearest neighbours: statistical (`sor`, `sor2`), or by '
        '`radius`; both may grow with the range (DSOR, DROR)',
    ),
    Detector(
        name='hierarchical',
        bit=16,
        section=Hierarchical,
        score=f'{__package__}.hierarchical.detector:score',
        rejects='belongs to a cluster of fewer than `min_cluster` points: of the minimum spanning '
        'tree, then (bit 32768 beside it) of the Gabriel graphs, without their long edges; '
        '`min_cluster` ÷ score is the size of the cluster',
    ),
    Detector(
        name='elevation',
        bit=32,
        section=Elevation,
        score=f'{__package__}.elevation.detector:score',
        rejects='is set apart in elevation, or differs by more than 3 σ from its neighbours on the '
        'map, or is too far above or below the ground (airborne clouds, z up)',
    ),
    Detector(
        name='boosted_trees',
        bit=64,
        section=BoostedTrees,
        score=f'{__package__}.boosted_trees.methods:detect',
        lines='uses',
        columns=lambda parameters: parameters.of(BoostedTrees).columns,
        large='files',
        rejects='is an outlier by gradient-boosted trees: on the returns beside it in the scan '
        'pattern (spinning sensors, and profile scanners with an evenly turning mirror), or else '
        'on its nearest neighbours',
    ),
)
BUILTIN = {one.name: one for one in _EVERY}
