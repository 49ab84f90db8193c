# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The default detector as one of the chain."""

# ruff: noqa: PLC0415  a declaration is read wherever parameters are: kernels come when they are used

from __future__ import annotations

from typing import TYPE_CHECKING

from lidar_outlier_filter.core.detectors.boosted_trees.parameters import (
    BoostedTrees,
    SpinningWeights,
    Weights,
)
from lidar_outlier_filter.core.detectors.declaration import Detector, Kernels, Reaching
from lidar_outlier_filter.core.detectors.dials import Threshold, plain
from lidar_outlier_filter.core.detectors.scores import Scores

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Bools, Floats, Ints
    from lidar_outlier_filter.core.detectors.explanation import Explanation
    from lidar_outlier_filter.core.detectors.seen import Seen
    from lidar_outlier_filter.core.neighbours.floor import Floor
    from lidar_outlier_filter.parameters.filter import FilterParameters


def _detect(seen: Seen, parameters: FilterParameters) -> Scores:
    from lidar_outlier_filter.core.detectors.boosted_trees.ways import detect

    return detect(seen, parameters)


def _neighbours(_parameters: FilterParameters) -> int:
    from lidar_outlier_filter.core.detectors.boosted_trees.weighted_sum.detector import neighbours

    return neighbours()


def _explain() -> Explanation:
    from lidar_outlier_filter.core.detectors.boosted_trees.explain.explanation import EXPLANATION

    return EXPLANATION


def _look_around(xyz: Floats, where: Ints, parameters: FilterParameters) -> Floor:
    from lidar_outlier_filter.core.neighbours.floor import look_around

    return look_around(xyz, where, parameters.threads)


def _odds(
    xyz: Floats, wanted: Bools, around: Floor, parameters: FilterParameters
) -> tuple[Floats, Floats]:
    from lidar_outlier_filter.core.detectors.boosted_trees.survey.judge import measure

    return measure(xyz, around, parameters.threads, wanted)


def _survey_score(odds: Floats, parameters: FilterParameters) -> Scores:
    from lidar_outlier_filter.core.detectors.boosted_trees.survey.judge import score
    from lidar_outlier_filter.core.detectors.boosted_trees.ways import Way

    found = score(odds, parameters.of(BoostedTrees).threshold)
    return Scores(found, scaled=True, way=Way.SURVEY.value)


def _reach() -> tuple[int, int]:
    from lidar_outlier_filter.core.detectors.boosted_trees.survey.far import MOST, STEPS

    return MOST, STEPS


def _threshold(_parameters: FilterParameters) -> Threshold:
    # A part of a sum of logarithms: even steps.
    return plain('boosted_trees.threshold', (round(0.02 * n, 2) for n in range(5, 151)))


# Processor seconds of the kernels of each part, to which `benchmarks/compile.py
# boosted_trees:spinning boosted_trees:profile` gives its shares.
PARTS = (('pattern.profile_groups', 6), ('pattern', 16), ('weighted_sum', 10), ('trees', 1))

# Without dials: its weights are those of a regression.
DETECTOR = Detector(
    name='boosted_trees',
    bit=64,
    section=BoostedTrees,
    further={'boosted_trees_profile': Weights, 'boosted_trees_spinning': SpinningWeights},
    by_default=True,
    detect=_detect,
    threshold=_threshold,
    neighbours=_neighbours,
    uses_lines=True,
    wants_rings=lambda parameters: parameters.of(BoostedTrees).sensor in {'auto', 'spinning'},
    columns={'intensity': ''},
    # Lines are not looked at in tiles.
    tiled=Reaching(_look_around, _odds, _survey_score, _reach),
    kernels=Kernels(
        seconds=sum(seconds for _, seconds in PARTS),
        parts=PARTS,
        # Without scan lines the kernels are the same for all sensors.
        by_sensor=lambda parameters: parameters.of(BoostedTrees).sensor != 'survey',
        more=({'boosted_trees.sensor': 'survey'},),  # for `clean`
    ),
    explain=_explain,
    colour='#000000',
    rejects='is improbable by its features. Spinning sensors, and profile '
    'scanners whose mirror turns evenly: trees on the scan pattern. Others: a weighted sum of '
    'distances, prediction along the line, distance from the local surface and neighbours on other '
    'lines; slanted groups in the air, too',
    source='this project',
)
