# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Train the trees that judge sweeps without rings by the neighbours of points; see :mod:`.folds`.

The sweeps are those of :mod:`.scenes`, moved and tilted as in the frame of a vehicle. Sensors are
in three folds, each of which is left out once.
"""

import re
import zlib
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.evaluation.truth import Cause
from lidar_outlier_lab.simulation.scenes.survey_scenes import SurveyScene
from lidar_outlier_lab.training.folds import FOLDS, SceneRecipe
from lidar_outlier_lab.training.held_out import CLEAN, NO_WEATHER
from lidar_outlier_lab.training.train import Sweep
from lidar_outlier_lab.training.train_survey import RECIPE, SceneSeen, see

ASIDE_M, UP_M = 2.0, (0.0, 3.0)  # metres that the frame of a vehicle is off its sensor, at most
TILT_RAD = 0.05  # standard deviation, each way


def choose(sweeps: Sequence[Sweep]) -> list[Sweep]:
    """Take all clean sweeps, and one of each sensor and weather.

    Neighbours do not tell mixed pixels from edges, nor mirrored surfaces from others.
    """
    known, chosen = set(), []
    for sweep in sweeps:
        name = sweep.sensor, sweep.kind
        if sweep.kind == CLEAN or not (sweep.kind in NO_WEATHER or name in known):
            chosen.append(sweep)
        known.add(name)
    return chosen


def moved(xyz: Floats, name: str) -> Floats:
    """Move points (N, 3) of a sensor into the frame of a vehicle, drawn by a name."""
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    turned = Rotation.from_euler('xy', rng.normal(0.0, TILT_RAD, 2)).apply(xyz)
    away: Floats = turned + np.append(rng.uniform(-ASIDE_M, ASIDE_M, 2), rng.uniform(*UP_M))
    return away


def scene_of(sweep: Sweep) -> SceneSeen:
    """Find the neighbours of a sweep's points."""
    xyz, outlier = sweep.points.xyz[sweep.points.valid], sweep.outlier[sweep.points.valid]
    weather = re.split('[ _]', sweep.kind)[-1].upper()
    own = Cause[weather] if weather in Cause.__members__ else Cause.GOOD
    cause = np.where(outlier, own, Cause.GOOD)
    name = f'{sweep.kind.replace(" ", "_")} {sweep.name}'
    return replace(see(SurveyScene(name, moved(xyz, name), cause.astype(np.uint8))), is_sweep=True)


def recipe_for(sweeps: Sequence[Sweep]) -> SceneRecipe:
    """Return the recipe, whose folds are of sensors."""
    sensors = [*dict.fromkeys(sweep.sensor for sweep in sweeps)]
    folds = [sensors.index(sweep.sensor) % FOLDS for sweep in sweeps]
    return RECIPE._replace(
        what='sweep', neither=(), most_lost=5e-4, drop=1.5, fold=lambda number: folds[number]
    )
