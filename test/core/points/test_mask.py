# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The mask of the own vehicle: what it covers, its file, and how it is learnt."""

from pathlib import Path

import numpy as np
import pytest
from helpers.own_vehicle import turn
from naive.mask import find_masked

from lidar_outlier_filter.core.annotations import Rows
from lidar_outlier_filter.core.points import mask as masks
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.errors import CloudError, ParameterError


def points_of(rows: Rows) -> Points:
    """Take all for valid points."""
    xyz = np.stack([rows[axis].astype(np.float64) for axis in 'xyz'], axis=1)
    line = rows['ring'].astype(np.int64)
    return Points(xyz, rows['t'].astype(np.int64), line, np.ones(len(rows), np.bool_))


def drawn(seed: int) -> tuple[masks.Mask, Points, dict[tuple[int, int], tuple[float, float]]]:
    """Draw a mask, and points many of which lie at its edges."""
    rng = np.random.default_rng(seed)
    cells: dict[tuple[int, int], tuple[float, float]] = {}
    for _ in range(700):
        near, ring, first = float(rng.integers(1, 8)), int(rng.integers(0, 4)), rng.integers(0, 720)
        for column in range(first, first + 3):
            cells[ring, int(column) % 720] = near, near + float(rng.integers(0, 2))
    mask = masks.Mask.nothing(4)
    for cell, (near, far) in cells.items():
        mask.near[cell], mask.far[cell] = near, far
    count = 3000
    azimuth = np.radians(rng.integers(-360, 361, count) / 2.0)
    ranges = rng.integers(1, 10, count) + rng.choice([-0.25, 0.0, 0.25, 1e-9, 0.3], count)
    xyz = np.stack([ranges * np.cos(azimuth), ranges * np.sin(azimuth), np.zeros(count)], axis=1)
    line = rng.integers(-1, 6, count)
    xyz[:5] = (0, 0, 0), (-1, -0.0, 0), (-2, 0.0, 0), (3, -1e-300, 0), (0, 0, 4)
    points = Points(xyz, np.zeros(count, np.int64), line, rng.random(count) < 0.9)
    return mask, points, cells


@pytest.mark.parametrize('seed', range(3))
def test_covers_as_the_naive_twin(seed: int) -> None:
    """Ranges at the tolerance count; rings that the mask has not, and missing returns, do not."""
    mask, points, cells = drawn(seed)
    found = mask.covers(points, 0.25)
    given = points.xyz.tolist(), points.line.tolist(), points.valid.tolist()
    on_vehicle, in_shadow = find_masked(*given, cells, 0.25)
    assert found.tolist() == on_vehicle
    assert 50 < found.sum() < len(points)
    behind = mask.with_shadow.covers(points, 0.25) & ~found
    assert behind.tolist() == in_shadow
    assert 50 < behind.sum() < len(points)


def test_file_says_all_of_a_mask(tmp_path: Path) -> None:
    """A mask is read as it was written, to the millimetre."""
    mask, *_ = drawn(1)
    path = tmp_path / 'car.csv'
    path.write_text(masks.as_text(mask))
    again = masks.read_mask(path)
    np.testing.assert_array_equal(again.near, mask.near)
    np.testing.assert_array_equal(again.far, mask.far)
    path.write_text(masks.as_text(masks.Mask.nothing(3)))
    assert masks.read_mask(path).near.shape == (0, masks.COLUMNS)


GOOD = f'{masks.HEAD}\n{masks.MASK_COLUMNS}\n'


@pytest.mark.parametrize(
    ('content', 'sentence'),
    [
        (None, 'a readable file, got "No such file'),
        (b'\xff\xfe', 'bytes that are no text'),
        (b'ring,column,near,far\n', 'one that begins with'),
        (f'{GOOD}1,2,3,4\n1,2,x,4\n', 'line 4 '),
        (f'{GOOD}1024,2,3,4\n', 'a ring below 1024'),
        (f'{GOOD}1,720,3,4\n', 'a column below 720'),
        (f'{GOOD}1,2,4,3\n', 'the nearer first'),
        (f'{GOOD}1,2,3,1e9\n', 'up to 100 m'),
        (f'{GOOD}1,2,3,4\n1,2,3,4\n', 'another cell'),
        (f'{GOOD}{"0," * 2000}\n', 'line 3 '),
        (GOOD + '1,2,3,4\n' * 4_000_001, 'at most 32000000 bytes'),
    ],
)
def test_hostile_files_are_refused(
    content: str | bytes | None, sentence: str, tmp_path: Path
) -> None:
    """A file that holds no mask costs a sentence, and no more."""
    path = tmp_path / 'mask.csv'
    if content is not None:
        path.write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(ParameterError, match=sentence.replace('(', r'\(')):
        masks.read_mask(path)


