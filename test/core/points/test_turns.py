# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Turns of a mirror: where they begin, however long it turns, and when it turns otherwise."""

import numpy as np
import pytest

from lidar_outlier_filter.core.annotations import Floats, Ints
from lidar_outlier_filter.core.points.line_recovery import Claim, settle_lines
from lidar_outlier_filter.core.points.mirror import STRETCH_NS, Mirror, find_mirror
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.points.turns import KEPT_TURNS, FacetCounter, TurnCounter

SHOTS, SPEED = 200, 9.0  # of a turn; metres per second
BEGIN = 1_750_000_000_000_000_000  # nanoseconds: as of a clock of today


def corridor(turned: Floats, t: Floats) -> Floats:
    """Return what a scanner sees that drives along a corridor of 5 by 4 m, at mirror angles, rad.

    The mirror swings to and fro where angles do. ``t`` are seconds.
    """
    across, up = np.sin(turned), np.cos(turned)
    far = np.minimum(np.where(across > 0, 3.0, 2.0) / np.abs(across), 2.0 / np.abs(up))
    bumps = 0.2 * np.sin(3.0 * turned)
    return np.stack([SPEED * t, (far + bumps) * across, (far + bumps) * up], axis=1)


def drive(rates: list[float], seconds: float, *, swings: bool = False) -> tuple[Ints, Floats, Ints]:
    """Turn at several rates, each for some seconds; return times, points and the true turns."""
    turns = np.concatenate(
        [np.full(int(seconds * rate * SHOTS), 1.0 / SHOTS) for rate in rates]
    ).cumsum()
    elapsed = np.concatenate([np.full(int(seconds * r * SHOTS), 1.0 / (r * SHOTS)) for r in rates])
    t = elapsed.cumsum()
    turned = 2.0 * np.pi * turns
    if swings:
        turned = 1.6 * (np.abs(turns % 2.0 - 1.0) - 0.5)
    # Upwards nothing is seen.
    seen = np.cos(turned) < 0.9 if not swings else np.ones(len(t), np.bool_)
    number = np.floor(turns).astype(np.int64)
    times = BEGIN + np.rint(t * 1e9).astype(np.int64)
    return times[seen], corridor(turned, t)[seen], number[seen]


def count(t: Ints, xyz: Floats, pieces: int) -> tuple[Ints, list[Mirror | None]]:
    """Give turns their numbers, points in some pieces; return what was said, too."""
    some = t < t[0] + STRETCH_NS
    mirror = find_mirror(t[some], xyz[some])
    assert mirror is not None
    said: list[Mirror | None] = []
    counter = TurnCounter(mirror, said.append)
    cut = zip(np.array_split(t, pieces), np.array_split(xyz, pieces), strict=True)
    return np.concatenate([counter.number(*one) for one in cut]), said


@pytest.mark.parametrize('swings', [False, True])
def test_all_turns_of_a_long_drive(swings: bool) -> None:  # noqa: FBT001  a kind of mirror
    """Thousands of turns at once are numbered as they are one by one, each where it begins."""
    t, xyz, turns = drive([150.0], 20.0, swings=swings)
    found, said = count(t, xyz, 1)
    assert not said
    for pieces in (7, 3001):
        assert (count(t, xyz, pieces)[0] == found).all()
    assert found.max() - found.min() >= turns.max() - 1
    begins, true = (np.flatnonzero(np.diff(number)) + 1 for number in (found, turns))
    away = np.abs(begins[:, None] - true).min(axis=1)
    assert away[10:].max() <= SHOTS // 50


@pytest.mark.parametrize('swings', [False, True])
def test_another_rate(swings: bool) -> None:  # noqa: FBT001  a kind of mirror
    """The mirror is set to another rate while it turns: that is found, said once, and followed."""
    t, xyz, turns = drive([150.0, 200.0], 4.0, swings=swings)
    found, said = count(t, xyz, 1)
    (changed,) = said
    assert changed is not None
    assert abs(changed.rate - 200.0) < 0.4
    assert changed.swings is swings
    again, more = count(t, xyz, 501)
    assert (again == found).all()
    assert more == said
    late = t > t[-1] - 2_000_000_000
    assert abs(np.ptp(found[late]) - np.ptp(turns[late])) <= 1


def test_a_file_says_that_the_rate_changed() -> None:
    """What a whole cloud says of its lines names both rates."""
    t, xyz, _ = drive([150.0, 200.0], 4.0)
    nothing = np.zeros(len(t), np.int64)
    points = Points(xyz=xyz, t=t, line=nothing, valid=np.ones(len(t), np.bool_))
    _, decision = settle_lines(points, Claim('message', 'message'))
    assert '150.0' in decision.text
    assert 'did not resemble each other any more: 200.0' in decision.text
    assert decision.contradicts


PERIOD_NS, FEW_SHOTS, TURNS = 5_000_000, 16, 6 * KEPT_TURNS


def numbered(t: Ints, xyz: Floats, parts: int, *, facets: bool) -> Ints:
    """Count the turns, or the facets, of a cloud that comes in so many parts."""
    begin = PERIOD_NS + PERIOD_NS // 16  # of the second one
    mirror = Mirror(float(PERIOD_NS), begin, 0.0, 5.0 if facets else 0.0)
    counter = FacetCounter(mirror) if facets else TurnCounter(mirror)
    cut = zip(np.array_split(t, parts), np.array_split(xyz, parts), strict=True)
    return np.concatenate([counter.number(*part) for part in cut])


@pytest.mark.parametrize('facets', [False, True])
def test_clouds_of_many_turns(*, facets: bool) -> None:
    """More of them than are kept for late points: one call equals many, in any order."""
    turn, shot = np.divmod(np.arange(TURNS * FEW_SHOTS), FEW_SHOTS)
    # No return in the last eighth of each turn.
    t = turn * PERIOD_NS + PERIOD_NS // 16 + shot * (PERIOD_NS * 7 // 8 // FEW_SHOTS)
    xyz = np.stack([np.ones(len(t)), shot * 0.5, np.zeros(len(t))], axis=1)
    one = numbered(t, xyz, 1, facets=facets)
    assert (one - one[0] == turn).all()
    assert (numbered(t, xyz, 50, facets=facets) == one).all()
    mixed = np.random.default_rng(1).permutation(len(t))
    assert (numbered(t[mixed], xyz[mixed], 1, facets=facets) == one[mixed]).all()
