# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Stamps that stand still: sweeps follow each other, pieces of one sweep stay where they are."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.scans import sweep

from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.messages.array_cloud import as_message
from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_filter.messages.stamps import StampCheck
from lidar_outlier_filter.parameters.filter import FilterParameters

TURN, SECOND = 100_000_000, 10**9


def message(points: Points, stamp: int) -> object:
    """Return a cloud with ring and relative t."""
    cloud = np.zeros(len(points), [(n, 'f4') for n in 'xyz'] + [('t', 'u4'), ('ring', 'u2')])
    cloud['x'], cloud['y'], cloud['z'] = points.xyz.T
    cloud['t'], cloud['ring'] = points.t, points.line
    return as_message(cloud, stamp)


def decoded(messages: list[object]) -> tuple[list[int], list[str]]:
    """Return the first time of each cloud, and warnings."""
    said: list[str] = []
    decoder = Decoder(FilterParameters(), warn=said.append)
    return [int(decoder.decode(each).t.min()) for each in messages], said


@pytest.mark.parametrize('stamps', [[0] * 6, [SECOND] * 3 + [2 * SECOND] * 3])
def test_sweeps_follow_each_other(stamps: list[int]) -> None:
    """Whether stamps are 0, or whole seconds, no sweep begins before the one before has ended."""
    turn = sweep(1, 0.0)
    begins, said = decoded([message(turn, stamp) for stamp in stamps])
    steps = np.diff(np.array(begins))
    assert (steps >= np.ptp(turn.t)).all()
    assert (steps[:2] <= 1.02 * TURN).all()
    assert begins[0] == stamps[0] + turn.t.min()
    assert len(said) == 1


def test_a_sweep_begins_after_the_end_of_the_one_before() -> None:
    """Where stamps jitter: the latest of them shows when sweeps begin, and nothing adds up."""
    turn, zero = sweep(1, 0.0), int(sweep(1, 0.0).t.min())
    jitter = [30, -30, 12, -25, 30, -30, 12, -25]
    stamps = [k * TURN + one * 1_000_000 for k, one in enumerate(jitter)]
    begins, said = decoded([message(turn, stamp) for stamp in stamps])
    off = np.array(begins) - zero - np.arange(8) * TURN
    assert (np.diff(begins) > np.ptp(turn.t)).all()
    assert ((off > 26_000_000) & (off < 31_000_000)).all()
    assert (off[4:] == off[:4]).all()
    early = (begins[1] - zero - stamps[1]) / 1e6
    (sentence,) = said
    assert sentence.startswith(f'stamps jitter: a cloud began {early:.1f} ms before the end of')


def test_sensors_that_take_turns_keep_their_times() -> None:
    """Messages of other lasers may overlap, and so may packets that arrive in another order."""
    one = sweep(1, 0.0)
    other = replace(one, line=one.line + 100)
    stamps = [0, TURN // 2, TURN, TURN + TURN // 2]
    begins, said = decoded([message(p, s) for p, s in zip([one, other] * 2, stamps, strict=True)])
    # Sweeps that begin at the same azimuth, seen by lasers that look to either side.
    aside = replace(one, t=one.t + one.line % 2 * 5_000_000)
    aside_begins, aside_said = decoded([message(aside, k * TURN) for k in range(4)])
    assert aside_begins == [k * TURN + one.t.min() for k in range(4)]
    parts = [one.take(part) for part in np.array_split(np.argsort(one.t), 40)]
    swapped = [message(parts[k], SECOND) for k in (0, 2, 1, 4, 3)]
    more, also_said = decoded(swapped)
    assert begins == [stamp + one.t.min() for stamp in stamps]
    assert more == [SECOND + parts[k].t.min() for k in (0, 2, 1, 4, 3)]
    assert not said + also_said + aside_said


def test_good_stamps_are_not_touched() -> None:
    """The pieces of a sweep, in any order of lines, are no repetitions."""
    turn, zero = sweep(1, 0.0), sweep(1, 0.0).t.min()
    stamps = [0, TURN, 2 * TURN + 5_000_000, 5 * TURN]
    begins, said = decoded([message(turn, stamp) for stamp in stamps])
    assert begins == [stamp + zero for stamp in stamps]
    for order in (np.argsort(turn.t), np.lexsort((turn.t, turn.line))):
        parts = [turn.take(part) for part in np.array_split(order, 7)]
        begins, more = decoded([message(part, SECOND) for part in parts])
        assert begins == [SECOND + part.t.min() for part in parts]
        said += more
    assert not said


def test_a_clock_that_is_set_back_is_trusted_again() -> None:
    """And a cloud that is refused leaves no trace."""
    turn = sweep(1, 0.0)
    begins, _ = decoded([message(turn, stamp) for stamp in (9 * SECOND, 9 * SECOND, SECOND)])
    assert begins[2] == SECOND + turn.t.min()
    decoder = Decoder(FilterParameters())
    for stamp in (0, 0):
        decoder.decode(message(turn, stamp))
    decoder.undo()
    assert int(decoder.decode(message(turn, SECOND)).t.min()) == SECOND + turn.t.min()
    with pytest.raises(CloudError):
        decoder.decode(as_message(np.zeros(3, [('x', 'f4'), ('y', 'f4')]), 0))


def test_without_lasers_nothing_is_early() -> None:
    """Where each message is a line, which laser measured is not known: stamps are as they are."""
    check, t = StampCheck(), np.arange(500) * 200_000
    assert check.behind(0, t, np.zeros(1, np.int64)) == 0
    assert check.behind(50_000_000, t, np.zeros(1, np.int64)) == 0
    assert not check.jitters
