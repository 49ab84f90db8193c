# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The end of a node: all received clouds are published first, whichever thread runs when."""

import sys
import threading

import pytest
from helpers.nodes import Ros, hold_up, line
from helpers.overload import results, send, start
from helpers.programs import TIMEOUT
from rclpy.serialization import serialize_message

from lidar_outlier_filter.pipeline.pipeline import SplitCloud


def test_large_clouds_at_the_end(ros: Ros) -> None:
    """While they are read, threads take turns: the one that filters does not end too soon."""
    node, sensor = start(ros, load__clouds=1, max_points=10**7)
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:
        for number in range(20):
            sensor.publish(line(0.01 * number, 20_000), expected=10**9)
        node.finish()
    finally:
        sys.setswitchinterval(before)
    assert [number for number, _ in results(ros, sensor, 20)] == list(range(20))
    assert node.channels[0].waiting == node.channels[0].health._missed['dropped'] == 0


@pytest.mark.parametrize('policy', ['drop_oldest', 'pass_through', 'degrade'])
def test_at_the_end_nothing_is_too_much(ros: Ros, policy: str) -> None:
    """Whatever is done with too much else: all is filtered."""
    node, sensor = start(ros, load__policy=policy)
    for number in range(20):
        sensor.publish(line(0.01 * number), expected=10**9)
    assert sensor._publisher.wait_for_all_acked()
    node.finish()
    assert results(ros, sensor, 20) == [(number, 1) for number in range(20)]
    assert node.channels[0].statistics.bypassed == {}
    assert node.channels[0].statistics.degraded == 0


@pytest.mark.parametrize('in_turn', [False, True])
def test_the_end_while_the_filter_polls(ros: Ros, *, in_turn: bool) -> None:
    """What comes when it has just found nothing, and the end behind it, are still done."""
    node, sensor = start(ros)
    channel = node.channels[0]
    thread, advance = channel.worker._thread, channel._filter.advance
    assert thread is not None
    done: list[bool] = []

    def end_meanwhile() -> list[SplitCloud]:
        channel._filter.advance = advance  # type: ignore[method-assign]
        channel.worker.inbox.order(lambda: done.append(True), in_turn=in_turn)
        channel.worker.inbox.close([channel._noted(serialize_message(line(0.0)))])
        return advance()

    channel._filter.advance = end_meanwhile  # type: ignore[method-assign]
    channel.worker.inbox.wake()
    thread.join(TIMEOUT)
    assert done == [True]
    assert node.channels[0].waiting == 1
    assert channel.worker.inbox.clouds == 0
    node.finish()
    assert results(ros, sensor, 1) == [(0, 1)]


def test_commands_at_the_end_are_done_in_their_turn(ros: Ros) -> None:
    """Clouds that came before the filter was switched off are filtered, those after it pass."""
    node, sensor = start(ros)
    channel = node.channels[0]
    go_on = hold_up(node)
    send(ros, node, sensor, 3)
    channel.worker.enable(on=False)
    send(ros, node, sensor, 2, first=3)
    channel.worker.enable(on=True)
    channel.worker.flush_pending()
    for number in (5, 6):  # not served any more
        sensor.publish(line(0.01 * number), expected=10**9)
    sensor._publisher.wait_for_all_acked()
    channel.close()
    go_on.set()
    node.finish()
    found = [0 if number in (3, 4) else 1 for number in range(7)]
    assert results(ros, sensor, 7) == list(enumerate(found))


def test_stopped_with_clouds_in_wait(ros: Ros) -> None:
    """Nobody would learn of them: what waits is let go, and the thread ends."""
    node, sensor = start(ros)
    channel = node.channels[0]
    thread = channel.worker._thread
    assert thread is not None
    go_on = hold_up(node)
    send(ros, node, sensor, 3)
    stopping = threading.Thread(target=channel.stop)
    stopping.start()
    while not channel.worker.inbox.closed:
        ros.executor.spin_once(0.01)
    send(ros, node, sensor, 1)
    go_on.set()
    stopping.join(TIMEOUT)
    assert not thread.is_alive()
    assert node.channels[0].waiting == node.channels[0].statistics.messages == 0
    assert channel.health._missed['dropped'] == 1
