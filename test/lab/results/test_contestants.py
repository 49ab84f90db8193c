# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Who is compared: each judges what it can, and peers what they would judge by themselves."""

from __future__ import annotations

import numpy as np

from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.tuning.training import Training
from lidar_outlier_lab.results import contestants
from lidar_outlier_lab.results.contestants import (
    Judgement,
    Ours,
    Peer,
    peers,
)
from lidar_outlier_lab.results.samples import Sample


def sample(count: int = 300, *, sweeps: int = 1, timed: bool = True, own: bool = False) -> Sample:
    """Make a bumpy plane with a few points above it, in so many sweeps."""
    rng = np.random.default_rng(1)
    xyz = rng.uniform(0.0, 5.0, (count, 3)) * (1, 1, 0.01)
    bad = np.arange(count) % 50 == 0
    xyz[bad, 2] += 3.0
    t = np.arange(count) * 1000 * timed
    line, valid = np.zeros(count, np.int64), np.ones(count, np.bool_)
    whole = Points(xyz, t, line, valid)
    clouds = tuple(whole.take(part) for part in np.array_split(np.arange(count), sweeps))
    stretch = np.arange(count) * 20 // count
    data = Training(clouds, bad, ~bad, stretch, 20, streamed=sweeps > 1)
    return Sample('plane', 3, data, bad.astype(np.int64), timed, own)


def test_who_suits_what() -> None:
    """No smoother without lines, no limit by range without an origin, none on another's preset."""
    assert Ours('', {'chain': ['alpha_beta_gamma']}).suits(sample())
    assert not Ours('', {'chain': ['alpha_beta_gamma']}).suits(sample(timed=False))
    assert not Ours('', {'chain': ['sor']}, needs_origin=True).suits(sample())
    assert Ours('', {'chain': ['sor']}, needs_origin=True).suits(sample(own=True))
    assert Ours('', {'chain': ['sor']}, only=('plane',)).suits(sample())
    assert not Ours('', {'chain': ['sor']}, only=('street',)).suits(sample())
    assert Peer('', lambda xyz: Judgement(xyz[:, 0] > 0, None), 300).suits(sample())
    assert not Peer('', lambda xyz: Judgement(xyz[:, 0] > 0, None), 299).suits(sample())
    assert Peer('', lambda xyz: Judgement(xyz[:, 0] > 0, None), 299).suits(
        sample(sweeps=2, own=True)
    )


def test_peers_see_sweeps_one_by_one() -> None:
    """In the sensor's frame a peer gets each sweep; in the map's, all together."""
    seen: list[int] = []

    def judge(xyz: np.ndarray) -> Judgement:
        seen.append(len(xyz))
        return Judgement(np.zeros(len(xyz), np.bool_), xyz[:, 2])

    result = Peer('', judge).judge(sample(sweeps=3, own=True))
    assert seen == [100, 100, 100]
    assert result.score is not None
    assert len(result.score) == len(result.rejected) == 300
    Peer('', judge).judge(sample(sweeps=3))
    assert seen[3:] == [300]


def test_scikit_learn_agrees() -> None:
    """On a whole cloud its LOF is ours."""
    (peer,) = (one for one in peers() if 'scikit-learn' in one.name)
    theirs = peer.judge(sample(timed=False))
    ours = Ours('', {'chain': ['lof']}).judge(sample(timed=False))
    np.testing.assert_array_equal(theirs.rejected, ours.rejected)
    assert theirs.score is not None
    assert ours.score is not None
    np.testing.assert_allclose(theirs.score / contestants.FACTOR, ours.score, rtol=1e-5)
    assert theirs.rejected.any()
