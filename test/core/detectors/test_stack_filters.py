# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The filters that vehicle stacks know by name: each rejects what the original removes."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from helpers.clouds import STORE
from helpers.scans import points_of
from naive import stack_filters as naive

from lidar_outlier_filter.core.annotations import Floats, Ints
from lidar_outlier_filter.core.detectors import (
    crop_box,
    dual_return,
    field_range,
    ring_outlier,
    scan_shadows,
)
from lidar_outlier_filter.core.detectors.builtin import (
    CropBox,
    DualReturn,
    FieldRange,
    RingOutlier,
    ScanShadows,
)
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.points.scan_lines import find_lines, line_starts, order_by_line
from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_filter.parameters.filter import FilterParameters, installed
from lidar_outlier_filter.recordings.bags import Recording

GAP = 1.5
# Which way the azimuth grows, and a recording of a sensor that turns like that
BAGS = {'vlp16_mrpt_mcap': -1.0, 'os0_32.bag': -1.0}


def ring(ranges: Floats, step: float = 0.2, up: float = 0.1, begin: float = 0.0) -> Floats:
    """Measure one ring, beams ``step`` degrees apart."""
    azimuth = np.radians(begin + step * np.arange(len(ranges)))
    level = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.full(len(ranges), np.tan(up))])
    xyz: Floats = np.cos(up) * ranges[:, None] * level
    return xyz


def objects(rng: np.random.Generator, count: int) -> Floats:
    """Measure surfaces of some beams each, with noise, and single points before them."""
    ranges = np.repeat(rng.uniform(2, 40, count), rng.integers(1, 9, count))[:count]
    ranges *= rng.normal(1, 0.004, count)
    return np.where(rng.uniform(size=count) < 0.1, rng.uniform(1, 40, count), ranges)


def first_turn(path: Path) -> Points:
    """Read the first cloud of a recording, sorted by line and time."""
    decoder = Decoder(FilterParameters())
    with Recording(path) as source:
        messages = (one for one in source.messages() if one[0].msgtype.endswith('PointCloud2'))
        topic, _, data = next(messages)
        points = decoder.decode(STORE.deserialize_cdr(data, topic.msgtype))
    points = points.take(points.valid)
    return points.take(order_by_line(points))


def parts(points: Points, first: Ints) -> Iterator[tuple[int, list[list[float]]]]:
    """Cut points where each part begins."""
    for begin, end in pairwise(first.tolist()):
        yield begin, points.xyz[begin:end].tolist()


def shadows(points: Points, parameters: ScanShadows) -> set[int]:
    """Return what ours rejects."""
    scores = scan_shadows.detect(points, find_lines(points, GAP), parameters)
    return set(np.flatnonzero(scores > 1).tolist())


@pytest.mark.parametrize('name', BAGS)
def test_shadows_of_recordings(recordings: Path, name: str) -> None:
    """The same points as laser_filters', segment by segment."""
    points, parameters = first_turn(recordings / 'bags' / name), ScanShadows(10.0, 2, 2)
    begins = np.flatnonzero(find_lines(points, GAP).before < 0)
    expected = set()
    for begin, line in parts(points, np.append(begins, len(points))):
        found = naive.scan_shadows(line, 10.0, 170.0, 2, 2)
        expected |= {begin + index for index in found}
    assert shadows(points, parameters) == expected
    assert len(expected) > 100


@pytest.mark.parametrize('seed', range(5))
def test_shadows_beside_missing_returns(seed: int) -> None:
    """Nothing is compared across a missing return, which is nan there and not given here."""
    rng = np.random.default_rng(seed)
    xyz = ring(objects(rng, 400))
    given = rng.uniform(size=400) < 0.9
    given[1::40] = given[2::40] = True  # times tell the interval
    points = points_of(xyz, np.arange(400) * 1000).take(given)
    whole = np.where(given[:, None], xyz, np.nan).tolist()
    expected = naive.scan_shadows(whole, 10.0, 170.0, 1, 1)
    assert {int(np.flatnonzero(given)[i]) for i in shadows(points, ScanShadows())} == expected
    assert len(expected) > 20


def test_shadows_keep_and_find() -> None:
    """A mixed pixel and the first point behind it go; a wall seen at 20 degrees stays."""
    edge = np.array([5.0] * 5 + [8.0] + [20.0] * 5)
    assert shadows(points_of(ring(edge), np.arange(11) * 1000), ScanShadows()) == {5, 6}
    y = np.arange(20) * 0.01
    wall = np.column_stack([y / np.tan(np.radians(20.0)) + 30.0, y, np.zeros(20)])
    points = points_of(wall, np.arange(20) * 1000)
    assert not shadows(points, ScanShadows())
    assert len(shadows(points, ScanShadows(min_angle=21.0))) > 10


