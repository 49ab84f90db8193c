# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds without scan lines, judged by trees on the neighbours of each point."""

from itertools import islice
from typing import Any

import numpy as np
import pytest
from helpers.shapes import rows_and_columns
from naive import survey as naive
from numpy.typing import NDArray

from lidar_outlier_filter import detect_outliers
from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.detectors.boosted_trees import neighbour_trees as survey
from lidar_outlier_filter.core.detectors.boosted_trees.features import NEAR, SWEEP
from lidar_outlier_filter.core.detectors.boosted_trees.neighbour_features import (
    MAX_NEIGHBOURS,
    Far,
    Near,
)
from lidar_outlier_filter.core.detectors.boosted_trees.trees import (
    FEATURE_NAMES,
    SURVEY_MODEL,
    Trees,
    load,
)
from lidar_outlier_filter.core.neighbours.floor import Floor, measure_floor
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.core.neighbours.typical import (
    MIN_SCALE_M,
    K,
    typical_scale,
)
from lidar_outlier_filter.evaluation.truth import Cause
from lidar_outlier_lab.simulation import presets
from lidar_outlier_lab.training.train_sweeps import moved


def surface(count: int = 400, seed: int = 1, strays: int = 12) -> Floats:
    """Make a rough surface with strays above and below it, in an order drawn by lot."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform((0.0, 0.0, 0.0), (20.0, 20.0, 0.1), (count, 3))
    xyz[:, 2] += 0.05 * xyz[:, 0]
    xyz[:strays, 2] += rng.uniform(3.0, 30.0, strays) * rng.choice([-1, 1], strays)
    xyz[strays // 2 : strays, :2] = xyz[strays // 2, :2] + rng.normal(0.0, 0.2, (strays // 2, 2))
    return xyz[rng.permutation(count)]


def stacked() -> Floats:
    """Make points of which many coincide, more than lists hold."""
    rng = np.random.default_rng(3)
    return np.concatenate([rng.uniform(0.0, 5.0, (60, 3)), np.ones((12, 3)), np.full((70, 3), 2.0)])


def along_a_line() -> Floats:
    """Make points on a straight line, which have no plane."""
    along = np.random.default_rng(4).uniform(0.0, 9.0, (80, 1))
    xyz: Floats = along * [[1.0, 2.0, 0.5]]
    return xyz


def mirrored(size: int = 33) -> Floats:
    """Make a surface, and a piece of it so many points large that is seen far below it, as well."""
    xyz = surface(300, strays=0)
    near = np.argsort(np.hypot(*(xyz[:, :2] - 10.0).T))[:size]
    return np.concatenate([xyz, xyz[near] - (0.0, 0.0, 25.0)])


CLOUDS = {
    'surface': surface(),
    'mirrored': mirrored(),
    'grid': rows_and_columns(np.random.default_rng(), 18 * 18),
    'stacked': stacked(),
    'line': along_a_line(),
    'short': surface(30, strays=2),
    'nine': surface(9, strays=0),
}
# A plane means nothing where variances are equal, or nothing but rounding.
_PLANE = ('off', 'flat', 'off_flat', 'off20', 'flat20', 'off_flat20', 'flat60', 'off_flat60')
VAGUE = {'grid': ('level',), 'stacked': ('level', *_PLANE), 'line': ('level',)}


def scale_of(xyz: Floats) -> float:
    """Return the typical scale of a cloud, all of whose points there are."""
    return typical_scale(xyz, np.arange(len(xyz)))


def around(xyz: Floats) -> Floor:
    """Return what a cloud is like, all of whose points there are."""
    return measure_floor(xyz, np.arange(len(xyz)))


def odds_of(xyz: Floats, threads: int = 0) -> Floats:
    """Return the log-odds of all points of a cloud."""
    return survey.measure(xyz, around(xyz), threads)[0]


def measured(
    xyz: Floats, *, is_sweep: bool = False
) -> tuple[Neighbourhood, NDArray[np.float32], NDArray[np.float32]]:
    """Return the features of all points, those of the first trees and all, in the order given."""
    hood, which = Neighbourhood(xyz, K), np.arange(len(xyz))
    near = survey.neighbours(hood, around(xyz), sweep=is_sweep)
    first = survey.near_values(near, which)
    odds = survey.first_odds(near, load(SURVEY_MODEL).first)
    index = hood.nearest_of(which, min(MAX_NEIGHBOURS, len(xyz) - 1))
    every = survey.far_values(Far(near, odds, index), which)
    back = np.argsort(hood.order)
    return hood, first[:, back], every[:, back]


@pytest.mark.parametrize('name', CLOUDS)
def test_features_against_loops(name: str) -> None:
    """Each feature is what plain loops say, also of ties, stacks, lines and short clouds."""
    xyz = CLOUDS[name]
    is_sweep = name == 'stacked'
    hood, first, every = measured(xyz, is_sweep=is_sweep)
    positions = [tuple(row) for row in xyz.tolist()]
    odds = survey.first_odds(survey.neighbours(hood, around(xyz)), load(SURVEY_MODEL).first)
    given = odds[np.argsort(hood.order)].tolist()
    expected = np.array(naive.near_features(positions, around(xyz).typical, is_sweep=is_sweep)).T
    wide = np.array(naive.far_features(positions, given, around(xyz).typical)).T
    for n, feature in enumerate(FEATURE_NAMES[SURVEY_MODEL][1]):
        if feature in VAGUE.get(name, ()):
            continue
        loop = expected[n] if n < len(expected) else wide[n - len(expected)]
        np.testing.assert_allclose(every[n], loop, rtol=2e-4, atol=2e-4, err_msg=feature)
    np.testing.assert_array_equal(first, every[: len(first)])


@pytest.mark.parametrize('size', [9, 33, 60, 61, 90])
def test_closed_groups(size: int) -> None:
    """Of a group that is apart the feature is its size, up to 60; of all others it is 61."""
    _, first, _ = measured(mirrored(size))
    sizes = first[[*NEAR].index('component_size')]
    np.testing.assert_array_equal(sizes[:300], 61)
    np.testing.assert_array_equal(sizes[300:], min(size, 61))


def test_trees_against_loops() -> None:
    """The log-odds are sums of what plain loops read from the trees."""
    xyz = CLOUDS['surface']
    _, first, every = measured(xyz)
    model = load(SURVEY_MODEL)
    odds = odds_of(xyz)
    for n in range(0, len(xyz), 5):
        said = _loop(model.first, first[:, n])
        if said > np.float32(model.doubtful):
            said = _loop(model.again, every[:, n])
        assert odds[n] == said


def _loop(trees: Trees, values: NDArray[np.float32]) -> float:
    limits, leaves = trees.limit.tolist(), trees.value.tolist()
    start, features = float(trees.start), trees.feature.tolist()
    return naive.add_up(start, features, limits, leaves, values.tolist())


@pytest.mark.parametrize('size', [1e-3, 1e3])
def test_size_does_not_matter(size: float) -> None:
    """A cloud in millimetres is judged as one in kilometres."""
    xyz = surface(600)
    odds = odds_of(xyz * 1000.0)
    again = odds_of(xyz * 1000.0 * 2.0 ** np.round(np.log2(size)))
    np.testing.assert_allclose(again, odds, atol=0.5)


@pytest.mark.parametrize('name', ['stacked', 'surface', 'coarse'])
def test_places_against_loops(name: str) -> None:
    """The positions are those of a plain loop."""
    xyz = np.round(surface(300)) if name == 'coarse' else CLOUDS[name]
    xyz[xyz == 0] *= np.random.default_rng(1).choice([-1.0, 1.0], np.count_nonzero(xyz == 0))
    first = naive.first_of_each([tuple(row) for row in xyz.tolist()])
    hood, index, copies = Neighbourhood(xyz, K).distinct()
    assert sorted(index.tolist()) == sorted(set(first))
    np.testing.assert_array_equal(hood.xyz, xyz[index])
    assert sorted(copies.T.tolist()) == [[p, at] for p, at in enumerate(first) if p != at]


def test_points_at_one_place_are_judged_as_one() -> None:
    """Copies change no verdict, neither their own nor that of another point."""
    xyz = surface(600)
    odds = odds_of(xyz)
    copies = np.random.default_rng(1).integers(0, 600, 2000)
    order = np.random.default_rng(2).permutation(2600)
    again, _ = survey.measure(np.concatenate([xyz, xyz[copies]])[order], around(xyz))
    np.testing.assert_array_equal(again, np.concatenate([odds, odds[copies]])[order])


@pytest.mark.parametrize('step', [0.02, 0.05, 0.2])
def test_a_floor_that_is_rounded_is_kept(step: float) -> None:
    """A dense floor whose coordinates were rounded, so that many points coincide, loses nothing."""
    xyz = np.random.default_rng(3).uniform((0, 0, 0), (3, 3, 0.004), (60_000, 3))
    rounded = np.round(xyz / step) * step
    assert not detect_outliers(rounded).outlier.any()


@pytest.mark.parametrize(('count', 'times'), [(0, 1), (1, 1), (8, 1), (8, 50), (9, 1)])
def test_too_few_places_are_not_tested(count: int, times: int) -> None:
    """However many points there are, nine positions have eight others each."""
    odds = odds_of(np.repeat(surface(400)[:count], times, axis=0))
    assert np.isnan(odds).all() == (count < 9)


def test_finds_strays_and_loses_nothing() -> None:
    """The default finds single points off a surface, most of a group, and no other point."""
    rng = np.random.default_rng(5)
    xyz = rng.uniform((0.0, 0.0, 0.0), (50.0, 50.0, 0.05), (10_000, 3))
    xyz[:20, 2] += rng.uniform(4.0, 20.0, 20) * rng.choice([-1, 1], 20)
    xyz[20:35] = np.array([25.0, 25.0, 12.0]) + rng.normal(0.0, 0.3, (15, 3))
    outlier = detect_outliers(xyz).outlier
    assert outlier[:20].all()
    assert outlier[20:35].sum() > 10
    assert not outlier[35:].any()


@pytest.mark.parametrize('seed', range(3))
def test_finds_a_piece_that_a_mirror_shows_below(seed: int) -> None:
    """A few dozen points as even as the ground, far below it, are no ground."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform((0.0, 0.0, 0.0), (100.0, 100.0, 0.1), (10_000, 3))
    xyz[:, 2] += 0.05 * xyz[:, 0]
    piece = np.argsort(np.hypot(*(xyz[:, :2] - 50.0).T))[: int(rng.integers(20, 45))]
    outlier = detect_outliers(np.concatenate([xyz, xyz[piece] - (0.0, 0.0, 15.0)])).outlier
    assert outlier[10_000:].mean() > 0.8
    assert not outlier[:10_000].any()