def test_learns_the_vehicle_and_not_the_road() -> None:
    """The road stays where it is, too, under a vehicle that goes straight on; it is no vehicle."""
    learner = masks.MaskLearner(10.0)
    for number in range(12):
        assert learner.add(points_of(turn(number)))
    mask = learner.learn()
    unseen = turn(99)
    found = mask.covers(points_of(unseen), 0.1)
    np.testing.assert_array_equal(found, unseen['own'] == 1)
    assert 0.9 < found.sum() / (10 * 40) <= 1.1
    assert 1.4 < mask.near.min() < mask.far.max() < 1.61


def test_learns_for_hours() -> None:
    """At 10 turns a second, 65 536 of them take less than two hours."""
    learner = masks.MaskLearner(10.0)
    for number in range(4):
        learner.add(points_of(turn(number)))
    short = learner.learn()
    learner.taken *= 40_000
    learner._returns *= 40_000
    learner._hits *= 40_000
    np.testing.assert_array_equal(learner.learn().near, short.near)
    assert short.is_seen.any()


@pytest.mark.parametrize('kind', ['at other ranges', 'in too few turns'])
def test_what_passes_by_is_no_vehicle(kind: str) -> None:
    """What is there in two turns of twelve, or at one of three ranges in each, does not stay."""
    learner = masks.MaskLearner(20.0)
    for number in range(12):
        rows = turn(number)
        passing = rows['ring'] == 14
        reach = 3 + number % 3 if kind == 'at other ranges' else 3
        scale = reach / np.linalg.norm([rows[a][passing] for a in 'xyz'], axis=0)
        for axis in 'xyz':
            rows[axis][passing] *= scale
        learner.add(points_of(rows if kind == 'at other ranges' or number < 2 else rows[~passing]))
    assert not learner.learn().is_seen[14].any()


def test_noise_across_bins() -> None:
    """A vehicle whose range varies by 5 cm is in no bin of ranges in half of the turns."""
    learner = masks.MaskLearner(10.0)
    for number in range(12):
        rows = turn(number)
        own = rows['own'] == 1
        for axis in 'xyz':
            rows[axis][own] *= (1.475, 1.525, 1.575)[number % 3] / 1.5
        learner.add(points_of(rows))
    unseen = turn(99)
    covered_share = learner.learn().covers(points_of(unseen), 0.1)[unseen['own'] == 1].mean()
    assert covered_share > 0.95


def test_turns_from_one_position_do_not_count() -> None:
    """A vehicle that stands learns nothing, though all stays where it is."""
    learner = masks.MaskLearner(10.0)
    assert [learner.add(points_of(turn(n, place=0))) for n in range(5)] == [True] + [False] * 4
    assert (learner.turns, learner.taken) == (5, 1)
    # Odometry counts before the scene: a road through a desert shows no change.
    there = masks.MaskLearner(10.0)
    taken = [
        there.add(points_of(turn(n, place=0)), np.array([0.4 * n, 0.0, 0.0])) for n in range(8)
    ]
    assert taken == [True, False, False, True, False, False, True, False]


def test_nothing_is_learnt_of_nothing() -> None:
    """Without points there is no mask; a line that is no ring is refused."""
    assert masks.MaskLearner(10.0).learn().near.shape == (0, masks.COLUMNS)
    learner = masks.MaskLearner(10.0)
    assert not learner.add(points_of(turn(0)[:0]))
    rows = turn(0)
    rows['ring'][7] = 1024
    with pytest.raises(CloudError, match='the ring of a point must be from 0 to 1023, got 1024'):
        learner.add(points_of(rows))
