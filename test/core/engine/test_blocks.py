# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The stream: which points are judged together, and when a message is answered."""

import gc
import weakref
from collections.abc import Sequence
from typing import Any, cast

import numpy as np
import pytest
from helpers.streams import (
    BLOCK,
    HALO,
    Census,
    TaggedStream,
    cut,
    expected_scores,
    points_at,
    random_times,
    stream,
)

from lidar_outlier_filter.core.engine.blocks import MAX_BLOCKS_PER_CLOUD, Blocks
from lidar_outlier_filter.core.engine.stream_cloud import StreamCloud
from lidar_outlier_filter.core.points.points import SECOND, Points
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.parameters.filter import FilterParameters

LATE = 'the time of a cloud must be at or after what is judged already, got a point .* older'


@pytest.mark.parametrize('parts', [1, 2, 10, 50, 1000])
@pytest.mark.parametrize('seed', range(6))
def test_blocks_and_halos(seed: int, parts: int) -> None:
    """Every point is judged once, with exactly its block and halo, however the points are cut."""
    rng = np.random.default_rng(seed)
    times, missing = random_times(rng)
    made, census = stream()
    answers = []
    for number, (begin, end) in enumerate(cut(rng, len(times), parts)):
        answers += made.push(points_at(times[begin:end], missing[begin:end]), (number, end - begin))
        assert_waiting(made, times[:end], missing[:end])
    answers += made.flush()
    assert [tag[0] for tag, _ in answers] == list(range(parts))
    assert [tag[1] for tag, _ in answers] == [len(verdict.score) for _, verdict in answers]
    scores = np.concatenate([verdict.score for _, verdict in answers])
    np.testing.assert_array_equal(scores, np.array(expected_scores(times, missing), np.float32))
    detectors = np.concatenate([verdict.detectors for _, verdict in answers])
    assert detectors.tolist() == [int(not gone) for gone in missing]
    occupied = {t // BLOCK for t, gone in zip(times, missing, strict=True) if not gone}
    assert len(census.blocks) == len(occupied)


def assert_waiting(made: TaggedStream, times: Sequence[int], missing: Sequence[bool]) -> None:
    """Assert that a message waits for the halo of its last point, and no longer."""
    seen = [t for t, gone in zip(times, missing, strict=True) if not gone]
    newest = seen[-1] if seen else 0
    unfinished = [t for t in seen if (t // BLOCK + 1) * BLOCK + HALO > newest]
    assert (made.waiting > 0) == bool(unfinished)
    if made.waiting:
        assert made.oldest is not None


def test_nothing_waits_behind_a_finished_message() -> None:
    """A message without points, or with missing returns only, is answered in its turn."""
    made, _ = stream()
    assert [tag for tag, _ in made.push(points_at([]), 'empty')] == ['empty']
    assert [tag for tag, _ in made.push(points_at([5], [True]), 'missing')] == ['missing']
    assert made.push(points_at([5]), 'point') == []
    assert made.push(points_at([]), 'empty') == []
    assert made.push(points_at([5, 5], [True, True]), 'missing') == []
    assert (made.waiting, made.oldest) == (3, 'point')
    answers = made.push(points_at([BLOCK + HALO]), 'later')
    assert [tag for tag, _ in answers] == ['point', 'empty', 'missing']
    assert [len(verdict.score) for _, verdict in answers] == [1, 0, 2]
    assert np.isnan(answers[2][1].score).all()
    assert not answers[2][1].rejected.any()


def test_a_block_ends_exactly() -> None:
    """A block is judged by the first point at the end of its halo, and not by one before."""
    made, census = stream()
    made.push(points_at([0, BLOCK - 1, BLOCK, BLOCK + HALO - 1]))
    assert census.blocks == []
    made.push(points_at([BLOCK + HALO]))
    assert census.blocks == [[0, BLOCK - 1, BLOCK, BLOCK + HALO - 1]]
    made.flush()
    # From HALO before the second block; the second block's points are judged there
    assert census.blocks[1:] == [[BLOCK - 1, BLOCK, BLOCK + HALO - 1, BLOCK + HALO]]


def assert_same(a: list[tuple[Any, Verdict]], b: list[tuple[Any, Verdict]]) -> None:
    """Two lists of answers have the same tags and verdicts, bit for bit."""
    assert [tag for tag, _ in a] == [tag for tag, _ in b]
    for (_, one), (_, other) in zip(a, b, strict=True):
        assert one.score.tobytes() == other.score.tobytes()
        assert one.detectors.tolist() == other.detectors.tolist()


# Late and early ---------------------------------------------------------------------------------


@pytest.mark.parametrize('seed', range(5))
def test_late_cloud(seed: int) -> None:
    """A cloud with a point before what is judged is refused, and nothing else is changed by it."""
    rng = np.random.default_rng(seed)
    times, missing = random_times(rng)
    disturbed, census = stream()
    undisturbed, same = stream()
    refused = 0
    for begin, end in cut(rng, len(times), 40):
        points = points_at(times[begin:end], missing[begin:end])
        assert_same(disturbed.push(points, begin), undisturbed.push(points, begin))
        seen = [t for t, gone in zip(times[:end], missing[:end], strict=True) if not gone]
        ends = [(t // BLOCK + 1) * BLOCK + HALO for t in seen]
        closed = max((e for e in ends if e <= seen[-1]), default=None)
        if closed is not None:
            refused += 1
            late = rng.permutation([closed - 1, closed + BLOCK, seen[-1] + SECOND])
            with pytest.raises(CloudError, match=LATE):
                disturbed.push(points_at(late.tolist()), 'late')
        assert (disturbed.waiting, disturbed.held) == (undisturbed.waiting, undisturbed.held)
    assert refused > 10
    assert_same(disturbed.flush(), undisturbed.flush())
    assert census.blocks == same.blocks


def test_the_edge_of_late() -> None:
    """The end of the halo that was judged is the first time that is not late."""
    made, _ = stream()
    made.push(points_at([5, 3 * BLOCK]))
    with pytest.raises(CloudError, match=r'got a point 0\.000000 s older than that'):
        made.push(points_at([BLOCK + HALO - 1]))
    made.push(points_at([BLOCK + HALO]))
    assert len(made.flush()) == 2


@pytest.mark.parametrize('seed', range(5))
def test_lateness(seed: int) -> None:
    """Clouds out of order by less than the lateness have the verdicts that they have in order."""
    rng = np.random.default_rng(seed)
    times, missing = random_times(rng)
    lateness = 3 * BLOCK
    made, _ = stream(lateness=lateness / SECOND)
    starts = [0]
    for i, t in enumerate(times):
        if t - times[starts[-1]] >= BLOCK or rng.uniform() < 0.1:
            starts.append(i)
    pieces = list(zip(starts, [*starts[1:], len(times)], strict=True))
    arrival = [times[begin] + rng.integers(0, lateness - BLOCK) for begin, _ in pieces]
    order = np.argsort(arrival, kind='stable').tolist()
    assert order != sorted(order)
    answers = []
    for i in order:
        begin, end = pieces[i]
        answers += made.push(points_at(times[begin:end], missing[begin:end]), pieces[i])
    answers += made.flush()
    assert [tag for tag, _ in answers] == [pieces[i] for i in order]
    expected = np.array(expected_scores(times, missing), np.float32)
    for (begin, end), verdict in answers:
        np.testing.assert_array_equal(verdict.score, expected[begin:end])


def test_late_in_spite_of_lateness() -> None:
    """The lateness is waited for, and a point that is later still is refused."""
    made, census = stream(lateness=0.02)
    made.push(points_at([5, 3 * BLOCK + HALO - 1]))
    made.push(points_at([6]))
    assert census.blocks == []
    made.push(points_at([3 * BLOCK + HALO]))
    assert census.blocks == [[5, 6]]
    with pytest.raises(CloudError, match=LATE):
        made.push(points_at([7]))


def test_clock_set_back() -> None:
    """A clock that goes back by more than time_jump begins a new stream, and loses nothing."""
    made, census = stream(time_jump=0.5)
    old, new = 10 * SECOND, 9 * SECOND
    assert made.push(points_at([old, old + 5]), 'old') == []
    assert [tag for tag, _ in made.push(points_at([new, new + 9]), 'new')] == ['old']
    assert made.resets == 1
    assert made.push(points_at([new + 3]), 'next') == []
    assert [tag for tag, _ in made.flush()] == ['new', 'next']
    assert census.blocks == [[old, old + 5], [new, new + 9, new + 3]]


def test_clock_set_back_by_exactly_the_jump() -> None:
    """Only more than time_jump is a clock that was set back."""
    made, _ = stream(time_jump=0.5)
    made.push(points_at([10 * SECOND]))
    made.push(points_at([10 * SECOND - SECOND // 2]))
    assert made.resets == 0
    made.push(points_at([10 * SECOND - SECOND // 2 - 1]))
    assert made.resets == 1


def test_clock_set_forward() -> None:
    """A clock that goes forward finishes all that was before; nothing is in between."""
    made, census = stream()
    made.push(points_at([5]), 'before')
    answers = made.push(points_at([2**61]), 'after')
    assert [tag for tag, _ in answers] == ['before']
    assert [tag for tag, _ in made.flush()] == ['after']
    assert census.blocks == [[5], [2**61]]


# In a hurry -------------------------------------------------------------------------------------


@pytest.mark.parametrize('seed', range(6))
def test_hurry(seed: int) -> None:
    """In a hurry all is answered with what is there; what comes later sees it, and all the rest."""
    rng = np.random.default_rng(seed)
    times, missing = random_times(rng)
    seen = [t for t, gone in zip(times, missing, strict=True) if not gone]
    made, _ = stream()
    hurries = 0
    for begin, end in cut(rng, len(times), 60):
        answers = made.push(points_at(times[begin:end], missing[begin:end]), (begin, end))
        newest = max((t for t in seen if t <= times[end - 1]), default=0) if end else 0
        is_torn = any(t == newest for t in times[end:])
        if rng.uniform() < 0.3 and not is_torn:
            answers += made.flush_pending()
            assert made.waiting == 0
            assert made.oldest is None
            hurries += 1
        arrived = [t if i < end else None for i, t in enumerate(times)]
        expected = partial_scores(arrived, missing)
        for (first, last), verdict in answers:
            np.testing.assert_array_equal(verdict.score, expected[first:last])
    assert hurries > 5


def partial_scores(
    arrived: Sequence[int | None], missing: Sequence[bool]
) -> np.ndarray[Any, np.dtype[np.float32]]:
    """Score the points that have arrived by those of their block and halo that have."""
    there = [t for t in arrived if t is not None]
    return np.array(expected_scores(there, missing[: len(there)]), np.float32)


def test_hurry_closes_what_was_told() -> None:
    """After a hurry a point that is older than those said is late; one of the same time is not."""
    made, _ = stream()
    made.push(points_at([0, 10]))
    made.flush_pending()
    with pytest.raises(CloudError, match=LATE):
        made.push(points_at([9]))
    assert len(made.push(points_at([10]))) == 1
    assert made.push(points_at([11])) == []


def test_flush_begins_anew() -> None:
    """After a flush any time is welcome, and nothing of before is seen."""
    made, census = stream()
    made.push(points_at([5 * BLOCK, 6 * BLOCK]), 'before')
    made.flush()
    assert (made.waiting, made.held) == (0, 0)
    made.push(points_at([5 * BLOCK + 1]), 'after')
    made.flush()
    assert census.blocks[-1] == [5 * BLOCK + 1]
    assert made.resets == 0


# What is held -----------------------------------------------------------------------------------


class Tag:
    """Something whose end can be seen."""


@pytest.mark.parametrize('kind', ['points', 'missing', 'empty', 'mixed'])
def test_bounded_memory(kind: str) -> None:
    """What is held does not grow with the number of messages, whatever they are made of."""
    made, census = stream()
    census.blocks = cast('list[list[int]]', Forgetful())
    alive: weakref.WeakSet[Tag] = weakref.WeakSet()
    most_held = most_alive = 0
    for number in range(3000):
        shape = kind if kind != 'mixed' else ('points', 'missing', 'empty')[number % 3]
        times = [] if shape == 'empty' else [number * 1_000_000 + i for i in range(5)]
        tag = Tag()
        alive.add(tag)
        made.push(points_at(times, [shape == 'missing'] * len(times)), tag)
        del tag
        most_held = max(most_held, made.held)
        most_alive = max(most_alive, len(alive))
    gc.collect()
    # Block and two halos are 14 messages; one more is in hand.
    assert most_alive <= 27
    assert most_held <= 27 * 5


class Forgetful(list[Any]):
    """A list that keeps nothing."""

    def append(self, item: object) -> None:
        """Keep nothing."""


def test_max_points_of_missing_returns() -> None:
    """Clouds that wait behind another are held too, though they have nothing to judge."""
    made, _ = stream(max_points=10)
    made.push(points_at([0]), 'point')
    made.push(points_at([0] * 9, [True] * 9), 'missing')
    with pytest.raises(CloudError, match='points held must be at most max_points = 10, got 11'):
        made.push(points_at([0], [True]), 'one more')
    assert [tag for tag, _ in made.flush_pending()] == ['point', 'missing']
    assert made.push(points_at([0] * 9, [True] * 9)) != []


def test_after_hurry_points_of_the_last_time_are_taken_untested() -> None:
    """A cloud that begins at the very time the stream was hurried at is answered, not refused."""
    stream = TaggedStream(FilterParameters().changed({'chain': ['sor'], 'sor.multiplier': 9.0}))
    count = 50
    t = 1_000_000_000 + 10_000 * np.arange(count)
    xyz = np.stack([np.arange(count) + 1.0, np.ones(count), np.ones(count)], axis=1)
    everything = Points(xyz, t, np.zeros(count, np.int64), np.ones(count, np.bool_))
    stream.push(everything.take(slice(0, -1)), 'first')
    assert [tag for tag, _ in stream.flush_pending()] == ['first']
    stream.push(everything.take(slice(-2, None)), 'second')
    ((tag, verdict),) = stream.flush()
    assert tag == 'second'
    assert np.isnan(verdict.score).tolist() == [True, False]
    assert not verdict.rejected.any()


# A block for each message -----------------------------------------------------------------------


def by_message(**values: object) -> tuple[TaggedStream, Census]:
    """Make a stream whose blocks are the messages."""
    return stream(blocks='message', **values)


def test_blocks_by_message_are_answered_at_once() -> None:
    """Each message is judged with the halo before it, and waits for nothing."""
    made, census = by_message()
    sweeps = [
        list(range(0, 50_000_000, 1_000_000)),
        list(range(50_000_000, 90_000_000, 1_000_000)),
        list(range(200_000_000, 200_005_000, 1000)),
    ]
    for number, times in enumerate(sweeps):
        ((tag, verdict),) = made.push(points_at(times), number)
        assert tag == number
        assert verdict.detectors.tolist() == [1] * len(times)
        assert verdict.rejected.all()
        assert (made.waiting, made.oldest) == (0, None)
    halo = [t for t in sweeps[0] if t >= 50_000_000 - HALO]
    assert len(halo) == 2
    assert census.blocks == [sweeps[0], halo + sweeps[1], sweeps[2]]
    assert made.flush() == []


def test_blocks_by_message_may_overlap() -> None:
    """Sweeps that begin before the last one ended are no error; each point is said once."""
    made, census = by_message()
    made.push(points_at([10_000_000, 19_000_000]), 'a')
    times = [18_000_000, 30_000_000, 20_000_000]
    ((_, verdict),) = made.push(points_at(times, [False, True, False]), 'b')
    assert census.blocks == [[10_000_000, 19_000_000], [19_000_000, 18_000_000, 20_000_000]]
    assert verdict.detectors.tolist() == [1, 0, 1]
    assert np.isnan(verdict.score).tolist() == [False, True, False]


def test_blocks_by_message_see_nothing_after_them() -> None:
    """A message that is late sees the halo before it and its own time, and no later point."""
    made, census = by_message(time_jump=10.0)
    last = 5 * SECOND
    made.push(points_at([*range(0, last, SECOND // 10), last]), 'newest')
    late = [SECOND + HALO, SECOND + 2 * HALO]
    ((tag, verdict),) = made.push(points_at(late), 'late')
    assert tag == 'late'
    assert census.blocks[1] == [SECOND, *late]
    assert verdict.detectors.tolist() == [1, 1]
    # Of its own last time it sees the others', too, as it would with time for a block.
    made.push(points_at([last - 1]), 'before')
    made.push(points_at([last]), 'same')
    assert census.blocks[2:] == [[last - 1], [last, last - 1, last]]


@pytest.mark.parametrize('seed', range(4))
def test_blocks_by_message_within_one_halo(seed: int) -> None:
    """Messages shorter than the halo are judged with all that lie within it, however many."""
    rng = np.random.default_rng(seed)
    made, census = by_message()
    times, seen = np.cumsum(rng.choice([0, HALO // 7, HALO // 3, 2 * HALO], 300)).tolist(), 0
    while seen < len(times):
        end = min(seen + int(rng.integers(1, 4)), len(times))
        made.push(points_at(times[seen:end]))
        assert census.blocks[-1] == [t for t in times[:end] if t >= times[seen] - HALO]
        seen = end
    assert max(map(len, census.blocks)) > 6


def test_blocks_by_message_of_nothing() -> None:
    """Empty clouds, and those of missing returns, are answered at once as well."""
    made, census = by_message()
    assert [tag for tag, _ in made.push(points_at([]), 'empty')] == ['empty']
    ((_, verdict),) = made.push(points_at([5, 6], [True, True]), 'missing')
    assert np.isnan(verdict.score).all()
    assert census.blocks == []


# A block as the first messages say ----------------------------------------------------------------

SWEEP = BLOCK // 4


def sweep_at(begin: int, span: int) -> list[int]:
    """Make times of a message that spans exactly so much."""
    return [begin + span * part // 6 for part in range(7)]


def automatic(**values: object) -> tuple[TaggedStream, Census, list[str]]:
    """Make a stream that chooses, and collect what it says of that."""
    made, census = stream(blocks='auto', **values)
    said: list[str] = []
    made.stream.inform = said.append
    return made, census, said


@pytest.mark.parametrize('span', [SWEEP, BLOCK, 3 * BLOCK])
def test_sweeps_are_blocks(span: int) -> None:
    """Where the first message is long enough, all is as with blocks: message."""
    made, census, said = automatic()
    same, expected = by_message()
    begin = 0
    for number, length in enumerate([span, 5, span, 0, span]):
        times = sweep_at(begin, length)
        ours, theirs = (one.push(points_at(times), number) for one in (made, same))
        assert [tag for tag, _ in ours] == [tag for tag, _ in theirs] == [number]
        begin = times[-1] + 1000
    assert census.blocks == expected.blocks
    assert said == [
        f'blocks: each message is judged at once, because a message spans {span / SECOND:.3g} s'
    ]


@pytest.mark.parametrize('seed', range(4))
def test_scan_lines_are_no_blocks(seed: int) -> None:
    """Short messages are cut into blocks of time, as with blocks: time; long ones behind them, too.

    However the points are cut into short messages, the verdicts are the same.
    """
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.choice([0, 1000, SWEEP // 9], 400)).tolist()
    expected = np.array(expected_scores(times, [False] * len(times)), np.float32)
    for most in (2, 5, 9):
        made, _, said = automatic()
        answers, end = [], 0
        for number in range(len(times)):
            begin, end = end, end + (int(rng.integers(1, most + 1)) if number != 40 else 150)
            answers += made.push(points_at(times[begin:end]), (number, end - begin))
            assert_waiting(made, times[:end], [False] * len(times[:end]))
        answers += made.flush()
        scores = np.concatenate([verdict.score for _, verdict in answers])
        np.testing.assert_array_equal(scores, expected)
        (text,) = said
        assert text.startswith('blocks: messages wait for stretches of sensor time, because a ')


@pytest.mark.parametrize('short', [0, 1, 2])
def test_a_first_sweep_that_is_cut_short(short: int) -> None:
    """Up to two short messages before the first long one are judged with what is there by then."""
    made, census, said = automatic()
    empty = made.push(points_at([]), 'empty') + made.push(points_at([5], [True]), 'missing')
    assert [tag for tag, _ in empty] == ['empty', 'missing']
    begin, sent = 0, []
    for number in range(short):
        sent.append(sweep_at(begin, SWEEP - 1))
        assert made.push(points_at(sent[-1]), number) == []
        begin = sent[-1][-1] + 1
    sweep = sweep_at(begin, SWEEP)
    answers = made.push(points_at(sweep), short)
    assert [tag for tag, _ in answers] == list(range(short + 1))
    before = [t for times in sent for t in times]
    assert census.blocks == ([before] if short else []) + [
        [t for t in before if t >= begin - HALO] + sweep
    ]
    assert len(said) == 1


def test_a_refused_message_decides_nothing() -> None:
    """The stream is as it was before."""
    made, _, said = automatic(max_points=6)
    with pytest.raises(CloudError, match='points held'):
        made.push(points_at(sweep_at(0, BLOCK)))
    with pytest.raises(CloudError, match='the time that a cloud spans'):
        made.push(points_at([0, 2 * MAX_BLOCKS_PER_CLOUD * BLOCK]))
    assert said == []
    assert not made.stream.by_message


def test_a_new_stream_chooses_anew() -> None:
    """After a clock that was set back, and after the end of a recording."""
    made, _, said = automatic(time_jump=0.5)
    assert len(made.push(points_at(sweep_at(10 * SECOND, BLOCK)))) == 1
    assert made.push(points_at([SECOND])) == []
    assert len(made.push(points_at(sweep_at(SECOND, BLOCK)))) == 2
    made.flush()
    assert made.push(points_at([SECOND])) == []
    assert len(said) == 2


def test_a_cloud_may_span_so_many_blocks_and_no_more() -> None:
    """Exactly ``MAX_BLOCKS_PER_CLOUD``; a nanosecond more is refused."""
    blocks: Blocks[StreamCloud] = Blocks(FilterParameters())
    most = MAX_BLOCKS_PER_CLOUD * round(FilterParameters().block * SECOND)
    blocks.refuse_span(StreamCloud(points_at([0, most])))
    with pytest.raises(CloudError, match=r'^the time that a cloud spans must be at most'):
        blocks.refuse_span(StreamCloud(points_at([0, most + 1])))