def test_a_sweep_in_the_frame_of_a_vehicle() -> None:
    """Without rings, raised and tilted: snow is found, and next to nothing lost."""
    points = next(islice(presets.make('street-32', 5), 2, None)).points
    xyz = np.stack([points[name] for name in 'xyz'], axis=1).astype(np.float64)
    xyz = moved(xyz[xyz.any(axis=1)], 'a vehicle')
    cause = points['label'][points['x'] != 0]
    outlier = detect_outliers(xyz).outlier
    assert outlier[cause == Cause.SNOW].mean() > 0.9
    assert outlier[cause == Cause.GOOD].mean() < 1e-3
    # From elsewhere, or of any other cloud, distances from the origin are no ranges.
    assert survey.is_sweep(Neighbourhood(xyz, K))
    away: Floats = xyz + np.array([300.0, 0.0, 0.0])
    for other in (away, surface(10_000), xyz[:8000], 1e-170 * xyz):
        assert not survey.is_sweep(Neighbourhood(other, K))


def test_typical_scale() -> None:
    """It is that of an even surface, from all points or few, in any order."""
    for count in (5000, 60_000):
        xyz = np.random.default_rng(7).uniform((0.0, 0.0, 0.0), (50.0, 50.0, 0.01), (count, 3))
        radius = np.median(np.sqrt(Neighbourhood(xyz, K).squared_distances(K)))
        found = scale_of(xyz)
        assert found == pytest.approx(radius, rel=0.1)
        order = np.random.default_rng(8).permutation(count)
        assert scale_of(xyz[order]) == found
        assert typical_scale(xyz, order) == found
        # On a plane the sign of 0 says nothing: the same few points are taken.
        plane = xyz * (1.0, 1.0, 0.0)
        assert scale_of(plane * (1.0, 1.0, -1.0)) == scale_of(plane)
    assert scale_of(xyz[:5]) > 0
    assert scale_of(np.repeat(xyz[:5000], 9, axis=0)) == pytest.approx(
        scale_of(xyz[:5000]), rel=0.05
    )
    # Where points nearly coincide the micrometre is left that is added.
    assert scale_of(1e-15 * xyz[:5000]) == pytest.approx(MIN_SCALE_M)


