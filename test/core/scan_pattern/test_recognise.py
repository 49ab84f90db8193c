# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A sensor is recognised in any frame, without its rings, and whatever its rows and times claim."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from helpers.scans import TURN_NS, Drive, sweep

from lidar_outlier_filter import CloudFilter, detect_outliers
from lidar_outlier_filter.core.annotations import Bools
from lidar_outlier_filter.core.detectors.boosted_trees.methods import Method, choose, detect
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.points.points import Points, concatenate
from lidar_outlier_filter.core.points.scan_lines import order_by_line
from lidar_outlier_filter.core.scan_pattern.recognise import (
    Kept,
    SensorKind,
    recognise,
    ring_spread,
    rows_are_columns,
    share_rings,
)
from lidar_outlier_filter.core.scan_pattern.steady_times import with_steady_times
from lidar_outlier_filter.parameters.filter import FilterParameters

UP = np.linspace(-15.0, 15.0, 16).tolist()


def turn(seed: int = 1, turns: float = 1.0) -> Points:
    """Return a sweep of 16 rings in order of firing."""
    points = sweep(seed, 0.02, turns, columns=600, elevations=UP)
    return points.take(np.argsort(points.t, kind='stable'))


def rejected(points: Points) -> Bools:
    """Judge a block of a stream."""
    parameters = FilterParameters()
    seen = DetectorInput(points, parameters)
    found: Bools = detect(seen, parameters).score > 1
    return found


@pytest.mark.parametrize(
    'change',
    [
        lambda p: replace(p, xyz=p.xyz + np.array([0.0, 0.0, 10.0])),
        lambda p: replace(p, xyz=p.xyz + np.array([450e3, 5400e3, 110.0])),
        lambda p: replace(p, xyz=p.xyz + np.array([1e5, 0.0, 0.0])),
        lambda p: replace(p, line=0 * p.line),
        lambda p: replace(p, line=0 * p.line, t=np.arange(len(p))),
    ],
    ids=['raised', 'utm', '100 km', 'no rings', 'no rings nor times'],
)
def test_claims_that_geometry_contradicts(change: Callable[[Points], Points]) -> None:
    """In another frame, or without rings, nearly every verdict is that of the sensor's own."""
    points = turn()
    expected, found = rejected(points), rejected(change(points))
    assert expected.sum() > 300
    assert (found == expected).mean() > 0.998
    recognised = recognise(change(points), 'auto')
    assert recognised is not None
    assert recognised.kind is SensorKind.SPINNING


def test_spread_shows_where_beams_leave() -> None:
    """Seen from the sensor rings have one elevation; from above, or from afar, none has."""
    points = turn()
    order = order_by_line(points)
    assert ring_spread(points, order) < 0.01
    for away in ([0.0, 0.0, 5.0], [450e3, 5400e3, 0.0], [40.0, 0.0, 0.0]):
        assert ring_spread(replace(points, xyz=points.xyz + away), order) > 0.5
    lines = Drive(3, 0.0).points
    assert ring_spread(lines, order_by_line(lines)) == np.inf


@pytest.mark.parametrize('behind', [0, 3_141_592])
def test_two_sensors_that_share_ring_numbers_are_named(behind: int) -> None:
    """Whether they measure at the same times or not; one sensor is none, in whatever frame."""
    one = turn()
    beside = replace(one, xyz=one.xyz + np.array([0.5, -2.0, 0.0]), t=one.t + behind)
    both = concatenate([replace(one, xyz=one.xyz + np.array([0.5, 1.0, 0.0])), beside])
    both = both.take(np.argsort(both.t, kind='stable'))
    assert recognise(both, 'auto') is None
    assert share_rings(both)
    parameters = FilterParameters()
    method, _ = choose(DetectorInput(both, parameters), parameters)
    assert method is Method.SHARED
    assert ', because ' in method.value  # which is a warning
    for moved in (0.0, 20.0, 450e3):
        assert not share_rings(replace(one, xyz=one.xyz + moved))
    two_returns = concatenate([one, replace(one, xyz=1.2 * one.xyz)])
    assert not share_rings(two_returns)