def test_returns_of_one_shot_are_no_shadows() -> None:
    """Each has the other straight behind it."""
    xyz = np.repeat(ring(np.full(9, 5.0)), 2, axis=0)
    xyz[9] *= 2.0
    t = np.repeat(np.arange(9), 2) * 1000
    rejected = shadows(points_of(xyz, t), ScanShadows())
    assert rejected == {9}  # by the beam beside it
    assert not shadows(points_of(xyz[8:10], t[8:10]), ScanShadows())


@pytest.mark.parametrize('name', BAGS)
def test_walks_of_recordings(recordings: Path, name: str) -> None:
    """The same points as Autoware's, ring by ring."""
    points = first_turn(recordings / 'bags' / name)
    first, expected = line_starts(points.line), set()
    for begin, line in parts(points, first):
        expected |= {begin + i for i in naive.ring_outlier(line, 1.03, 0.1, 4, BAGS[name])}
    rejected = ring_outlier.detect(points, first, RingOutlier()) > 1
    assert set(np.flatnonzero(rejected).tolist()) == expected
    assert len(expected) > 100


@pytest.mark.parametrize('count', [1, 2, 5, 300, 1800])
def test_walks_of_closed_rings(count: int) -> None:
    """With 1800 beams the last one is beside the first; several rings, of which one is short."""
    rng = np.random.default_rng(count)
    rings = [ring(objects(rng, count), begin=rng.uniform(0, 9)), ring(np.array([3.0]))]
    rings[0][-3:] *= np.linalg.norm(rings[0][0]) / np.linalg.norm(rings[0][-3:], axis=1)[:, None]
    xyz, first = np.concatenate(rings), np.array([0, count, count + 1])
    for length, most in ((0.1, 4), (0.03, 1), (0.5, 9)):
        parameters = RingOutlier(length, 1.03, most)
        score = ring_outlier.detect(points_of(xyz), first, parameters)
        expected = naive.ring_outlier(rings[0].tolist(), 1.03, length, most, 1.0) | {count}
        assert set(np.flatnonzero(score > 1).tolist()) == expected


def test_a_walk_by_hand() -> None:
    """Two points 0.14 m apart score 0.1 / 0.14; a single one has no length; surfaces score 0."""
    ranges = np.array([8.0] * 6 + [4.0, 4.0] + [8.0] * 6 + [2.0])
    score = ring_outlier.detect(points_of(ring(ranges, step=2.0)), np.array([0, 15]), RingOutlier())
    assert np.isinf(score).all()  # all gaps are wider than a degree
    xyz = ring(ranges, step=0.9, up=0.0)
    score = ring_outlier.detect(points_of(xyz), np.array([0, 15]), RingOutlier())
    assert score[6:8] == pytest.approx(0.1 / (2 * 4.0 * np.sin(np.radians(0.45))))
    assert score[14] == np.inf
    assert not score[:6].any()


@pytest.mark.parametrize('seed', range(4))
def test_early_returns(seed: int) -> None:
    """The same points as by loops, where shots have one, two or three returns."""
    rng = np.random.default_rng(seed)
    ranges, hit = objects(rng, 1800), rng.uniform(size=1800) < 0.3
    near = np.where(rng.uniform(size=1800) < 0.7, 2.0, rng.uniform(1, 2, 1800))
    shots = [
        [r / 2, *([] if n < 1.5 else [0.75 * r]), r] if h and n < 1.7 else [n, r + 2] if h else [r]
        for r, h, n in zip(ranges, hit, near, strict=True)
    ]
    count = np.array([len(shot) for shot in shots])
    flat = np.concatenate([np.array(shot) for shot in shots])
    beam = ring(np.ones(1800))[np.repeat(np.arange(1800), count)]
    xyz = (beam * flat[:, None]).astype(np.float32).astype(np.float64)
    found = dual_return.detect(points_of(xyz), np.array([0, len(xyz)]), DualReturn(1.03))
    parts = [part.tolist() for part in np.split(xyz, np.cumsum(count)[:-1])]
    expected = naive.dual_return(parts, 1.03, 1.0)
    assert set(np.flatnonzero(found > 1).tolist()) == expected
    assert 50 < len(expected) < len(xyz) - 1800 - 50


