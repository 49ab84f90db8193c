# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The scan pattern of profile scanners, compared with its naive twin: scanner, features, groups."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from helpers.scans import (
    PERIOD,
    SPEED,
    TURN_NS,
    Drive,
    Mirror,
    points_of,
    prepared,
    profile_pattern_of,
    sweep,
)
from naive import profile_pattern as naive
from naive import scan_pattern as naive_pattern
from naive import survey as naive_survey
from numpy.testing import assert_allclose, assert_array_equal

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.detectors.boosted_trees import pattern_trees
from lidar_outlier_filter.core.detectors.boosted_trees import profile_features as profile
from lidar_outlier_filter.core.detectors.boosted_trees.features import (
    PROFILE,
    REASON_NAMES,
    WINDOW,
)
from lidar_outlier_filter.core.detectors.boosted_trees.pattern_trees import judge, measure
from lidar_outlier_filter.core.detectors.boosted_trees.trees import PROFILE_MODEL, Trees, load
from lidar_outlier_filter.core.detectors.boosted_trees.window import prepare
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.points.points import Points, concatenate
from lidar_outlier_filter.core.points.scan_lines import line_starts
from lidar_outlier_filter.core.scan_pattern import profile_scanner
from lidar_outlier_filter.core.scan_pattern.placed_pattern import Pattern
from lidar_outlier_filter.core.scan_pattern.profile_pattern import find_profile_pattern
from lidar_outlier_filter.core.scan_pattern.profile_scanner import SAMPLE_RETURNS, Fit, fit_lines
from lidar_outlier_filter.parameters.filter import FilterParameters


def lines_of(pattern: Pattern) -> list[naive_pattern.Ring]:
    """Convert the lines of a pattern to the form of the naive twin."""
    found = []
    for line in range(len(pattern.first)):
        part = slice(pattern.first[line], pattern.last[line])
        columns = (pattern.x, pattern.y, pattern.z, pattern.range, pattern.phase)
        rows = np.stack([column[part] for column in columns], axis=1).tolist()
        points = [
            naive_pattern.Point(k, (x, y, z), reach, phase)
            for k, (x, y, z, reach, phase) in enumerate(rows)
        ]
        found.append(
            naive_pattern.Ring(points, 0.0, float(pattern.step[line]), float(pattern.gap[line]))
        )
    return found


@pytest.mark.parametrize('moved', [(0.0, 0.0, 0.0), (4e5, 5e6, 100.0)])
@pytest.mark.parametrize('lost', [0.0, 0.4])
def test_scanner_position(lost: float, moved: tuple[float, float, float]) -> None:
    """Ranges and mirror angles are recovered, independent of the origin of the coordinates."""
    drive = Drive(1, lost)
    points = points_of(drive.points.xyz + moved, drive.points.t, drive.points.line)
    pattern = profile_pattern_of(points)
    has_return = pattern.order >= 0
    order = pattern.order[has_return]
    assert_array_equal(order, np.arange(len(points)))
    assert_allclose(pattern.range[has_return], drive.far[order], atol=0.06)
    off = pattern.phase[has_return] - drive.angle[order]
    assert np.ptp(off) < 1e-4
    assert_allclose(pattern.step, 2 * np.pi / 120, rtol=0.02)
    # Distance between two lines, plus an allowance for range noise of 4 mm.
    line_spacing = np.linalg.norm(SPEED) * PERIOD * 1e-9
    assert_allclose(pattern.apart - pattern.noise, line_spacing, atol=0.03)
    assert_allclose(pattern.noise / 2, 0.004, rtol=0.4)


@pytest.mark.parametrize('faster', [0.0, 1.5, 3.7])
def test_dense_lines_of_a_scanner_that_drives(faster: float) -> None:
    """First returns drift with what is scanned; the scanner moves by many steps within a line."""
    drive = Drive(21, 0.1, lines=24, shots=2500, faster=faster)
    seen = drive.angle > 0.4 + 0.03 * drive.line
    xyz = drive.points.xyz + np.array([4e5, 5e6, 100.0])
    pattern = profile_pattern_of(points_of(xyz, drive.t, drive.line).take(seen))
    has_return = pattern.order >= 0
    order = np.flatnonzero(seen)[pattern.order[has_return]]
    assert np.ptp(pattern.phase[has_return] - drive.angle[order]) < 0.25 * 2 * np.pi / 2500
    assert_allclose(pattern.range[has_return], drive.far[order], atol=0.02)