def inputs(xyz: Floats) -> tuple[Near, Far]:
    """Return what kernels get of a cloud."""
    hood = Neighbourhood(xyz, K)
    near = survey.neighbours(hood, around(xyz))
    odds = survey.first_odds(near, load(SURVEY_MODEL).first)
    return near, Far(near, odds, hood.nearest_of(np.arange(len(xyz)), MAX_NEIGHBOURS))


@pytest.mark.parametrize('name', ['surface', 'stacked', 'line'])
def test_instructions_do_not_matter(name: str) -> None:
    """Each level of instructions gives the same bits, whatever else is in the lanes."""
    near, far = inputs(CLOUDS[name])
    which, found = np.arange(len(near.xyz)), set()
    try:
        for level in _kernels.levels():
            _kernels.set_level(level)
            whole = survey.near_values(near, which), survey.far_values(far, which)
            found.add(b''.join(values.tobytes() for values in whole))
            some = far._replace(index=far.index[7:12])
            np.testing.assert_array_equal(survey.far_values(some, which[7:12]), whole[1][:, 7:12])
    finally:
        _kernels.set_level(_kernels.levels()[-1])
    assert len(found) == 1


NEAR_WRONG: dict[str, Any] = {
    'float32': lambda near: near._replace(xyz=near.xyz.astype(np.float32)),
    'int64': lambda near: near._replace(index=near.index.astype(np.int64)),
    'columns': lambda near: near._replace(index=near.index[:, :7].copy()),
    'slice': lambda near: near._replace(xyz=near.xyz[:, ::-1]),
    'short': lambda near: near._replace(radius=near.radius[:-1]),
    'few marks': lambda near: near._replace(is_large=near.is_large[:-1]),
    'no point': lambda near: near._replace(index=np.full_like(near.index, len(near.index))),
    'before': lambda near: near._replace(index=np.full_like(near.index, -1)),
    'no floor': lambda near: near._replace(
        around=near.around._replace(wide=np.empty(0, np.int64), floor=np.empty((0, 2)))
    ),
}