def test_edges_are_kept() -> None:
    """The beam at an edge hits object and background; a drop in front of a wall is alone."""
    near, far = ring(np.full(9, 5.0)), ring(np.full(9, 20.0))
    xyz = np.concatenate([near[:5], far[4:6], 0.2 * far[6:7], far[6:]])
    score = dual_return.detect(points_of(xyz), np.array([0, len(xyz)]), DualReturn())
    assert np.flatnonzero(score > 1).tolist() == [7]


def test_returns_of_two_shots_of_three_each() -> None:
    """The first return of one shot is compared with the last of the next, five returns behind."""
    beams, ranges = [0, 1, 2, 3, 3, 3, 4, 4, 4, 5, 6], [9, 9, 9, 5, 7, 9, 1, 2, 5.02, 9, 9]
    xyz = ring(np.ones(7))[beams] * np.array(ranges)[:, None]
    score = dual_return.detect(points_of(xyz), np.array([0, len(xyz)]), DualReturn())
    assert np.flatnonzero(score > 1).tolist() == [4, 6, 7]


def test_copies_are_no_early_returns() -> None:
    """Sensors send a return twice that is the strongest and the last; nothing is behind it."""
    xyz = np.repeat(ring(np.full(9, 5.0)), 2, axis=0)
    assert not dual_return.detect(points_of(xyz), np.array([0, 18]), DualReturn()).any()


@pytest.mark.parametrize('negative', [False, True])
def test_boxes(negative: bool) -> None:  # noqa: FBT001
    """The same points as PCL's, those at a limit included; ranges are rejected with both."""
    xyz = np.random.default_rng(1).integers(-5, 6, (900, 3)).astype(np.float64)
    low, high = (-2.0, -3.0, -1.0), (3.0, 2.0, 4.0)
    names = ('min_x', 'min_y', 'min_z', 'max_x', 'max_y', 'max_z')
    box = dict(zip(names, (*low, *high), strict=True))
    score = crop_box.detect(xyz, CropBox(**box, negative=negative))
    expected = naive.crop_box(xyz.tolist(), low, high, negative=negative)
    assert set(np.flatnonzero(score > 1).tolist()) == expected
    assert 100 < len(expected) < 800
    score = crop_box.detect(xyz, CropBox(min_range=3.0, max_range=5.0))
    reach = np.linalg.norm(xyz, axis=1)
    np.testing.assert_array_equal(score > 1, (reach < 3) | (reach > 5))


@pytest.mark.parametrize(
    ('low', 'high', 'refusal'),
    [
        ('crop_box.min_x', 'crop_box.max_x', 'crop_box.min_x must be below crop_box.max_x = 1 m'),
        ('field_range.min_range', 'field_range.max_range', 'must be below .*max_range = 1 m'),
        (
            'field_range.min_value',
            'field_range.max_value',
            'must be at most .*max_value = 1, got 2',
        ),
    ],
)
def test_limits_with_nothing_between(low: str, high: str, refusal: str) -> None:
    """They are refused."""
    with pytest.raises(ParameterError, match=refusal):
        FilterParameters().changed({low: 2.0, high: 1.0})


@pytest.mark.parametrize('seed', range(3))
def test_bounds_in_a_band(seed: int) -> None:
    """The same points as by loops, at limits and beyond; NaN and Inf are untested."""
    rng = np.random.default_rng(seed)
    values, reach = rng.integers(-4, 5, 900).astype(float), rng.integers(1, 9, 900).astype(float)
    values[::40], values[7::90], values[8::90] = np.nan, np.inf, -np.inf
    own = FieldRange(min_range=2.0, max_range=6.0, min_value=-2.0, max_value=1.0)
    score = field_range.detect(values, reach, own)
    removed, untested = naive.field_range(values.tolist(), reach.tolist(), (2, 6), (-2, 1))
    assert set(np.flatnonzero(score > 1).tolist()) == removed
    assert set(np.flatnonzero(np.isnan(score)).tolist()) == untested
    assert 100 < len(removed) < 500
    assert not (field_range.detect(values, reach, FieldRange()) > 1).any()


def test_one_field(monkeypatch: pytest.MonkeyPatch) -> None:
    """Points carry one field: a chain whose detectors read two is refused."""
    known = installed().detectors
    monkeypatch.setitem(known, 'sor', replace(known['sor'], field=lambda _: 'signal'))
    FilterParameters().changed({'chain': ['sor', 'field_range'], 'field_range.field': 'signal'})
    with pytest.raises(ParameterError, match='must be of detectors that read one field'):
        FilterParameters().changed({'chain': ['sor', 'field_range']})
