# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Train two ensembles of trees on simulated scenes, and write their file.

The second ensemble sees the results of the first. Scenes are in three folds, each of which is left
out once (cross-validation): what the second ensemble sees of a scene is what a first one says that
never saw it. The threshold and the figures of the file are of ensembles, too, that never saw it.

Two leaks remain, which can make the figures better than on new scenes: the second ensemble learns
from first results of the other folds, whose ensembles did see the scene; and the threshold is
chosen on the scenes that the figures are of.
"""

import json
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats, Ints, Progress, Singles
from lidar_outlier_filter.core.detectors.boosted_trees.trees import (
    VERSION,
    Trees,
    find_valleys,
    read_trees,
)
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation.truth import Cause
from lidar_outlier_lab.training.learner import Drawn, Trained, draw_rows, learn

FOLDS = 3
DIGITS = 6


class TrainingScene(Protocol):
    """A scene to train on. What a pass gives its points has a form of its own, ``odds``."""

    @property
    def name(self) -> str:
        """What the file calls it."""
        ...

    @property
    def kind(self) -> str:
        """Scenes of a kind count together."""
        ...

    @property
    def total(self) -> int:
        """How many points it has."""
        ...

    @property
    def cause(self) -> Ints:
        """Causes (N,) of the points that are judged; 0: good."""
        ...

    def table(self, odds: Any) -> tuple[Ints, Callable[[Ints], Singles]]:
        """Return the causes (P,) of points that may train a pass, and the features of some.

        Codes below 0 are of good points of a kind that counts more than its share.
        """
        ...

    def judge(self, trees: Trees, odds: Any) -> Any:
        """Return what a pass gives, after the first one's odds; None: this is the first."""
        ...

    def own(self, odds: Any) -> Singles:
        """Return the log-odds (N,) of the points that are judged."""
        ...


class SceneRecipe(NamedTuple):
    """How ensembles are trained; pairs are for both passes.

    Attributes
    ----------
    what : one scene, as text
    names : of the features
    rounds : trees of an ensemble
    good, bad : points of a scene that are drawn, and of each cause
    good_counts : how much good points count
    rare_counts : how much those of a kind count whose code is below 0
    bad_counts : how much outliers of a cause count; 1 for others
    neither : causes that train neither as good nor as bad, and are not counted
    limits : log-odds tried as thresholds
    most_lost : share of the good points that may be lost, of the median kind of scene
    doubtful : first log-odds above which the second ensemble judges a point
    fold : the fold of a scene by its number
    drop : log-odds by which a scene's valley may lower the threshold

    """

    what: str
    names: tuple[tuple[str, ...], tuple[str, ...]]
    rounds: tuple[int, int]
    good: tuple[int, int]
    bad: tuple[int, int]
    good_counts: float
    limits: Floats
    most_lost: float
    doubtful: float
    bad_counts: Mapping[Cause, float] = {}
    rare_counts: float = 0.0
    neither: Collection[Cause] = ()
    fold: Callable[[int], int] = lambda number: number % FOLDS
    drop: float = 0.0


def train_in_folds(
    scenes: Sequence[TrainingScene],
    recipe: SceneRecipe,
    about: Mapping[str, Any],
    seed: int = 1,
    progress: Progress = lambda _done, _total, _what: None,
) -> Trained:
    """Train both ensembles, on at least as many scenes as folds.

    The same arguments give the same result. ``about`` describes the training, for the file;
    ``progress`` is as in :func:`.train.train`.

    Raises
    ------
    FilterError
        If there are too few scenes, or no point is an outlier.

    """
    title = f'the training {recipe.what}s'
    if len(scenes) < FOLDS:
        raise FilterError(title, f'at least {FOLDS}', len(scenes))
    if not any(scene.cause.any() for scene in scenes):
        raise FilterError(title, 'ones with outliers', 'none')
    first, odds = _pass(scenes, None, recipe, seed, progress)
    again, results = _pass(scenes, odds, recipe, seed, progress)
    found = [scene.own(one) for scene, one in zip(scenes, results, strict=True)]
    threshold = _choose_threshold(scenes, found, recipe)
    doubtful = [scene.own(one) > recipe.doubtful for scene, one in zip(scenes, odds, strict=True)]
    at = np.array([threshold])
    rejected = [one > find_valleys(one, at, recipe.drop) for one in found]
    held_out = _figures(scenes, rejected, np.concatenate(doubtful), recipe)
    data = {
        'version': VERSION,
        **about,
        'seed': seed,
        'uses': recipe.names[1],
        f'{recipe.what}s': [scene.name for scene in scenes],
        'held_out': held_out,
        'doubtful': recipe.doubtful,
        'threshold': threshold,
        **({'drop': recipe.drop} if recipe.drop else {}),
        'first': first,
        'again': again,
    }
    return Trained(json.dumps(data, separators=(',', ':')), threshold, held_out)


