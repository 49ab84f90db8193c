# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The scan pattern of spinning sensors: the neighbours, features and trees are those of loops."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import permutations
from typing import Any

import numpy as np
import pytest
from helpers.scans import RATE, TURN_NS, measured, pattern_of, points_of, sweep
from naive import scan_pattern as naive

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.detectors.boosted_trees import pattern_trees
from lidar_outlier_filter.core.detectors.boosted_trees.features import SECOND_PASS, WINDOW
from lidar_outlier_filter.core.detectors.boosted_trees.pattern_trees import (
    count_scores,
    find_mirrored,
    first_pass,
    judge,
    measure,
    second_pass,
)
from lidar_outlier_filter.core.detectors.boosted_trees.trees import (
    MIN_LOG_ODDS,
    NO_TREES,
    Trees,
    find_valleys,
    load,
)
from lidar_outlier_filter.core.detectors.boosted_trees.window import prepare
from lidar_outlier_filter.core.points.points import Points, concatenate
from lidar_outlier_filter.core.scan_pattern.placed_pattern import count_points, spread
from lidar_outlier_filter.core.scan_pattern.scan_pattern import find_pattern


@pytest.mark.parametrize(
    ('lost', 'turns', 'staggered'),
    [(0.0, 1.0, False), (0.3, 1.3, False), (0.3, 0.6, True), (0.8, 2.2, False)],
)
def test_as_loops(lost: float, turns: float, *, staggered: bool) -> None:
    """Neighbours and features, with missing returns, of a part of a turn and of several."""
    points = sweep(1, lost, turns, staggered=staggered)
    pattern = pattern_of(points)
    xyz = [tuple(row) for row in points.xyz.tolist()]
    rings = naive.rings_of(xyz, points.t.tolist(), points.line.tolist(), RATE)
    # Steps and elevations are medians of samples there, and of all here: a sample is enough.
    rings = [
        ring._replace(step=float(step), gap=float(gap), turn=float(turn), uneven=float(uneven))
        for ring, step, gap, turn, uneven in zip(
            rings, pattern.step, pattern.gap, pattern.turn, pattern.uneven, strict=True
        )
    ]
    out = measured(pattern)
    for number, ring in enumerate(rings):
        positions = range(pattern.first[number], pattern.last[number])
        assert [p.number for p in ring.points] == pattern.order[list(positions)].tolist()
        for k, place in enumerate(positions):
            selected = naive.features(rings, number, k)
            got = {name: float(out[[*WINDOW].index(name), place]) for name in selected}
            assert got == pytest.approx(selected, rel=2e-3, abs=1e-5), (number, k)


def test_strays_are_found() -> None:
    """The default's model rejects most of what hangs in a room, and nearly none of its walls."""
    points = sweep(4, 0.0, columns=900)
    level = np.hypot(points.xyz[:, 0], points.xyz[:, 1])
    azimuth = np.arctan2(points.xyz[:, 1], points.xyz[:, 0])
    wall = np.minimum(8.0 / np.abs(np.cos(azimuth)), 5.0 / np.abs(np.sin(azimuth)))
    stray = level < 0.85 * wall
    rejected = judge(pattern_of(points), 1.0) > 1
    assert rejected[stray].mean() > 0.7
    assert rejected[~stray].mean() < 0.02


