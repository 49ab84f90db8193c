# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Injected outliers: as many and as far as said, of both classes, seeded, and nothing else."""

import numpy as np
import pytest
from helpers.scans import points_of

from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation.truth import Cause
from lidar_outlier_filter.tuning.inject import Injection, inject

SECOND = 1_000_000_000


def road(clouds: int = 20, count: int = 2000, seed: int = 3) -> list[Points]:
    """Make clouds of a flat road, 0.1 s each, 1 m of driving."""
    rng = np.random.default_rng(seed)
    made = []
    for i in range(clouds):
        xyz = rng.uniform((i, -10, 0), (i + 1, 10, 0.01), (count, 3))
        t = i * SECOND // 10 + np.arange(count) * (SECOND // 10 // count)
        line = np.arange(count) // 100
        made.append(points_of(xyz, t, line))
    return made


def test_shares_and_distances() -> None:
    """Half are in clusters of 2 to 30 neighbours; all are as far as said, clusters twice as far."""
    before = road()
    after, code = inject(before, Injection(share=0.01, distance=(2.0, 50.0)))
    assert np.count_nonzero(code != Cause.GOOD) == 400
    clustered = np.flatnonzero(code == Cause.CLUSTER)
    assert 200 - 1 <= len(clustered) <= 200
    old = np.concatenate([cloud.xyz for cloud in before])
    new = np.concatenate([cloud.xyz for cloud in after])
    moved = np.linalg.norm(new - old, axis=1)
    single = code == Cause.SINGLE
    assert 2 <= moved[single].min() < 3.5
    assert moved[single].max() <= 50
    # Uniform between the limits, but for positions that are too near to others.
    assert 20 < moved[single].mean() < 32
    starts = np.flatnonzero(np.diff(clustered, prepend=-9) > 1)
    assert moved[clustered[starts]].min() > 3.5
    runs = np.split(clustered, starts[1:])
    assert len({run[0] // 2000 for run in runs}) > 3
    for run in runs:
        assert run[0] // 2000 == run[-1] // 2000
        # Two clusters may begin where another ends.
        if len(run) <= 30:
            assert np.linalg.norm(new[run] - new[run].mean(axis=0), axis=1).max() < 2


def test_far_from_all_that_is_seen_with_it() -> None:
    """From every good point up to a window away in time, whichever cloud that is in."""
    for spacing in (1, 3):
        made, code = inject(road(12)[::spacing], Injection(share=0.02, distance=(1.0, 4.0)))
        xyz = np.concatenate([cloud.xyz for cloud in made])
        t = np.concatenate([cloud.t for cloud in made])
        good = code == Cause.GOOD
        for k in np.flatnonzero(~good):
            seen = xyz[good & (np.abs(t - t[k]) <= SECOND // 5)]
            assert np.linalg.norm(seen - xyz[k], axis=1).min() >= 1.0


def test_nothing_else_changes() -> None:
    """Good points, times, lines and the order stay; what was given is not touched."""
    before = road()
    copies = [cloud.xyz.copy() for cloud in before]
    after, code = inject(before, Injection(share=0.01))
    assert [len(cloud) for cloud in after] == [2000] * 20
    good = np.split(code == Cause.GOOD, 20)
    for old, copy, new, mask in zip(before, copies, after, good, strict=True):
        np.testing.assert_array_equal(old.xyz, copy)
        np.testing.assert_array_equal(new.xyz[mask], copy[mask])
        assert (new.xyz[~mask] != copy[~mask]).all()
        for name in ('t', 'line', 'valid'):
            np.testing.assert_array_equal(getattr(new, name), getattr(old, name))


def test_little_and_empty_clouds() -> None:
    """Empty clouds are no targets; a few points get one outlier, which is single."""
    nothing = road(1, 2)[0].take(np.zeros(2, np.bool_))
    clouds, code = inject([nothing, *road(1, 100), nothing], Injection(share=0.01))
    assert [len(cloud) for cloud in clouds] == [0, 100, 0]
    assert sorted(code)[-2:] == [Cause.GOOD, Cause.SINGLE]
    # Clouds of one point have no neighbours for a cluster.
    alone = road(200, 1)
    _, code = inject(alone, Injection(share=0.1))
    assert np.count_nonzero(code == Cause.SINGLE) == 20


def test_refusals() -> None:
    """Shares and distances that make no sense, too few points, and no room."""
    for share in (0.0, 0.6, -1.0, float('nan')):
        with pytest.raises(FilterError, match=r'must be more than 0, at most 0\.5, got'):
            Injection(share)
    for distance in ((0.0, 1.0), (1.0, 2.0), (2.0, 1.0), (1.0, float('inf'))):
        with pytest.raises(FilterError, match='must be LOW and HIGH > 2 LOW > 0, got'):
            Injection(distance=distance)
    with pytest.raises(FilterError, match=r'one outlier at a share of 0\.001, got 100'):
        inject(road(1, 100), Injection(share=0.001))
    with pytest.raises(FilterError, match=r'enough for one outlier .*, got 0'):
        inject([], Injection())
    rng = np.random.default_rng(1)
    full = road(1, 5000)[0]
    full.xyz[:] = rng.uniform(-30, 30, (5000, 3))
    full.xyz[0] = 0
    with pytest.raises(FilterError, match='with room 12 to 25 m away from all points, got none'):
        inject([full], Injection(share=0.01, distance=(12.0, 25.0)))
