# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Stamps that stand still: sweeps follow each other, pieces of one sweep stay where they are."""

import numpy as np
import pytest
from helpers.scans import sweep

from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.messages.array_cloud import as_message
from lidar_outlier_filter.messages.decoder import Decoder
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


def test_good_stamps_are_not_touched() -> None:
    """Neither jitter nor the pieces of a sweep, in any order of lines, are repetitions."""
    turn, zero = sweep(1, 0.0), sweep(1, 0.0).t.min()
    stamps = [0, TURN - 9_000_000, 2 * TURN + 5_000_000, 5 * TURN]
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