def test_scanner_in_the_sensor_frame() -> None:
    """Untransformed points have the scanner at their origin."""
    rng = np.random.default_rng(3)
    drive = Drive(3)
    beam = np.stack([np.sin(drive.angle), np.zeros(len(drive.angle)), np.cos(drive.angle)], axis=1)
    beam += 1e-4 * rng.standard_normal(beam.shape)
    points = points_of(drive.far[:, None] * beam, drive.points.t, drive.points.line)
    pattern = profile_pattern_of(points)
    has_return = pattern.order >= 0
    assert_allclose(pattern.range[has_return], drive.far[pattern.order[has_return]], atol=0.02)


@pytest.mark.parametrize('moved', [(0.0, 0.0, 0.0), (4e5, 5e6, 100.0)])
@pytest.mark.parametrize('lost', [0.0, 0.4])
def test_scanner_equals_naive(lost: float, moved: tuple[float, float, float]) -> None:
    """Position and residuals of each line equal the naive fit, also if fitted alone."""
    drive = Drive(2, lost)
    first = line_starts(drive.line)
    sampled = (
        first[:-1, None] + np.arange(SAMPLE_RETURNS) * np.diff(first)[:, None] // SAMPLE_RETURNS
    )
    xyz, turned = (drive.points.xyz + moved)[sampled], drive.angle[sampled] + 0.7
    found = fit_lines(xyz, turned)
    for line, rows in enumerate(xyz):
        expected = naive.seat(rows, turned[line].tolist())
        assert_allclose(found.position[line], expected.position, rtol=0, atol=1e-8)
        shown = [found.off[line], found.unsure[line]]
        assert_allclose(shown, [expected.off, expected.unsure], rtol=1e-5)
        assert_allclose(found.beam[line], expected.beam, rtol=0, atol=1e-8)
        alone = fit_lines(xyz[line : line + 1], turned[line : line + 1])
        for one, every in zip(alone, found, strict=True):
            assert_array_equal(one[0], every[line])


@pytest.mark.parametrize('swing', [1.2, 1.9])
@pytest.mark.parametrize(('turn', 'pendulum'), [(1, False), (-1, False), (-1, True)])
def test_swinging_mirror(swing: float, turn: int, *, pendulum: bool) -> None:
    """Scanner and mirror angles (± 2 steps) are recovered, with returns one way or both ways."""
    drive = Drive(12, 0.1, 16, 400, mirror=Mirror(swing, turn, pendulum=pendulum))
    lost = drive.angle > drive.angle.max() - 0.3  # no returns at one end
    points, far, angle = drive.points.take(~lost), drive.far[~lost], drive.angle[~lost]
    pattern = profile_pattern_of(points)
    has_return = pattern.order >= 0
    order = pattern.order[has_return]
    assert_allclose(pattern.range[has_return], far[order], atol=0.05)
    off = pattern.phase[has_return] - angle[order]
    backwards = pattern.phase[has_return] + angle[order]
    assert min(np.ptp(off), np.ptp(backwards)) < 0.02


def test_narrow_swing_has_no_pattern() -> None:
    """Mirrors of airborne scanners swing less than those in the training data."""
    narrow = Drive(12, 0.1, 16, mirror=Mirror(0.5, -1, pendulum=True)).points
    assert find_profile_pattern(narrow) is None


@pytest.mark.parametrize(
    ('field', 'value', 'is_accepted'),
    [('unsure', 0.19, True), ('unsure', 0.21, False), ('off', 0.99, True), ('off', 1.01, False)],
)
def test_limits_of_the_fit(
    monkeypatch: pytest.MonkeyPatch, field: str, value: float, *, is_accepted: bool
) -> None:
    """Uncertainty up to 0.2 m and residuals up to a mirror step are accepted."""
    value *= 2 * np.pi / 120 if field == 'off' else 1.0

    def fit(xyz: Floats, turned: Floats) -> Fit:
        found = fit_lines(xyz, turned)
        return found._replace(**{field: np.full(len(xyz), value)})

    monkeypatch.setattr(profile_scanner, 'fit_lines', fit)
    assert (find_profile_pattern(Drive(5).points) is not None) == is_accepted


