# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What a sensor sees: fog of a known visibility, dirt on a sector, and a clean street."""

import math

import numpy as np
import pytest
from helpers.scans import points_of

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.engine.stream_cloud import StreamCloud
from lidar_outlier_filter.parameters.node import HealthLimits
from lidar_outlier_filter.pipeline import visibility as sight

LIMITS = HealthLimits()
WEAKEST = 1.2e-5  # echo that is detected, as reflectance ÷ m²


def street(seed: int, visibility: float = math.inf) -> Floats:
    """Give the returns of a turn (N, 4), x, y, z and ring: a road, and walls at all ranges.

    A return is one whose echo, weakened by the fog on both ways, is strong enough.
    """
    rng = np.random.default_rng(seed)
    ring, azimuth = (a.reshape(-1) for a in np.mgrid[0:32, 0:720])
    turned = np.radians(azimuth / 2 + rng.uniform(0, 0.5))
    up = np.radians(-25 + ring)
    # Walls stand where they stand for a while; the vehicle passes them slowly.
    walls = 6 + 110 * np.random.default_rng(9).random((8, 72))[ring // 4, azimuth // 10]
    distance = np.where(up < 0, np.minimum(1.8 / np.maximum(np.sin(-up), 1e-3), walls), walls)
    distance = distance * (1 + rng.normal(0, 0.002, len(ring)))
    bright = rng.uniform(0.1, 0.6, len(ring))
    echo = bright * np.exp(-2 * (3 / visibility) * distance) / distance**2
    level = distance * np.cos(up)
    xyz = level * np.cos(turned), level * np.sin(turned), distance * np.sin(up)
    return np.asarray(np.stack([*xyz, ring], axis=1)[echo >= WEAKEST])


def judged(rows: Floats, rejected: slice = slice(0)) -> StreamCloud:
    """Make a judged cloud."""
    made = StreamCloud(points_of(rows[:, :3].copy(), line=rows[:, 3].astype(np.int64)))
    made.verdict.rejected[rejected] = True
    return made


def watched(*turns: Floats, has_rings: bool = True) -> list[sight.SensorView]:
    """Take a sample for each turn."""
    watch, found = sight.SensorWatch(), []
    for rows in turns:
        watch.add(judged(rows), has_rings=has_rings)
        view = watch.sample(LIMITS)
        assert view is not None
        found.append(view)
    return found


CLEAR = [street(number) for number in range(20)]


def azimuth(rows: Floats) -> Floats:
    """Give azimuths, degrees, from 0 to 360."""
    return np.asarray(np.degrees(np.arctan2(rows[:, 1], rows[:, 0])) % 360)


def test_clean_streets_are_no_reason_to_warn() -> None:
    """Nothing is missing of what is usual, which is known after a while."""
    views = watched(*CLEAR)
    assert all(view.complaints(LIMITS) == [] for view in views)
    assert all(math.isnan(view.visibility) for view in views[: sight.MIN_SAMPLES])
    assert all(view.visibility == math.inf for view in views[sight.MIN_SAMPLES :])
    assert all(np.nanmax(view.no_return) < 0.1 for view in views[sight.MIN_SAMPLES :])
    assert np.isnan(views[0].no_return).all()


@pytest.mark.parametrize('visibility', [15.0, 25.0, 50.0, 100.0])
def test_fog_of_known_visibility(visibility: float) -> None:
    """The estimate is right within a factor of two; below the limit it is a warning."""
    view = watched(*CLEAR, street(99, visibility))[-1]
    assert visibility / 2 < view.visibility < 2 * visibility
    said = ' '.join(view.complaints(LIMITS))
    assert ('the visibility is' in said) == (view.visibility < LIMITS.visibility)
    assert (view.visibility < LIMITS.visibility) or visibility > 25
    assert 'dirt' not in said


def test_fog_stays_a_warning() -> None:
    """What is usual does not follow while something is wrong."""
    views = watched(*CLEAR, *(street(100 + number, 20.0) for number in range(70)))
    assert all('the visibility' in ' '.join(view.complaints(LIMITS)) for view in views[20:])


@pytest.mark.parametrize(('first', 'last'), [(90, 105), (30, 75), (345, 360)])
def test_dirt_on_a_sector(first: int, last: int) -> None:
    """A sector without returns is blind, and named; the fog is not to blame."""
    rows = street(99)
    dirty = rows[~((azimuth(rows) >= first) & (azimuth(rows) < last))]
    view = watched(*CLEAR, dirty)[-1]
    assert np.flatnonzero(view.no_return > 0.5).tolist() == list(range(first // 15, last // 15))
    (said,) = view.complaints(LIMITS)
    assert f'{first}° to {first + 15}°' in said
    assert view.visibility == math.inf


def test_narrower_scenes_are_no_fog() -> None:
    """Where walls come near, all beams return, and from nearer."""
    rows = street(99)
    near = rows.copy()
    near[:, :3] *= np.minimum(1, 12 / np.linalg.norm(rows[:, :3], axis=1))[:, np.newaxis]
    assert watched(*CLEAR, near)[-1].complaints(LIMITS) == []


def test_rejected_by_sector_and_range() -> None:
    """Shares are of the points there; nothing of nothing is no share."""
    rows = np.array([[1.0, 0.1, 0, 0], [1, 0.1, 0, 0], [0.1, 20, 0, 0], [0, -7, 0, 1]])
    watch = sight.SensorWatch()
    watch.add(judged(rows, slice(1, 3)), has_rings=True)
    view = watch.sample(LIMITS)
    assert view is not None
    expected = np.full((sight.SECTORS, len(sight.BANDS)), np.nan)
    expected[0, 0], expected[5, 2], expected[18, 1] = 0.5, 1.0, 0.0
    np.testing.assert_array_equal(view.rejected, expected)
    assert len(view.plotted()) == len(sight.VIEWED) == len(sight.UNSEEN)
    assert watch.sample(LIMITS) is None


def test_limits_can_be_set() -> None:
    """Limits of 1 and 0 never warn."""
    rows = street(99, 20.0)
    view = watched(*CLEAR, rows[azimuth(rows) > 30])[-1]
    assert view.complaints(HealthLimits(blind=1.0, visibility=0.0)) == []
    assert len(view.complaints(LIMITS)) == 2


def test_without_rings_and_without_points() -> None:
    """Clouds without rings are one sample; empty ones are samples without effect."""
    assert watched(*CLEAR, has_rings=False)[-1].complaints(LIMITS) == []
    nothing = np.zeros((0, 4))
    views = watched(nothing, *CLEAR, nothing)
    assert views[0].complaints(LIMITS) == []
    assert 'dirt' in ' '.join(views[-1].complaints(LIMITS))


@pytest.mark.parametrize(('usual', 'dirty', 'count'), [(0.6, 0.6, 0), (0.6, 1.0, 0), (0.3, 0.9, 1)])
def test_fog_is_not_taken_for_dirt(usual: float, dirty: float, count: int) -> None:
    """What most sectors miss is the fog; a sector is blind by what it misses beyond that."""
    no_return = np.full(sight.SECTORS, usual)
    no_return[7] = dirty
    view = sight.SensorView(np.zeros((sight.SECTORS, len(sight.BANDS))), no_return, 20.0)
    said = view.complaints(LIMITS)
    assert said[0] == 'the visibility is 20 m'
    assert [one.count('°') for one in said[1:]] == [2] * count
    assert all('105° to 120°' in one for one in said[1:])


def test_missing_clouds_are_no_dirt() -> None:
    """Where packets are lost, or a recording starts again, sectors have fewer returns."""
    watch = sight.SensorWatch()

    def sample(rows: Floats, *, is_whole: bool) -> sight.SensorView:
        watch.add(judged(rows), has_rings=True)
        view = watch.sample(LIMITS, is_whole=is_whole)
        assert view is not None
        return view

    for rows in CLEAR:
        sample(rows, is_whole=True)
    lost = CLEAR[0][np.abs(azimuth(CLEAR[0]) - 225) > 20]
    for _ in range(30):
        view = sample(lost, is_whole=False)
        assert view.complaints(LIMITS) == []
        assert np.isnan(view.no_return).all()
        assert math.isnan(view.visibility)
    # Nothing was learnt meanwhile.
    assert 'dirt on the window at 210° to 225°' in sample(lost, is_whole=True).complaints(LIMITS)[0]
    assert sample(CLEAR[1], is_whole=True).complaints(LIMITS) == []