def test_sweeps_that_come_ring_by_ring_are_turns_of_their_own() -> None:
    """Without rings and times: neither the order nor the sweep before is taken for neighbours."""
    rng, expected, parts = np.random.default_rng(1), [], []
    for k in range(2):
        one = turn(1 + k)
        # Near returns seem to be of another ring: here the order of some is another.
        some = rng.permutation(len(one))[: len(one) // 20]
        place = np.arange(len(one))
        place[some] = np.roll(some, 1)
        line, t = one.line[place], one.t[place]
        by_ring = one.take(np.lexsort((t, line)))
        expected.append(rejected(replace(by_ring, line=0 * by_ring.line, t=0 * by_ring.t)))
        counted = k * TURN_NS + 100 * np.arange(len(one))
        parts.append(replace(by_ring, line=0 * by_ring.line + k, t=counted))
    np.testing.assert_array_equal(rejected(parts[0]), expected[0])
    np.testing.assert_array_equal(rejected(concatenate(parts)), np.concatenate(expected))


def test_sweeps_that_have_their_stamp_only_are_turns_of_their_own() -> None:
    """Where the times of all points of a message are equal, two messages are not one turn."""
    sweeps = []
    for k in range(2):
        one = turn(1 + k)
        one = one.take(one.t < 0.4 * TURN_NS)  # half of what is around is sky
        sweeps.append(replace(one, t=0 * one.t + k * TURN_NS, xyz=one.xyz * (1.0 + 0.1 * k)))
    expected = np.concatenate([rejected(one) for one in sweeps])
    np.testing.assert_array_equal(rejected(concatenate(sweeps)), expected)


def test_known_rings_are_not_sought_again() -> None:
    """A stream keeps its rings; one that has none for three blocks is asked no more."""
    kept, points = Kept(), turn()
    rings = kept.find_rings(points.xyz)
    assert rings is not None
    assert kept.find_rings(turn(2).xyz) is rings
    noise = np.random.default_rng(1).normal(0.0, 5.0, (4000, 3))
    assert [kept.find_rings(noise) for _ in range(4)] == [None] * 4
    assert kept.misses == 3
    assert kept.find_rings(points.xyz) is rings


@pytest.mark.parametrize('up', [0.0, 40.0])
def test_rows_may_be_columns(up: float) -> None:
    """Rows of shots at one azimuth are columns of a sweep, whose verdicts do not depend on it."""
    points = sweep(1, 0.0, columns=600, elevations=UP)
    image = np.empty((600, 16, 3))
    image[points.t * 600 // TURN_NS, points.line] = points.xyz + np.array([0.0, 0.0, up])
    valid = np.ones((600, 16), np.bool_)
    valid[::7, 3] = False
    assert rows_are_columns(image, valid)
    assert not rows_are_columns(image.transpose(1, 0, 2), valid.T)
    assert not rows_are_columns(image[:, :2], valid[:, :2])
    cloud = np.zeros(image.shape[:2], [(axis, 'f4') for axis in 'xyz'])
    for k, axis in enumerate('xyz'):
        cloud[axis] = image[..., k]
    found = [
        np.concatenate([part.outliers for part in stream.push(each, stamp=0) + stream.flush()])
        for each, stream in ((cloud, CloudFilter({})), (cloud.T.copy(), CloudFilter({})))
    ]
    assert 0 < len(found[0]) < 0.1 * cloud.size
    assert set(found[0].tolist()) == set(found[1].tolist())
    assert detect_outliers(cloud).outlier.sum() < 0.1 * cloud.size


def test_jitter_of_stamps() -> None:
    """Eighths of a sweep, one of them 15 ms early, get the times that azimuths show."""
    points = turn(3, 1.5)
    early = points.t * 8 // TURN_NS == 4
    shaken = replace(points, t=points.t - 15_000_000 * early)
    assert with_steady_times(points, order_by_line(points)) is points
    steady = with_steady_times(shaken, order_by_line(shaken))
    behind = steady.t - points.t
    assert np.ptp(behind[np.abs(behind - np.median(behind)) < 2_000_000]) < 3_000_000
    assert (np.abs(behind - np.median(behind)) < 2_000_000).mean() > 0.999
    assert (rejected(shaken) == rejected(points)).mean() > 0.998