@pytest.mark.parametrize(('lines', 'is_accepted'), [(2, True), (3, False)])
def test_half_of_the_lines_must_fit(lines: int, *, is_accepted: bool) -> None:
    """Of every five lines, the first few have random points."""
    points = Drive(5).points
    random_xyz = np.random.default_rng(5).uniform(-5.0, 5.0, points.xyz.shape)
    xyz = np.where((points.line % 5 < lines)[:, None], random_xyz, points.xyz)
    found = find_profile_pattern(points_of(xyz, points.t, points.line))
    assert (found is not None) == is_accepted


def test_lines_without_returns() -> None:
    """Missing or nearly empty lines do not affect the others."""
    drive = Drive(4, 0.1, lines=16)
    line, index = drive.points.line, np.arange(len(drive.points))
    kept = (line != 5) & (line != 6) & ((line != 9) | (index % 7 == 0))
    pattern = profile_pattern_of(drive.points.take(kept))
    has_return = pattern.order >= 0
    order = np.flatnonzero(kept)[pattern.order[has_return]]
    assert_allclose(pattern.range[has_return], drive.far[order], atol=0.1)
    assert np.ptp(pattern.phase[has_return] - drive.angle[order]) < 1e-4


def test_no_pattern() -> None:
    """Spinning sensors, single lines, but not two, unsteady mirrors and random points have none."""
    points = Drive(5).points
    assert find_profile_pattern(sweep(1, 0.0)) is None
    assert find_profile_pattern(points.take(points.line < 1)) is None
    assert find_profile_pattern(points.take(points.line < 2)) is not None  # their period is known
    assert find_profile_pattern(points.take(slice(0, 0))) is None
    assert find_profile_pattern(points.take(points.line == 3)) is None
    rng = np.random.default_rng(5)
    random_xyz = rng.uniform(-5.0, 5.0, points.xyz.shape)
    assert find_profile_pattern(points_of(random_xyz, points.t, points.line)) is None
    coincident = np.zeros_like(points.xyz)
    assert find_profile_pattern(points_of(coincident, points.t, points.line)) is None
    assert find_profile_pattern(points_of(points.xyz, points.t * 0, points.line)) is None
    swaying = points.t + (800_000 * np.sin(points.t / 7e5)).astype(np.int64)
    swaying[1:] = np.maximum(swaying[1:], swaying[:-1])
    assert find_profile_pattern(points_of(points.xyz, swaying, points.line)) is None


