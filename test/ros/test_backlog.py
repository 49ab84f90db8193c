# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What waits is bounded and stays in order; what is too much is met as the policy says."""

import threading
import time
from collections.abc import Callable, Iterator

import pytest

from lidar_outlier_filter.parameters.node import LoadParameters
from lidar_outlier_filter.ros.backlog import Inbox, Overload, Received, Treatment

FILTER, DEGRADE, PASS, DROP = Treatment.FILTER, Treatment.DEGRADE, Treatment.PASS, Treatment.DROP


def cloud(name: object, size: int = 1, at: int = 0) -> Received:
    """Make a cloud in wait."""
    return Received(bytes(size), at, name)


def left(inbox: Inbox) -> list[object]:
    """Take all that is there: names of clouds, results of commands."""
    found: list[object] = []
    while (item := inbox.take(0)) is not None:
        found.append(item() if callable(item) else item.msg)
    return found


def test_clouds_stay_in_order() -> None:
    """First in, first out; commands before all, or in their turn."""
    inbox = Inbox(LoadParameters())
    assert inbox.put(cloud(1)) == 0
    inbox.order(lambda: 'in turn', in_turn=True)
    assert inbox.put(cloud(2)) == 0
    inbox.order(lambda: 'at once')
    inbox.order(lambda: 'then')
    assert (inbox.clouds, inbox.size) == (2, 2)
    assert left(inbox) == ['at once', 'then', 1, 'in turn', 2]
    assert (inbox.clouds, inbox.size, inbox.fill) == (0, 0, 0)


def test_changes_and_clouds_take_turns() -> None:
    """The newest change counts; a cloud comes after it, however many more there are."""
    inbox = Inbox(LoadParameters())
    for number in range(3):
        inbox.put(cloud(number))
    taken: list[object] = []
    for number in range(10):
        inbox.change(lambda number=number: f'old {number}')  # type: ignore[misc]
        inbox.change(lambda number=number: f'new {number}')  # type: ignore[misc]
        item = inbox.take(0)
        assert item is not None
        taken.append(item() if callable(item) else item.msg)
    assert taken[:6] == ['new 0', 0, 'new 2', 1, 'new 4', 2]
    assert taken[6:] == ['new 6', 'new 7', 'new 8', 'new 9']
    inbox.put(cloud(3))
    inbox.change(lambda: 'the last')
    inbox.close()
    assert left(inbox) == ['the last', 3]
    inbox.change(str)
    inbox.order(str)
    inbox.order(str, in_turn=True)
    assert not inbox.done
    inbox.close(discard=True)
    assert inbox.done


def test_bounded_by_number() -> None:
    """The oldest goes; a command among the clouds stays in its place."""
    inbox = Inbox(LoadParameters(clouds=3))
    inbox.order(lambda: 'first', in_turn=True)
    assert [inbox.put(cloud(number)) for number in range(6)] == [0, 0, 0, 1, 1, 1]
    assert inbox.fill == 1
    assert left(inbox) == ['first', 3, 4, 5]


def test_bounded_by_memory() -> None:
    """As many go as it takes; a single cloud has room, whatever its size."""
    inbox = Inbox(LoadParameters(megabytes=10))
    assert [inbox.put(cloud(size, size * 10**6)) for size in (4, 6, 5, 11)] == [0, 0, 2, 1]
    assert (inbox.clouds, inbox.size) == (1, 11_000_000)
    assert left(inbox) == [11]


def test_the_end_comes_with_the_last_clouds() -> None:
    """No thread polls between the two: it waits until both are there."""
    inbox, seen = Inbox(LoadParameters()), []
    waiting = threading.Thread(target=lambda: seen.append((inbox.done, inbox.clouds)))

    def last() -> Iterator[Received]:
        waiting.start()
        waiting.join(0.05)
        yield cloud(1)

    inbox.close(last())
    waiting.join(60)
    assert seen == [(False, 1)]


@pytest.mark.parametrize(
    'wake',
    [
        lambda inbox: inbox.put(cloud(1)),
        lambda inbox: inbox.order(str),
        lambda inbox: inbox.order(str, in_turn=True),
        lambda inbox: inbox.change(str),
        lambda inbox: inbox.wake(),
        lambda inbox: inbox.close(),
    ],
)
def test_take_waits(wake: Callable[[Inbox], object]) -> None:
    """Until there is something, or it is woken; being woken before counts, once."""
    inbox = Inbox(LoadParameters())
    thread = threading.Thread(target=inbox.take, args=[None])
    thread.start()
    wake(inbox)
    thread.join(60)
    assert not thread.is_alive()
    inbox.wake()
    assert inbox.take(60) is None


def test_woken_once() -> None:
    """What was woken waits again the next time, and for as long as it should."""
    inbox = Inbox(LoadParameters())
    inbox.wake()
    inbox.wake()
    began = time.perf_counter()
    assert inbox.take(60) is None
    waited = time.perf_counter()
    assert inbox.take(0.05) is None
    assert waited - began < 30
    assert time.perf_counter() - waited >= 0.05


def decide(overload: Overload, policy: str, *waits: tuple[float, float]) -> list[Treatment]:
    """Decide for clouds of (fill, age), max_delay 1 s."""
    return [overload.decide(policy, fill, age, 1.0) for fill, age in waits]


def test_drop_oldest() -> None:
    """A cloud is dropped if it cannot be published in time, unless it is the newest."""
    waits = ((0.9, 0), (0.1, 0.89), (0.1, 0.91), (0, 5), (0.001, 0.91))
    assert decide(Overload(), 'drop_oldest', *waits) == [FILTER, FILTER, DROP, FILTER, DROP]


@pytest.mark.parametrize('much', [(0.5, 0.0), (0.0, 0.45)])
def test_pass_through(much: tuple[float, float]) -> None:
    """From half on everything passes, until nothing waits."""
    found = decide(
        Overload(), 'pass_through', (0.4, 0), much, (0.1, 0), (0.01, 0), (0, 0), (0.4, 0)
    )
    assert found == [FILTER, PASS, PASS, PASS, FILTER, FILTER]


def test_degrade() -> None:
    """From half on the smoother alone, from three quarters nobody, until nothing waits."""
    waits = ((0.4, 0), (0.5, 0), (0.75, 0), (0.74, 0), (0.1, 0.89), (0.1, 0.91), (0.1, 0), (0, 0))
    found = decide(Overload(), 'degrade', *waits)
    assert found == [FILTER, DEGRADE, PASS, DEGRADE, PASS, PASS, DEGRADE, FILTER]


def test_the_verdict_takes_time_too() -> None:
    """What clouds took of late is kept for the next one, a tenth to half of max_delay."""
    overload = Overload()
    assert overload.lead(1.0) == 0.1
    overload.took(0.3)
    assert overload.lead(1.0) == 0.3
    assert overload.lead(0.4) == 0.2
    assert overload.lead(10.0) == 1.0
    assert decide(overload, 'drop_oldest', (0.1, 0.69), (0.1, 0.71)) == [FILTER, DROP]
    for _ in range(10):
        overload.took(0.0)
    assert 0.1 < overload.lead(1.0) < 0.2
    for _ in range(30):
        overload.took(0.0)
    assert overload.lead(1.0) == 0.1
