# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The stream: which points are judged together, when a message is published, what is refused."""

import re
from collections.abc import Sequence

import numpy as np
import pytest
from helpers.nodes import Ros, flush, line, process
from helpers.profile_scanner import SHOTS, Drive, Moving
from helpers.streams import BLOCK, HALO, TaggedCloud, held, number_of, points_at, push, stream
from naive import blocks as naive

from lidar_outlier_filter.core.engine.blocks import MAX_BLOCKS_PER_CLOUD
from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.pipeline import Pipeline

REFUSALS = {
    '': '',
    'late': 'the time of a cloud must be at or after',
    'held': 'the number of points held',
}


def next_times(rng: np.random.Generator, twin: naive.Blocks, span: int) -> list[int | None]:
    """Make a cloud after the newest time, or before it; ties and edges are frequent."""
    newest = max(twin.newest, 0)
    edges = [twin.closed - 1, twin.closed, twin.judged, newest - twin.jump - 1, newest - twin.jump]
    if rng.random() < 0.2 and -1 < (edge := edges[int(rng.integers(5))]) < naive.END:
        return [edge]
    start = newest + int(rng.choice([0, 0, 0, HALO, BLOCK, 3 * BLOCK, -HALO, -BLOCK, -9 * BLOCK]))
    steps = rng.choice([0, 1, HALO // 2 - 1, HALO // 2, span], int(rng.integers(0, 12)))
    times = start // (HALO // 2) * (HALO // 2) + np.cumsum(steps) - int(rng.integers(0, 2))
    if rng.random() < 0.3:
        rng.shuffle(times)
    return [None if rng.random() < 0.1 else t for t in times.tolist()]


def fails(near: Sequence[int] | None) -> bool:
    """Return whether the chain fails on a block of these times."""
    return near is not None and number_of(near) % 8 == 0


def check(times: Sequence[int]) -> None:
    """Raise an error on such a block."""
    if fails(times):
        raise ValueError


@pytest.mark.parametrize('kind', ['time', 'message', 'auto'])
@pytest.mark.parametrize('seed', range(12))
def test_naive(kind: str, seed: int) -> None:
    """Clouds, however cut and timed, flushes and refusals: as in plain loops over all points."""
    rng = np.random.default_rng(seed)
    halo, lateness = int(rng.choice([0, HALO])), int(rng.choice([0, 2 * BLOCK]))
    jump, most = int(rng.choice([5, 60])) * BLOCK, int(rng.choice([9, 40, 10**6]))
    given = {'halo': halo / SECOND, 'lateness': lateness / SECOND, 'time_jump': jump / SECOND}
    made, census = stream(blocks=kind, max_points=most, **given)
    census.check = check if seed % 2 else len
    twin = naive.Blocks(kind, BLOCK, halo, lateness, jump, most)
    span = int(rng.choice([HALO // 4, BLOCK // 4, BLOCK]))
    results: list[TaggedCloud] = []
    refused: set[str] = set()
    for number in range(250):
        if (chance := rng.random()) < 0.04:
            results += made.flush_pending()
            twin.flush_pending()
        elif chance < 0.05:
            results += made.flush()
            twin.flush()
        else:
            times = next_times(rng, twin, span)
            reason = twin.push(number, times)
            points = points_at([t or 0 for t in times], [t is None for t in times])
            said = ''
            try:
                results += push(made, points, number)
            except CloudError as err:
                said = str(err)
                results += made.take_finished()
            assert said.startswith(REFUSALS[reason])
            assert bool(said) == bool(reason)
            refused.add(reason)
        assert (held(made), made.resets) == (twin.held(), twin.resets)
        assert (len(made.pending), made.by_message) == (len(twin.pending), twin.by_message)
        assert [cloud.tag for cloud in results] == [cloud.tag for cloud in twin.results]
        for found, cloud in zip(results, twin.results, strict=True):
            is_failed = seed % 2 == 1 and any(map(fails, cloud.verdict))
            assert (found.error is not None) == is_failed
            expected = [
                np.nan if is_failed or near is None else number_of(near) for near in cloud.verdict
            ]
            np.testing.assert_array_equal(found.verdict.score, np.array(expected, np.float32))
        results, twin.results = [], []
    assert refused >= ({'late'} if kind == 'time' else {''}) | ({'held'} if most < 40 else set())


def test_blocks_are_judged_in_order() -> None:
    """Each occupied block once, where its halo has passed; points stay in the order of arrival."""
    made, census = stream()
    push(made, points_at([9, BLOCK - 1]), 'a')
    push(made, points_at([3, BLOCK + HALO - 1]), 'b')
    assert census.blocks == []
    push(made, points_at([2**61]), 'c')
    made.flush()
    halo = [BLOCK - 1, BLOCK + HALO - 1]
    assert census.blocks == [[9, BLOCK - 1, 3, BLOCK + HALO - 1], halo, [2**61]]


def test_how_late_a_cloud_is() -> None:
    """In seconds, for the log."""
    made, _ = stream()
    push(made, points_at([5, 3 * BLOCK]))
    sentence = REFUSALS['late'] + ' what is judged already, got a point 0.002000 s older than that'
    with pytest.raises(CloudError, match=f'^{re.escape(sentence)}$'):
        push(made, points_at([BLOCK]))


@pytest.mark.parametrize(
    ('span', 'says'), [(BLOCK // 4, 'each message is one'), (9, 'messages are judged in')]
)
def test_what_blocks_auto_has_chosen(span: int, says: str) -> None:
    """Said once; a refused message decides nothing; a new stream chooses anew."""
    made, _ = stream(blocks='auto', max_points=6)
    said: list[str] = []
    made.inform = said.append
    for times, refusal in (([0] * 7, 'points held'), ([0, 2 * MAX_BLOCKS_PER_CLOUD * BLOCK], 'sp')):
        with pytest.raises(CloudError, match=refusal):
            push(made, points_at(times))
    for _ in range(2):
        assert len(push(made, points_at([]))) == 1
        for number in range(4):
            push(made, points_at([number * BLOCK, number * BLOCK + span]))
        made.flush()
    assert [text.startswith(f'blocks: {says}') for text in said] == [True, True]
    assert said[0].endswith(f'because a message spans {span / SECOND:.3g} s')


def test_a_cloud_may_span_so_many_blocks_and_no_more() -> None:
    """Exactly ``MAX_BLOCKS_PER_CLOUD``; a nanosecond more is refused."""
    made, _ = stream()
    push(made, points_at([0, MAX_BLOCKS_PER_CLOUD * BLOCK]))
    with pytest.raises(CloudError, match=r'^the time that a cloud spans must be at most'):
        push(made, points_at([0, MAX_BLOCKS_PER_CLOUD * BLOCK + 1]))


# Clouds that wait for their poses ---------------------------------------------------------------


def published(moving: Moving, clouds: list[object]) -> list[int]:
    """Push clouds; return the numbers of those that are published."""
    results = []
    for number, msg in enumerate(clouds):
        try:
            results += moving.filter.process(msg, number)
        except CloudError:
            results += moving.filter.advance()
    return [result.tag for result in results + moving.filter.flush()]


def test_without_poses() -> None:
    """What waits for poses that do not come is let go of, also by clouds that are refused."""
    drive = Drive(2.0)
    moving = Moving({'max_points': 35 * SHOTS, 'max_delay': 0.45})
    served = published(moving, list(drive.clouds(drive.own)))
    assert served == sorted(served)
    assert len(served) + moving.filter.statistics.refused == 20
    assert all(set(served) & set(range(begin, begin + 7)) for begin in (0, 7, 13))


def test_with_poses() -> None:
    """The stream behind recovers, too, though nothing waits for its poses."""
    drive = Drive(2.0)
    moving = Moving({'max_points': 35 * SHOTS, 'block': 1.0, 'halo': 0.0})
    for msg in drive.odometry():
        moving.motion.take(msg)
    assert published(moving, list(drive.clouds(drive.own))) == [0, 1, 2, 10, 11, 12]
    assert moving.filter.statistics.without_pose == 0


def test_live(ros: Ros) -> None:
    """A refused cloud publishes the outputs that it has completed."""
    node = ros.filter(parameters={'block': 0.01, 'halo': 0.0, 'max_points': 100})
    assert process(node, line(0), 0) == []
    assert [result.tag for result in process(node, line(0.02, 101), 1)] == [0]
    assert process(node, line(0.04), 2) == []
    assert [result.tag for result in flush(node)] == [2]
    assert node.channels[0].statistics.refused == 1


def test_a_refused_cloud_begins_no_scan_line() -> None:
    """The next cloud has the line that it would have had: the third of three."""
    values = {'line_source': 'message', 'chain': ('alpha_beta_gamma',), 'block': 0.02, 'halo': 0.0}
    clean = Pipeline(FilterParameters().changed(values))
    clean.process(line(0.5))
    clean.process(line(0.6))
    with pytest.raises(CloudError, match=r'^the time of a cloud must be at or after'):
        clean.process(line(0.4))
    assert clean._decoder.decode(line(0.62)).line.tolist() == [3] * 100