@pytest.mark.parametrize('elevations', [np.linspace(-15, 15, 16), np.linspace(-22, 22, 32)])
@pytest.mark.parametrize('start', range(4))
def test_a_spinning_sensor_is_no_profile_scanner(elevations: Sequence[float], start: int) -> None:
    """Each turn as one line fits the angles of a mirror, but its returns are not in a plane."""
    turn = sweep(14, 0.05, 3.5, columns=1024, elevations=elevations)
    column = (turn.t + start * TURN_NS // 7) // (TURN_NS // 1024)
    times = column * (TURN_NS // 1024)  # one time per column
    points = points_of(turn.xyz, times, times // TURN_NS)
    assert find_profile_pattern(points) is None
    moving = points_of(turn.xyz + times[:, None] * 1e-8, times, points.line)
    assert find_profile_pattern(moving) is None


@pytest.mark.parametrize(('lost', 'lines'), [(0.0, 6), (0.3, 8), (0.6, 8)])
def test_features_equal_naive(lost: float, lines: int) -> None:
    """Features of windows and of pairs equal those of the naive twin."""
    pattern = profile_pattern_of(Drive(6, lost, lines, 60 if lost == 0.0 else 100).points)
    found = prepared(pattern)
    names, values = [*WINDOW, *PROFILE], measure(found)
    rings = lines_of(pattern)
    for number, ring in enumerate(rings):
        for k in range(len(ring.points)):
            position = pattern.first[number] + k
            metres = [float(one[number]) for one in (pattern.apart, pattern.level)]
            expected = naive_pattern.features(rings, number, k, *metres)
            got = {name: float(values[names.index(name), position]) for name in expected}
            assert got == pytest.approx(expected, rel=2e-3, abs=1e-5), (number, k)
            sigma = float(pattern.noise[number]) / 2
            predicted = naive.predictions(rings, number, k, sigma)
            expected = naive.of_pairs(predicted)
            got = {name: float(values[names.index(name), position]) for name in expected}
            # Squares of single-precision ranges, in standard deviations.
            assert got == pytest.approx(expected, rel=2e-3, abs=0.02), (number, k)


@pytest.mark.parametrize('reach', profile.REACHES)
@pytest.mark.parametrize('lost', [0.0, 0.5])
def test_groups_equal_naive(lost: float, reach: float) -> None:
    """Segments close to each other and far from surfaces form the groups of the naive twin."""
    drive = Drive(7, lost, 8, 400)
    far = drive.far.copy()
    shorter = ((1, 1.0, 0.5), (2, 2.5, 0.7), (4, 2.6, 0.71), (5, 4.0, 0.9), (6, 5, 1))
    for line, angle, part in shorter:
        far[(np.abs(drive.line - line) < 2) & (np.abs(drive.angle - angle) < 0.06)] *= part
    pattern = profile_pattern_of(drive.measured(far))
    near = prepare(pattern).near
    segments = profile.Segments(*_kernels.find_segments(pattern, reach))
    group = _kernels.join_segments(pattern, near, reach, segments)
    rings = lines_of(pattern)
    expected = naive.groups(rings, pattern.apart.tolist(), reach)
    got: dict[int, list[tuple[int, int]]] = {}
    for number, ring in enumerate(rings):
        for k in range(len(ring.points)):
            g = int(group[segments.of[pattern.first[number] + k]])
            got.setdefault(g, []).append((number, k))
    got.pop(-1, None)
    assert len(expected) > 1
    assert sorted(got.values()) == sorted(expected)


@pytest.mark.parametrize('lost', [0.0, 0.5])
def test_heights_equal_naive(lost: float) -> None:
    """The height of a return is that above the floor of one return in four, in metres."""
    pattern = profile_pattern_of(Drive(9, lost, 8, 400, strays=0.05).points)
    xyz = [point.xyz for ring in lines_of(pattern) for point in ring.points]
    expected = naive_survey.heights(xyz, xyz[:: profile.EVERY], profile.COLUMN)
    found = profile.find_heights(pattern)
    has_return = pattern.order >= 0
    assert_allclose(found[has_return], expected, rtol=0, atol=1e-5)
    assert not found[~has_return].any()


def test_mirror_images_below_a_road() -> None:
    """A road mirrors a few of its returns down to where the walls would be; a pit is no image."""
    drive = Drive(10, 0.02, lines=20, shots=800, strays=0.0)
    road = (np.abs(drive.points.xyz[:, 2]) < 0.05) & (np.abs(drive.points.xyz[:, 1]) > 2.5)
    mirrored = road & (np.random.default_rng(3).random(len(road)) < 0.02)
    points = drive.measured(np.where(mirrored, 2.2 * drive.far, drive.far))
    rejected = scores(points) > 1
    assert rejected[mirrored].mean() > 0.8
    assert rejected[~mirrored].mean() < 0.001
    pit = road & (drive.points.xyz[:, 1] > 2.0)
    deep = drive.measured(np.where(pit, 1.7 * drive.far, drive.far))
    assert (scores(deep) > 1).mean() < 0.001


def test_group_of_an_arm() -> None:
    """A slanted tube in the air is one free group, with the features of the naive twin."""
    drive = Drive(8, lines=12, shots=400, strays=0.0)
    tube = np.abs(drive.angle - 1.9) < 0.12
    far = np.where(tube, 0.5 * drive.far + 0.05 * (drive.line - 6), drive.far)
    points = drive.measured(far)
    xyz = points.xyz
    pattern = profile_pattern_of(points)
    has_return = pattern.order >= 0
    found = np.empty((len(profile.GROUPS), len(points)))
    groups = profile.find_groups(pattern, prepare(pattern).near)
    found[:, pattern.order[has_return]] = groups[:, has_return]
    assert_array_equal(found[0] == np.count_nonzero(tube), tube)
    described = {name: float(found[n, tube].max()) for n, name in enumerate(profile.GROUPS)}
    along = np.linalg.svd(xyz[tube] - xyz[tube].mean(axis=0))[2]
    turned = (xyz - xyz[tube].mean(axis=0)) @ along.T
    assert described['group_slope'] == pytest.approx(abs(along[0, 2]), abs=1e-3)
    rings = lines_of(pattern)
    members = []
    for number, ring in enumerate(rings):
        first = pattern.first[number]
        for k, point in enumerate(ring.points):
            index = pattern.order[first + k]
            ring.points[k] = point._replace(xyz=tuple(turned[index].tolist()))
            members += [(number, k)] if tube[index] else []
    expected = naive.of_group(rings, members)
    assert expected == pytest.approx({name: described[name] for name in expected}, rel=1e-2)


def test_features_of_the_widest_group() -> None:
    """Two halves of a tube are one group at the larger reach; its features are reported."""
    drive = Drive(8, lines=12, shots=400, strays=0.0)
    tube = np.abs(drive.angle - 1.9) < 0.12
    near = 0.5 * drive.far + 0.05 * (drive.line - 6) + 0.45 * (drive.line >= 6)
    pattern = profile_pattern_of(drive.measured(np.where(tube, near, drive.far)))
    has_return = pattern.order >= 0
    of_tube = tube[pattern.order[has_return]]
    neighbours, found = prepare(pattern).near, {}
    for reach in profile.REACHES:
        segments = profile.Segments(*_kernels.find_segments(pattern, reach))
        group = _kernels.join_segments(pattern, neighbours, reach, segments)
        found[reach] = np.unique(group[segments.of[has_return]][of_tube])
        assert (found[reach] >= 0).all()
    assert [len(found[reach]) for reach in profile.REACHES] == [1, 2]
    count = profile.find_groups(pattern, neighbours)[0, has_return]
    assert_array_equal(count == np.count_nonzero(tube), of_tube)


@pytest.mark.parametrize(
    'mirror', [None, Mirror(1.9, -1, pendulum=True), Mirror(1.9, 1, pendulum=False)]
)
@pytest.mark.parametrize('lines', [3, 20])
def test_strays_are_rejected(lines: int, mirror: Mirror | None) -> None:
    """A few lines suffice to fit a turning or swinging mirror, and to reject stray points."""
    drive = Drive(10, 0.02, lines=20, shots=800, strays=0.005, mirror=mirror)
    few = drive.points.line < lines
    rejected = judge(profile_pattern_of(drive.points.take(few)), 1.0, model=PROFILE_MODEL) > 1
    assert rejected[drive.stray[few]].mean() > 0.8
    assert rejected[~drive.stray[few]].mean() < 0.002


def scores(points: Points) -> Floats:
    """Judge points by their pattern, which there must be."""
    return judge(profile_pattern_of(points), 1.0, model=PROFILE_MODEL)


def test_trees_on_mixed_pixels_judge_what_stands_off(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where they reject everything, that is what is off both returns beside it, no more."""
    model = load(PROFILE_MODEL)
    sure = Trees(
        np.zeros((1, 7), np.int32),
        np.zeros((1, 7), np.float32),
        np.full((1, 8), 50.0, np.float32),
        np.float32(0.0),
    )
    monkeypatch.setattr(pattern_trees, 'MIXED_FROM', np.float32(-np.inf))
    monkeypatch.setattr(pattern_trees, 'load_model', lambda _: model._replace(mixed=sure))
    pattern = profile_pattern_of(Drive(10, 0.02, lines=20, shots=800, strays=0.005).points)
    reason = np.zeros(np.count_nonzero(pattern.order >= 0), np.uint8)
    found = judge(pattern, 1.0, model=PROFILE_MODEL, reason=reason) > 5
    reach, between = pattern.range.tolist(), np.zeros(len(reason), np.bool_)
    for place, index in enumerate(pattern.order.tolist()):
        if index >= 0:
            off = sorted(abs(reach[place] - reach[place + k]) for k in (-1, 1))
            between[index] = off[0] > 0.02 and off[1] > 0.06
    assert 0 < between.sum() < 0.3 * len(between)
    assert_array_equal(found, between)
    assert {REASON_NAMES[number] for number in reason[between].tolist()} == {'between_surfaces'}


def test_copies_share_a_score() -> None:
    """Returns that are published twice are judged as if they were published once."""
    points = Drive(10, 0.02, lines=20, shots=800, strays=0.005).points
    twice = points.take(np.repeat(np.arange(len(points)), 2))
    assert_array_equal(scores(twice), np.repeat(scores(points), 2))


def test_later_returns_of_shots() -> None:
    """Strays are found where every twentieth shot has another return behind the first."""
    drive = Drive(10, 0.02, lines=20, shots=800, strays=0.005)
    count = len(drive.points)
    later = np.flatnonzero(np.arange(count) % 20 == 0)
    behind = drive.eye[later] + 1.3 * drive.far[later, None] * drive.beam[later]
    index = np.concatenate([np.arange(count), later])
    xyz = np.concatenate([drive.points.xyz, behind])
    for order in (np.argsort(index, kind='stable'), np.arange(len(index))):
        points = points_of(xyz[order], drive.t[index][order], drive.line[index][order])
        rejected = np.empty(len(index), np.bool_)
        rejected[order] = scores(points) > 1
        assert rejected[:count][drive.stray].mean() > 0.8
        assert rejected[:count][~drive.stray].mean() < 0.002


@pytest.mark.parametrize('scanners', [2, 3])
def test_scanners_that_measure_at_once(scanners: int) -> None:
    """Each of them has the pattern that it has alone, whether or not numbers take turns."""
    drives = [Drive(10 + k, 0.02, lines=20, shots=800) for k in range(scanners)]
    parts = [
        points_of(one.points.xyz + 100.0 * k, one.t + 1_700_000 * k, one.line + 100 * k)
        for k, one in enumerate(drives)
    ]
    points = concatenate(parts)
    in_time = np.argsort(points.t, kind='stable')
    rejected = np.concatenate([scores(part) > 1 for part in parts])
    in_turn = points.line % 100 * scanners + points.line // 100
    for line in (points.line, in_turn):
        together = np.empty(len(points))
        together[in_time] = scores(replace(points, line=line).take(in_time))
        assert (rejected != (together > 1)).mean() < 1e-3
    mixed = np.random.default_rng(1).permutation(20 * scanners)[in_turn]
    assert find_profile_pattern(replace(points, line=mixed)) is None


@pytest.mark.parametrize('each', [4, 24])
def test_shots_that_share_a_time(each: int) -> None:
    """Strays are found by a coarse clock, too: angles are those at which the scanner sees them."""
    drive = Drive(10, 0.02, lines=20, shots=800, strays=0.005)
    tick = each * (PERIOD // 800)
    rejected = scores(points_of(drive.points.xyz, drive.t // tick * tick, drive.line)) > 1
    assert rejected[drive.stray].mean() > 0.8
    assert rejected[~drive.stray].mean() < 0.002


@pytest.mark.parametrize('lines', [3, 4])
def test_lines_cut_out_of_a_stream(lines: int) -> None:
    """The first line begins late, and the last one ends early."""
    drive = Drive(22, 0.1, lines=lines, shots=1000)
    kept = (drive.angle > 2.0) | (drive.line > 0)
    kept &= (drive.angle < 4.5) | (drive.line < lines - 1)
    pattern = profile_pattern_of(drive.points.take(kept))
    has_return = pattern.order >= 0
    order = np.flatnonzero(kept)[pattern.order[has_return]]
    assert np.ptp(pattern.phase[has_return] - drive.angle[order]) < 2e-3


def test_numbers_of_lines_do_not_matter() -> None:
    """Lines follow each other in time, whatever their numbers: scores are equal, bit by bit."""
    points = Drive(12, 0.1).points
    names = np.random.default_rng(3).permutation(int(points.line.max()) + 1)
    assert_array_equal(scores(replace(points, line=names[points.line])), scores(points))


def test_parameter_sensor() -> None:
    """Trees of profile scanners are used unless ``sensor`` is ``spinning``."""
    points = Drive(11, 0.1).points
    expected = judge(profile_pattern_of(points), 2.0, model=PROFILE_MODEL).astype(np.float32)
    for sensor, same in (('auto', True), ('profile', True), ('spinning', False)):
        values = {'boosted_trees.sensor': sensor, 'boosted_trees.threshold': 2.0}
        found = Chain(FilterParameters().changed(values)).judge(points)
        assert np.array_equal(found.score, expected) == same