def _pass(
    scenes: Sequence[TrainingScene],
    odds: Sequence[Any] | None,
    recipe: SceneRecipe,
    seed: int,
    progress: Progress,
) -> tuple[dict[str, Any], list[Any]]:
    """Train one ensemble on all scenes; return what others, trained without it, give each, too."""
    again = odds is not None
    names, rounds = recipe.names[again], recipe.rounds[again]
    steps, done = 2 * (FOLDS + 2), again * (FOLDS + 2)
    progress(done, steps, 'features')
    before = [None] * len(scenes) if odds is None else odds
    drawn = [
        _draw(scene, recipe, again, np.random.default_rng([seed, number, again]), before[number])
        for number, scene in enumerate(scenes)
    ]
    folds = [recipe.fold(number) for number in range(len(scenes))]
    results: list[Any] = [None] * len(scenes)
    for k in range(FOLDS):
        progress(done + 1 + k, steps, f'without fold {k + 1} of {FOLDS}')
        some = [one for one, fold in zip(drawn, folds, strict=True) if fold != k]
        trees = read_trees(learn(some, names, rounds), names)
        for number in (number for number, fold in enumerate(folds) if fold == k):
            results[number] = scenes[number].judge(trees, before[number])
    progress(done + 1 + FOLDS, steps, f'with every {recipe.what}')
    return learn(drawn, names, rounds), results


def _draw(
    scene: TrainingScene,
    recipe: SceneRecipe,
    again: bool,  # noqa: FBT001  the index of a pass
    rng: np.random.Generator,
    odds: Any,
) -> Drawn:
    """Draw points of each cause; rare causes count more than their share."""
    code, features = scene.table(odds)
    groups = []
    for cause in np.setdiff1d(code, list(recipe.neither)).tolist():
        every = np.flatnonzero(code == cause)
        most = recipe.good[again] if cause == Cause.GOOD else recipe.bad[again]
        share = len(every) / scene.total
        counts = recipe.good_counts * share
        if cause > 0:
            counts = recipe.bad_counts.get(Cause(cause), 1.0) * np.sqrt(share)
        elif cause < 0:
            counts = max(counts, recipe.rare_counts * np.sqrt(share))
        groups.append((every, most, counts))
    rows, weight = draw_rows(rng, groups)
    return Drawn(features(rows), code[rows] > 0, weight)


def _choose_threshold(
    scenes: Sequence[TrainingScene], odds: Sequence[Singles], recipe: SceneRecipe
) -> float:
    """Choose the least threshold that leaves good points alone; where none does, the greatest.

    By the median kind of scene: there are kinds where points that are right look like outliers.
    """
    kinds: dict[str, list[Floats]] = {}
    for scene, some in zip(scenes, odds, strict=True):
        good = np.sort(some[scene.cause == 0])
        lost = len(good) - np.searchsorted(good, recipe.limits, 'right')
        kinds.setdefault(scene.kind, []).append(lost / max(len(good), 1))
    share = np.median([np.mean(some, axis=0) for some in kinds.values()], axis=0)
    allowed = np.flatnonzero(share <= recipe.most_lost)
    return float(recipe.limits[allowed[0] if len(allowed) else -1])


def _figures(
    scenes: Sequence[TrainingScene], rejected: Sequence[Bools], doubtful: Bools, recipe: SceneRecipe
) -> dict[str, Any]:
    """Say what a threshold gives on scenes that were left out: by kind, by cause, and together."""
    kinds = {}
    for kind in sorted({scene.kind for scene in scenes}):
        some = [n for n, scene in enumerate(scenes) if scene.kind == kind]
        code = np.concatenate([scenes[n].cause for n in some])
        kinds[kind] = _counted(code, np.concatenate([rejected[n] for n in some]), recipe)
    code, every = np.concatenate([scene.cause for scene in scenes]), np.concatenate(rejected)
    causes = np.setdiff1d(code, [Cause.GOOD, *recipe.neither]).tolist()
    bad = np.isin(code, causes)
    return {
        **_counted(code, every, recipe),
        'recall': {Cause(cause).name.lower(): _share(every[code == cause]) for cause in causes},
        'kinds': kinds,
        'lost_of_median_kind': float(np.median([one['lost'] for one in kinds.values()])),
        'doubtful': _share(doubtful[code == 0]),
        'clearly_good': _share(~doubtful[bad]),
    }


def _counted(code: Ints, rejected: Bools, recipe: SceneRecipe) -> dict[str, float]:
    counted = ~np.isin(code, list(recipe.neither))
    bad, rejected = code[counted] > 0, rejected[counted]
    both, total = int((rejected & bad).sum()), int(rejected.sum()) + int(bad.sum())
    return {'f1': round(2.0 * both / max(total, 1), DIGITS), 'lost': _share(rejected[~bad])}


def _share(some: Bools) -> float:
    return round(float(some.mean()), DIGITS)