def test_no_pattern() -> None:
    """Lines one after the other, few points, and disordered azimuths are no scan pattern."""
    points = sweep(6, 0.0)
    number = np.arange(len(points))
    assert find_pattern(points_of(points.xyz, number, number // 90)) is None
    assert find_pattern(points.take(slice(0, 10))) is None
    rng = np.random.default_rng(1)
    wild = points_of(rng.standard_normal((len(points), 3)), points.t, points.line)
    assert find_pattern(wild) is None


@pytest.mark.parametrize('away', [1e3, 1e4, 5e6])
@pytest.mark.parametrize('in_rows', [False, True])
def test_seen_from_far_away_nothing_turns(away: float, *, in_rows: bool) -> None:
    """In coordinates of a map, the origin is not where the sensor is."""
    points = sweep(6, 0.0, columns=1024)
    moved = points_of(points.xyz + np.array([0.1, 1.0, 0.0]) * away, points.t, points.line)
    assert find_pattern(points, in_rows=in_rows) is not None
    assert find_pattern(moved, in_rows=in_rows) is None


# Degrees: of data sheets.
HALVES = [*np.linspace(-24.33, -8.83, 32), *np.linspace(-8.33, 2.0, 32)]  # HDL-64E
CROWDED = [  # VLP-32C
    *(-25, -15.64, -11.31, -8.84, -7.25, -6.15, -5.33, -4.67),
    *np.linspace(-4, 5 / 3, 18),
    *(2.33, 3.33, 4.67, 7, 10.33, 15),
]


@pytest.mark.parametrize(
    'elevations',
    [
        np.linspace(-15, 15, 16),
        np.delete(np.linspace(-30.67, 10.67, 32), [4, 20]),  # two without returns
        HALVES,
        CROWDED,
        np.geomspace(1, 25, 16),
        [0.0],
    ],
)
def test_rings_however_spaced(elevations: Sequence[float]) -> None:
    """Angles to the rings beside are those of the table; of one ring there is no other."""
    pattern = find_pattern(sweep(7, 0.4, elevations=elevations), spins=True)
    assert pattern is not None
    known = np.radians(np.sort(elevations))
    positions = range(len(known))
    for row, off in enumerate((-2, -1, 1, 2)):
        there = [n for n in positions if 0 <= n + off < len(known)]
        selected = [abs(known[n + off] - known[n]) for n in there]
        np.testing.assert_allclose(pattern.beside[row, there], selected, rtol=2e-3)
    if len(known) > 2:
        near, far = np.sort(np.abs(np.diff(known))[[[n - 1, n] for n in positions[1:-1]]]).T
        selected = np.minimum(far / near, 10.0)
        np.testing.assert_allclose(pattern.uneven[1:-1], selected, rtol=5e-3)
    assert pattern.uneven[[0, -1]].tolist() == [10.0, 10.0]


def test_steps_between_shots() -> None:
    """Each ring has its own: a beam that points up moves by less than the head turns."""
    elevations = np.array([40.0, 0.0, 60.0, 20.0])
    points = sweep(13, 0.0, columns=360, elevations=tuple(elevations))
    column = np.arange(len(points)) // len(elevations)
    points = points.take((points.line > 0) | (column % 2 == 0))  # every second shot of that ring
    rank = np.argsort(elevations)
    turned = np.radians(np.where(rank == 0, 2.0, 1.0))
    selected = turned * np.cos(np.radians(elevations[rank]))
    np.testing.assert_allclose(pattern_of(points).step, selected, rtol=0.02)


def test_beams_near_the_zenith_see_their_neighbours() -> None:
    """Returns of a ring beside the zenith are near each other, though azimuths are far apart."""
    pattern = pattern_of(sweep(9, 0.0, elevations=(80.0, 84.0, 86.0, 88.0), columns=360))
    out = measured(pattern)
    for line in range(4):
        some = slice(pattern.first[line] + 5, pattern.last[line] - 5)
        assert (out[[*WINDOW].index('there_own'), some] == 1).mean() > 0.9


def test_a_plane_is_predicted_across_uneven_rings() -> None:
    """On a level floor, the rings beside predict the range however unevenly they are spaced."""
    down = np.radians([-40.0, -31.0, -28.0, -26.5, -20.0, -18.0, -17.5])
    shot = np.arange(len(down) * 720)
    ring, azimuth = shot % len(down), RATE * (shot // len(down) * 138_889)
    far = 2.0 / np.sin(-down)[ring]
    up = np.sin(down)[ring]
    level = np.cos(down)[ring]
    xyz = far[:, None] * np.stack([level * np.cos(azimuth), level * np.sin(azimuth), up], axis=1)
    t = shot // len(down) * 138_889 + ring
    pattern = pattern_of(points_of(xyz, t, ring))
    out = measured(pattern)[[*WINDOW].index('across')]
    some = np.concatenate([np.arange(pattern.first[n] + 9, pattern.last[n] - 9) for n in range(7)])
    # An arc of the sine of the elevation is not straight: a part of the angle between rings.
    assert out[some].max() < 0.2


def test_copies_share_a_verdict() -> None:
    """A second return at the same place, as drivers publish it, changes nothing."""
    points = sweep(4, 0.1, columns=900)
    rng = np.random.default_rng(1)
    twice = np.sort(np.concatenate([np.arange(len(points)), rng.integers(0, len(points), 20_000)]))
    again = points.take(twice)
    once, both = pattern_of(points), pattern_of(again)
    assert len(both.copies) == len(again) - len(points)
    score, copied = judge(once, 1.0), judge(both, 1.0)
    assert copied.tobytes() == score[twice].tobytes()
    # Two returns of a shot at different positions are two.
    farther = replace(
        again, xyz=again.xyz * np.where(np.diff(twice, prepend=-1) == 0, 1.5, 1.0)[:, None]
    )
    apart = pattern_of(farther)
    assert count_points(apart) == len(again)
    assert len(apart.copies) < len(both.copies)


def test_two_returns_of_a_shot_are_one_beam() -> None:
    """Rounded coordinates do not part them, and heads with two returns turn steadily."""
    points = sweep(4, 0.0, columns=900)
    index = np.repeat(np.arange(len(points)), 2)
    far = np.where(np.arange(len(index)) % 2, 1.0, 0.6137)[:, None]
    rounded = (points.xyz[index] * far).astype(np.float32).astype(np.float64)
    both = replace(points.take(index), xyz=rounded)
    for order in (np.arange(len(index)), np.random.default_rng(1).permutation(len(index))):
        pattern = pattern_of(both.take(order))
        assert count_points(pattern) == len(index)
        for n in range(len(pattern.first)):
            some = slice(pattern.first[n], pattern.last[n])
            near, farther = pattern.range[some][::2], pattern.range[some][1::2]
            assert (near < farther).all()
            assert np.array_equal(pattern.phase[some][::2], pattern.phase[some][1::2])


@pytest.mark.parametrize('dim', [(1.0, 0.3, 0.5), (1.0, np.nan, 0.5)])
def test_the_brightest_copy_counts(dim: tuple[float, ...]) -> None:
    """Copies of different intensities, or without, may come in any order."""
    points = sweep(4, 0.1, columns=900)
    rng = np.random.default_rng(2)
    points = replace(points, intensity=rng.uniform(1, 9, len(points)).astype(np.float32))
    score = judge(pattern_of(points), 1.0)
    index = np.repeat(np.arange(len(points)), 3)
    copies = points.take(index)
    assert copies.intensity is not None
    for order in permutations(dim):
        darker = copies.intensity * np.tile(np.array(order, np.float32), len(points))
        again = judge(pattern_of(replace(copies, intensity=darker)), 1.0)
        assert again.tobytes() == score[index].tobytes()


@pytest.mark.parametrize('threshold', [1.0, 2.0])
@pytest.mark.parametrize('drop', [0.0, 2.0])
def test_score_of_1_is_the_threshold_of_the_block(
    threshold: float, drop: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A valley of the log-odds, where the model allows it, times the user's threshold."""
    points = sweep(5, 0.1, columns=900)
    pattern = pattern_of(points)
    model, prepared = load()._replace(drop=drop), prepare(pattern)
    monkeypatch.setattr(pattern_trees, 'load_model', lambda _name: model)
    first = first_pass(prepared, model.first)
    odds = np.empty(len(points), np.float32)
    spread(pattern, second_pass(prepared, first, model), odds)
    own = naive.valley(odds.tolist(), model.threshold, drop)
    assert (own < model.threshold) == (drop > 0)
    limit = threshold * (own - MIN_LOG_ODDS)
    expected = np.maximum(odds.astype(np.float64) - MIN_LOG_ODDS, 0.0) / limit
    np.testing.assert_array_equal(judge(pattern, threshold), expected)


def mirrored_room(columns: int) -> Points:
    """Return a room with ghosts: what hung in it lies 6 m behind its walls."""
    points = sweep(5, 0.1, columns=columns)
    x, y = np.abs(points.xyz[:, :2]).T
    hangs = (x < 7.5) & (y < 4.7)
    return replace(
        points, xyz=points.xyz * (1.0 + np.where(hangs, 6.0, 0.0) / points.range)[:, None]
    )


def test_panes_are_those_of_loops() -> None:
    """Also beside missing returns, at both ends of a ring, and of the lowest and highest ring."""
    points = mirrored_room(120)
    pattern = pattern_of(points)
    prepared, there = prepare(pattern), np.flatnonzero(pattern.order >= 0)
    found = np.zeros((7, len(there)), np.float32)
    _kernels.find_panes(prepared, there, 0, len(there), found)
    xyz = [tuple(row) for row in points.xyz.tolist()]
    rings, expected = naive.rings_of(xyz, points.t.tolist(), points.line.tolist(), RATE), []
    for n, ring in enumerate(rings):
        step, gap, turn = (float(of[n]) for of in (pattern.step, pattern.gap, pattern.turn))
        rings[n] = ring._replace(step=step, gap=gap, turn=turn)
        ups = pattern.beside[:, n].tolist()
        expected += [naive.pane(rings, n, k, ups) for k in range(len(ring.points))]
    loops = np.array(expected).T
    same = (np.abs(found - loops) <= 1e-3 + 2e-3 * np.abs(loops)).all(axis=0)[found[0] > 0]
    np.testing.assert_array_equal(found[0] > 0, loops[0] > 0)
    assert 20 < len(same) < len(points) / 10
    # Single precision decides of a return at the very edge of a plane.
    assert same.mean() > 0.95


@pytest.mark.parametrize('drop', [0.0, 2.0])
def test_trees_on_ghosts_judge_what_is_kept_behind_panes(
    drop: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By their own threshold, whatever the valley of a block; the higher log-odds count."""
    pattern = pattern_of(mirrored_room(900))
    model, size = load()._replace(drop=drop, ghosts=NO_TREES), count_points(pattern)
    monkeypatch.setattr(pattern_trees, 'load_model', lambda _name: model)
    before, behind = judge(pattern, 1.0), np.zeros(size, np.bool_)
    zeros = np.zeros((1, 7), np.int32), np.zeros((1, 7), np.float32), np.zeros((1, 8), np.float32)
    prepared = prepare(pattern)
    once, every = first_pass(prepared, model.first), np.ones(len(pattern.order), np.bool_)
    places, _ = find_mirrored(prepared, once, every)
    behind[pattern.order[places]] = True
    assert once.score[places].min() > -2
    for odds, rises in ((model.threshold + 0.1, True), (model.threshold - 0.1, False)):
        one = Trees(*zeros, np.float32(odds))
        more, reason = model._replace(ghosts=one), np.zeros(size, np.uint8)
        monkeypatch.setattr(pattern_trees, 'load_model', lambda _name, more=more: more)
        found = judge(pattern, 1.0, reason=reason)
        raised = (before <= 1) & behind & rises
        np.testing.assert_array_equal(found > 1, (before > 1) | raised)
        np.testing.assert_array_equal(reason == 194, raised)
        np.testing.assert_array_equal(found[before > 1], before[before > 1])
        assert raised.any() == rises


NUMBERS = (0, 30, 49, 50, 80, 3000)  # of outliers


def test_valleys_are_those_of_loops() -> None:
    """Also where values are equal to a tried one, few exceed the threshold, or none is there."""
    rng = np.random.default_rng(1)
    limits = np.array([-1.0, 0.5, 1.5, 9.0])
    # At least 50 points must exceed the threshold, and 0.5 % of all.
    few_of_few, few_of_many = (1000, 30), (30_000, 90)
    for points, outliers in (few_of_few, few_of_many, *((9000, n) for n in NUMBERS)):
        good, bad = rng.normal(-4, 1, points), rng.normal(3, 1.5, outliers)
        odds = np.concatenate([good, bad]).round(1).astype(np.float32)
        expected = [naive.valley(odds.tolist(), limit, 2.0) for limit in limits]
        assert find_valleys(odds, limits, 2.0).tolist() == expected
        assert find_valleys(odds, limits, 0.0).tolist() == limits.tolist()
    assert expected[2] < limits[2]
    assert find_valleys(odds[:0], limits, 2.0).tolist() == limits.tolist()


def test_arctangent() -> None:
    """Within 1e-8 of the function, in all quadrants and on the axes."""
    rng = np.random.default_rng(1)
    axes = np.array([[0, 1], [1, 0], [0, -1], [-1, 0], [2, 2]], np.float64)
    x, y = np.concatenate([rng.standard_normal((500, 2)), axes]).T.copy()
    np.testing.assert_allclose(
        _kernels.elevations(x, y, 0.0, 0.0), np.arctan2(y, x), rtol=0, atol=1e-8
    )


def test_trees_are_those_of_loops() -> None:
    """Sums of what single trees say, in their order, also where a feature is the limit."""
    rng = np.random.default_rng(1)
    feature = rng.integers(0, 5, (20, 7)).astype(np.int32)
    limit = rng.integers(-3, 4, (20, 7)).astype(np.float32)
    value = rng.standard_normal((20, 8)).astype(np.float32)
    points = rng.integers(-3, 4, (5, 40)).astype(np.float32)
    total = np.empty(40, np.float32)
    _kernels.add_trees(Trees(feature, limit, value, np.float32(0.5)), points, total)
    for n in range(40):
        expected = np.float32(0.5)
        for f, at, v in zip(feature.tolist(), limit.tolist(), value.tolist(), strict=True):
            expected = np.float32(
                expected + np.float32(naive.tree(f, at, v, points[:, n].tolist()))
            )
        assert total[n] == expected


@pytest.mark.parametrize('turns', [3, 40, 3000, 20_003, 400_001])
def test_a_turn_is_judged_alike_whenever_it_is(turns: int) -> None:
    """The verdicts on points do not depend on how often the head turned before it saw them."""
    points = sweep(10, 0.2, 1.3, columns=1800)
    later = replace(points, t=points.t + turns * TURN_NS)
    score = judge(pattern_of(concatenate([points, later])), 1.0)
    once, again = score[: len(points)], score[len(points) :]
    assert 0 < np.count_nonzero(once > 1) < 0.2 * len(points)
    # At the ends of what is seen together, longer stretches have other points in them.
    step = TURN_NS // 1800
    inner = (points.t > 60 * step) & (points.t < points.t.max() - 60 * step)
    assert inner.mean() > 0.9
    np.testing.assert_array_equal(once[inner], again[inner])


@pytest.mark.parametrize('count', range(64, 97, 5))
def test_nothing_is_read_behind_the_last_line(count: int) -> None:
    """Lines of any length; scripts/sanitize would see a read beyond an array."""
    points = sweep(11, 0.0, columns=count)
    assert (judge(pattern_of(points), 1.0) >= 0).all()


def test_scores_of_the_first_pass_around_points() -> None:
    """Shares of rings beside: no ring is beyond the outermost."""
    points = sweep(12, 0.0)
    pattern = pattern_of(points)
    prepared = prepare(pattern)
    score = np.full(len(pattern.order), -1.0, np.float32)
    score[pattern.first[0] : pattern.first[0] + 9] = 1.0
    out = measure(prepared, count_scores(pattern, score))
    found = dict(zip(SECOND_PASS, out[len(WINDOW) :], strict=True))
    for line in range(len(pattern.first)):
        wide = found['wide_other'][pattern.first[line] : pattern.last[line]]
        assert wide.any() == (line in {1, 2})


def test_a_range_at_an_edge_belongs_to_what_is_nearer() -> None:
    """Shares are those of all points up to 1, 2, 4 … 64 m, and of all that are farther away."""
    pattern = pattern_of(sweep(12, 0.0))
    there = pattern.order >= 0
    some = np.array([0.5, 1, 1.5, 2, 3, 4, 6, 8, 16, 32, 63, 64, 65, 128, 900], np.float32)
    far = np.resize(some, len(there))
    score = np.random.default_rng(1).choice(np.array([-1, 1], np.float32), len(there))
    found = count_scores(pattern._replace(range=far), score)
    octave = np.clip(np.ceil(np.log2(far)), 0, 7)
    for k in np.flatnonzero(there):
        alike = there & (octave == octave[k])
        assert found.share[k] == np.float32((score[alike] > 0).mean())


def test_refuses_what_does_not_fit() -> None:
    """Nothing is read or written beyond an array, whatever numbers there are."""
    pattern = pattern_of(sweep(1, 0.3))
    prepared, trees = prepare(pattern), load().first
    size, lines = len(pattern.order), len(pattern.first)
    odds, asked = np.zeros(size, np.float32), np.ones(size, np.bool_)
    none = pattern_trees.NO_FIRST_PASS
    rest: Any = np.empty(0, np.int64), 0, lines, odds, np.empty((0, 0), np.float32)
    with pytest.raises(TypeError, match='array of float32'):
        _kernels.write_roughness(pattern, 0, lines, np.zeros(size))  # type: ignore[arg-type]
    far = trees._replace(feature=trees.feature + np.int32(40))
    beyond = prepared._replace(near=prepared.near + np.int32(size))
    short = prepared._replace(pattern=pattern._replace(x=pattern.x[:-1]))
    moved = prepared._replace(pattern=pattern._replace(last=pattern.last + 100))
    for some, second, given, known in (
        (prepared, False, asked, far),
        (beyond, False, asked, trees),
        (short, False, asked, trees),
        (moved, False, asked, trees),
        (prepared, True, asked, trees),
        (prepared, False, asked[:-1], trees),
    ):
        with pytest.raises(ValueError, match='must'):
            _kernels.judge_pattern(some, none, second, given, known, *rest)
    with pytest.raises(ValueError, match='begin and end'):
        _kernels.write_roughness(pattern, 0, lines + 1, odds)
    with pytest.raises(ValueError, match='indices'):
        _kernels.scale_odds(pattern, odds, -8.0, 1.0, 0, lines, np.zeros(3), asked)
