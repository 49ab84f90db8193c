# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds beyond ``max_points`` are refused; time goes on with them, so that the stream recovers."""

import numpy as np
import pytest
from helpers.nodes import Ros, flush, line, process
from helpers.profile_scanner import SHOTS, Drive, Moving
from helpers.streams import (
    BLOCK,
    HALO,
    TaggedStream,
    expected_scores,
    points_at,
    random_times,
    stream,
)

from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.errors import CloudError

TOO_MANY = 'the number of points held must be at most max_points'


def is_taken(made: TaggedStream, times: list[int], tag: object = None) -> bool:
    """Push points, and say whether they were taken."""
    try:
        made.push(points_at(times), tag)
    except CloudError as err:
        if not str(err).startswith(TOO_MANY):
            raise
        return False
    return True


def sweep(number: int, count: int = 300) -> list[int]:
    """Make times of a cloud of 0.1 s."""
    return (number * SECOND // 10 + np.arange(count) * 300_000).tolist()


def test_the_stream_recovers() -> None:
    """Blocks that do not fit lose clouds; each of them is judged, and the next has room again."""
    made, census = stream(max_points=1000, block=1.0, halo=0.0)
    taken = [number for number in range(40) if is_taken(made, sweep(number))]
    assert taken == [number for number in range(40) if number % 10 < 3]
    assert [len(block) for block in census.blocks] == [900, 900, 900]
    assert is_taken(made, sweep(10_000))


def test_answers_do_not_wait_for_the_next_cloud_that_is_taken() -> None:
    """What a refused cloud has completed is answered when the stream is asked next."""
    made, _ = stream(max_points=10)
    made.push(points_at([0] * 8), 'first')
    assert not is_taken(made, [BLOCK + HALO] * 11)
    assert [tag for tag, _ in made.take_finished()] == ['first']
    assert made.take_finished() == []


def test_a_cloud_has_the_room_of_those_it_completes() -> None:
    """They are judged before it is counted: nothing is refused that fits."""
    made, _ = stream(max_points=10)
    assert is_taken(made, [0] * 10, 'first')
    assert is_taken(made, [2 * BLOCK] * 10, 'second')
    assert not is_taken(made, [2 * BLOCK + HALO] * 10, 'third')
    assert [tag for tag, _ in made.flush()] == ['second']


@pytest.mark.parametrize('lateness', [0.0, 0.005])
@pytest.mark.parametrize('seed', range(8))
def test_what_is_taken_is_judged_as_if_by_itself(seed: int, lateness: float) -> None:
    """With all points of its block and halo that were taken; no more is ever held than allowed."""
    rng = np.random.default_rng(seed)
    times, missing = random_times(rng, 600)
    most = 80
    made, _ = stream(max_points=most, lateness=lateness)
    taken: list[int] = []
    answers, tags, begin = [], [], 0
    while begin < len(times):
        end = min(begin + int(rng.integers(1, 40)), len(times))
        try:
            answers += made.push(points_at(times[begin:end], missing[begin:end]), (begin, end))
        except CloudError:
            answers += made.take_finished()
        else:
            tags.append((begin, end))
            taken += range(begin, end)
        assert made.held <= most
        begin = end
    answers += made.flush()
    assert [tag for tag, _ in answers] == tags
    assert 300 < len(taken) < 600
    # At the end as at the beginning.
    assert sum(number >= 500 for number in taken) > 30
    expected = expected_scores([times[i] for i in taken], [missing[i] for i in taken])
    scores = np.concatenate([verdict.score for _, verdict in answers])
    np.testing.assert_array_equal(scores, np.array(expected, np.float32))


def test_after_a_hurry() -> None:
    """Points that nobody waits for, but that a block to come may need, are let go of in time."""
    made, census = stream(max_points=1000, block=1.0, max_delay=3.0)
    taken = [number for number in range(3) if is_taken(made, sweep(number))]
    made.flush_pending()
    taken += [number for number in range(3, 40) if is_taken(made, sweep(number))]
    # The first cloud of a second is needed to end the halo of the one before.
    assert taken == [0, 1, 2, 11, 12, 13, 21, 22, 23, 31, 32, 33]
    assert [len(block) for block in census.blocks] == [900] * 3


def test_missing_returns_need_no_room_where_nothing_waits() -> None:
    """They are answered at once, however much is held for the points to come."""
    made, _ = stream(max_points=10)
    made.push(points_at([0] * 8), 'points')
    made.flush_pending()
    assert [tag for tag, _ in made.push(points_at([0] * 9, [True] * 9), 'missing')] == ['missing']
    assert made.held == 8


def test_room_is_not_made_at_the_cost_of_what_may_be_late() -> None:
    """A point within the lateness is taken, though one was refused meanwhile."""
    made, census = stream(max_points=10, lateness=0.02)
    first, late = BLOCK + 1000, BLOCK + 2000
    assert is_taken(made, [first] * 4)
    assert not is_taken(made, [3 * BLOCK] * 7)
    assert is_taken(made, [late] * 2)
    made.flush()
    assert census.blocks == [[first] * 4 + [late] * 2]


def test_a_refused_cloud_closes_the_blocks_it_completes() -> None:
    """With their halo: a point within it is late, as if the cloud had been taken."""
    made, _ = stream(max_points=10)
    assert not is_taken(made, [3 * BLOCK] * 11)
    with pytest.raises(CloudError, match='the time of a cloud must be at or after what is judged'):
        made.push(points_at([2 * BLOCK + HALO - 1]))
    assert is_taken(made, [2 * BLOCK + HALO])


def test_a_refused_cloud_of_the_far_future() -> None:
    """The clouds behind it are those of a clock that was set back, as if it had been taken."""
    made, _ = stream(max_points=10)
    assert is_taken(made, [0] * 8)
    assert not is_taken(made, [100 * SECOND] * 11)
    assert is_taken(made, [BLOCK] * 8)
    assert made.resets == 1


def test_a_cloud_that_is_too_large_by_itself() -> None:
    """It is refused, and so is one that sets the clock back; the next one is served."""
    made, census = stream(max_points=10, time_jump=0.5)
    made.push(points_at([9 * SECOND] * 3), 'old')
    assert not is_taken(made, [9 * SECOND + 5] * 11)
    assert not is_taken(made, [SECOND] * 11)
    assert made.resets == 0
    assert [tag for tag, _ in made.push(points_at([SECOND]), 'new')] == ['old']
    assert made.resets == 1
    made.flush()
    assert census.blocks == [[9 * SECOND] * 3, [SECOND]]


def test_with_a_block_for_each_message() -> None:
    """A message that does not fit beside the halo is refused; the one behind it fits."""
    made, _ = stream(max_points=1000, blocks='message')
    taken = [is_taken(made, sweep(number, 600)) for number in range(6)]
    # Of 600 points, 0.18 s long, each ends in the halo of the next one.
    assert taken == [True, False] * 3
    made, _ = stream(max_points=1000, blocks='message')
    assert [is_taken(made, sweep(2 * number, 600)) for number in range(6)] == [True] * 6


def test_a_refused_message_leaves_the_halo_of_the_next() -> None:
    """Time goes on with it, and what the next message needs is kept."""
    made, census = stream(max_points=10, blocks='message')
    assert is_taken(made, [0] * 8)
    assert not is_taken(made, [HALO] * 11)
    assert is_taken(made, [HALO] * 2)
    assert census.blocks == [[0] * 8, [0] * 8 + [HALO] * 2]


# Clouds that wait for their poses ---------------------------------------------------------------


def run(moving: Moving, clouds: list[object]) -> list[int]:
    """Push clouds; return the numbers of those that are answered."""
    answers = []
    for number, msg in enumerate(clouds):
        try:
            answers += moving.filter.process(msg, number)
        except CloudError as err:
            if not str(err).startswith(TOO_MANY):
                raise
            answers += moving.filter.advance()
    return [answer.tag for answer in answers + moving.filter.flush()]


def test_without_poses() -> None:
    """What waits for poses that do not come is let go of, also by clouds that are refused."""
    drive = Drive(2.0)
    moving = Moving({'max_points': 35 * SHOTS, 'max_delay': 0.45})
    served = run(moving, list(drive.clouds(drive.own)))
    assert served == sorted(served)
    assert len(served) + moving.filter.statistics.refused == 20
    assert [sum(begin <= number < begin + 7 for number in served) > 0 for begin in (0, 7, 13)] == [
        True
    ] * 3


def test_with_poses() -> None:
    """The stream behind recovers, too, though nothing waits for its poses."""
    drive = Drive(2.0)
    moving = Moving({'max_points': 35 * SHOTS, 'block': 1.0, 'halo': 0.0})
    for msg in drive.odometry():
        moving.motion.take(msg)
    assert run(moving, list(drive.clouds(drive.own))) == [0, 1, 2, 10, 11, 12]
    assert moving.filter.statistics.without_pose == 0


def test_live(ros: Ros) -> None:
    """A refused cloud sends off the answers that it has completed."""
    node = ros.filter(parameters={'block': 0.01, 'halo': 0.0, 'max_points': 100})
    assert process(node, line(0), 0) == []
    assert [answer.tag for answer in process(node, line(0.02, 101), 1)] == [0]
    assert process(node, line(0.04), 2) == []
    assert [answer.tag for answer in flush(node)] == [2]
    assert node.channels[0].statistics.refused == 1
