# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Train the trees that judge clouds without scan lines on simulated surveys; see :mod:`.folds`."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Ints, Progress, Singles
from lidar_outlier_filter.core.detectors.boosted_trees.neighbour_features import (
    MAX_NEIGHBOURS,
    Far,
    Near,
)
from lidar_outlier_filter.core.detectors.boosted_trees.neighbour_trees import (
    far_values,
    first_odds,
    near_values,
    neighbours,
)
from lidar_outlier_filter.core.detectors.boosted_trees.trees import (
    FEATURE_NAMES,
    SURVEY_MODEL,
    Trees,
)
from lidar_outlier_filter.core.neighbours.floor import Floor, measure_floor
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.core.neighbours.typical import K
from lidar_outlier_filter.evaluation.truth import Cause
from lidar_outlier_lab.simulation.scenes.survey_scenes import SurveyScene, training_scene
from lidar_outlier_lab.training.folds import FOLDS, SceneRecipe

SCENES = 90
RECIPE = SceneRecipe(
    what='scene',
    names=FEATURE_NAMES[SURVEY_MODEL],
    rounds=(80, 220),
    good=(3000, 4000),
    bad=(400, 1000),
    good_counts=5.0,
    limits=np.arange(-20, 121) / 10.0,
    most_lost=1e-4,
    doubtful=-4.5,
    # Single points cannot tell them from edges.
    neither=(Cause.MIXED, Cause.NEAR_SURFACE, Cause.SNOW),
    # Kinds take turns within each fold.
    fold=lambda number: number // 10 % FOLDS if number >= FOLDS else number,
)


@dataclass(frozen=True)
class SceneSeen:
    """A scene as the trees see it, in tree order; ``odds`` are the log-odds of all its points."""

    name: str
    hood: Neighbourhood
    around: Floor
    cause: Ints
    is_sweep: bool = False

    @property
    def kind(self) -> str:
        """Halls, walls, fields and so on."""
        return self.name.split()[0]

    @property
    def total(self) -> int:
        """How many points it has."""
        return len(self.cause)

    def _values(self, which: Ints, odds: Singles | None) -> Singles:
        """Return the features (F, M) of some points in a pass."""
        near = self._near()
        if odds is None:
            return near_values(near, which)
        index = self.hood.nearest_of(which, min(MAX_NEIGHBOURS, len(self.hood) - 1))
        return far_values(Far(near, odds, index), which)

    def _near(self) -> Near:
        return neighbours(self.hood, self.around, sweep=self.is_sweep)

    def table(self, odds: Singles | None) -> tuple[Ints, Callable[[Ints], Singles]]:
        """Return the causes and features of the points that may train a pass."""
        every = np.arange(len(self.cause))
        where = every if odds is None else np.flatnonzero(odds > RECIPE.doubtful)
        return self.cause[where], lambda rows: self._values(where[rows], odds)

    def judge(self, trees: Trees, odds: Singles | None) -> Singles:
        """Return the log-odds of each point; the second pass judges only doubtful points anew."""
        if odds is None:
            return first_odds(self._near(), trees)
        which, result = np.flatnonzero(odds > RECIPE.doubtful), odds.copy()
        total = np.empty(len(which), np.float32)
        _kernels.add_trees(trees, self._values(which, odds), total)
        result[which] = total
        return result

    def own(self, odds: Singles) -> Singles:
        """Return the log-odds of all points."""
        return odds


def see(scene: SurveyScene) -> SceneSeen:
    """Find the neighbours of a scene's points."""
    hood = Neighbourhood(scene.xyz, K)
    around = measure_floor(scene.xyz, np.arange(len(scene.xyz)))
    return SceneSeen(scene.name, hood, around, scene.cause[hood.order].astype(np.int64))


def make_scenes(progress: Progress = lambda _done, _total, _what: None) -> list[SceneSeen]:
    """Simulate so many scenes."""
    found = []
    for seed in range(SCENES):
        progress(seed, SCENES, f'scene {seed + 1} of {SCENES}')
        found.append(see(training_scene(seed)))
    return found