@pytest.mark.parametrize('name', NEAR_WRONG)
def test_refuses_neighbours_that_do_not_fit(name: str) -> None:
    """What a kernel would read beyond an array, or of another type, is an error in Python."""
    near, far = inputs(CLOUDS['surface'])
    near, which = NEAR_WRONG[name](near), np.arange(len(near.xyz))
    with pytest.raises((TypeError, ValueError)):
        survey.first_odds(near, load(SURVEY_MODEL).first)
    with pytest.raises((TypeError, ValueError)):
        survey.far_values(far._replace(near=near), which)
    with pytest.raises((TypeError, ValueError)):
        _kernels.write_large_components(near, 0, len(which), np.zeros(len(which), np.bool_))


@pytest.mark.parametrize(
    ('end', 'point', 'rows', 'column'),
    [(9, 0, 8, 0), (8, -1, 8, 0), (8, 400, 8, 0), (8, 0, 7, 0), (8, 0, 8, 400), (8, 0, 8, -1)],
)
def test_refuses_points_that_there_are_not(end: int, point: int, rows: int, column: int) -> None:
    """Ranges, points, rows of features and neighbours are checked before they are used."""
    _, far = inputs(CLOUDS['surface'])
    trees, which, odds = load(SURVEY_MODEL).again, np.full(8, point), np.empty(8, np.float32)
    index = far.index[:rows].copy()
    index[-1, -1] = column
    none = np.empty((0, 0), np.float32)
    with pytest.raises(ValueError, match='must'):
        _kernels.judge_far(far._replace(index=index), trees, which, 0, end, odds, none)
    far = far._replace(index=far.index[:8])
    _kernels.judge_far(far, trees, np.arange(8), 0, 8, odds, none)
    for values in (
        np.empty((len(NEAR) + len(SWEEP), 8), np.float32),
        np.empty((57, 7), np.float32),
    ):
        with pytest.raises(ValueError, match='values'):
            _kernels.judge_far(far, trees, np.arange(8), 0, 8, odds, values)
    with pytest.raises(ValueError, match='within the array'):
        _kernels.judge_near(far.near, trees, np.arange(8), 0, 8, odds, none)
