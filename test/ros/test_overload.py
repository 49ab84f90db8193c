# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A node that is given more than it can filter, and its end: all received clouds come first."""

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from helpers.nodes import Ros, Sensor, hold_up, line, wait_for_thread
from helpers.programs import TIMEOUT
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2

from lidar_outlier_filter.core.detectors.builtin import AlphaBetaGamma
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.pipeline import SplitCloud
from lidar_outlier_filter.ros.backlog import Treatment
from lidar_outlier_filter.ros.node import OutlierFilterNode

# Blocks of one cloud, which no halo holds up; half of the queue is five clouds.
SHORT = {
    'chain': ['alpha_beta_gamma'],
    'line_source': 'message',
    'block': 0.01,
    'halo': 0.0,
    'max_delay': 60.0,
    'load.clouds': 10,
}


def send(ros: Ros, node: OutlierFilterNode, sensor: Sensor, count: int, first: int = 0) -> None:
    """Publish clouds of 10 ms with one outlier each, and serve until the node has received them."""
    health = node.channels[0].health
    before = health._tally.clouds
    for number in range(first, first + count):
        sensor.publish(line(0.01 * number), expected=10**9)
        while health._tally.clouds == before:
            ros.executor.spin_once(0.05)
        before = health._tally.clouds


def start(ros: Ros, **parameters: object) -> tuple[OutlierFilterNode, Sensor]:
    """Start a node, and a sensor that is connected to it. Nothing samples its health meanwhile."""
    node = ros.filter(
        parameters=SHORT | {key.replace('__', '.'): parameters[key] for key in parameters}
    )
    node.start()
    node._diagnostics._timer.cancel()
    sensor = Sensor(ros, '/points')
    sensor.wait_for_filter(node)
    return node, sensor


def results(ros: Ros, sensor: Sensor, count: int) -> list[tuple[int, int]]:
    """Serve until there are so many outputs: number of the cloud, and its outliers."""
    ros.serve_while(lambda: len(sensor.outliers) < count)
    return [(_number(msg), msg.width) for msg in sensor.outliers]


def _number(msg: PointCloud2) -> int:
    stamp, first = msg.header.stamp, line(0.0).header.stamp
    seconds: float = stamp.sec - first.sec + (stamp.nanosec - first.nanosec) * 1e-9
    return round(100 * seconds)


@contextmanager
def held_up(node: OutlierFilterNode) -> Iterator[None]:
    """Hold up the thread that filters for a while."""
    go_on = hold_up(node)
    yield
    go_on.set()
    wait_for_thread(node)


def test_what_waits_is_reported(ros: Ros) -> None:
    """Clouds and bytes to be filtered, clouds without output, who publishes, what is done."""
    node, sensor = start(ros, block=0.1)
    channel = node.channels[0]
    send(ros, node, sensor, 1)
    wait_for_thread(node)
    with held_up(node):
        send(ros, node, sensor, 3, first=1)
        plotted = channel.sample(2.0).plotted
    assert plotted['clouds_per_second'] == 2
    assert plotted['points_per_second'] == 50  # those of one cloud were read
    assert plotted['backlog_clouds'] == 3
    assert plotted['backlog_megabytes'] == pytest.approx(3e-6 * len(serialize_message(line(0.0))))
    assert plotted['waiting_clouds'] == 1
    channel.worker.overload.treatment = Treatment.DEGRADE
    message = channel.sample(3.0).message
    assert 'no cloud for 3 s, publishers: 1 (' in message
    assert 'overload: clouds are filtered along scan lines only' in message


@pytest.mark.parametrize(
    ('policy', 'lost', 'filtered'),
    [('drop_oldest', '15 dropped', 10), ('pass_through', '15 dropped, 9 passed unfiltered', 1)],
)
def test_what_does_not_fit_is_dropped(
    ros: Ros, capfd: pytest.CaptureFixture[str], policy: str, lost: str, filtered: int
) -> None:
    """The oldest first, and counted; a line at the end names the policy and all losses."""
    node, sensor = start(ros, load__policy=policy)
    with held_up(node):
        send(ros, node, sensor, 25)
        assert node.channels[0].waiting == 10
    node.finish()
    found = [(number, int(number >= 25 - filtered)) for number in range(15, 25)]
    assert results(ros, sensor, 10) == found
    assert node.channels[0].statistics.messages == 10
    assert node.channels[0].health._missed['dropped'] == 15
    said = [line for line in capfd.readouterr().err.splitlines() if 'not filtered fully' in line]
    (line_,) = said
    assert line_.endswith(f'since the last warning: {lost} (load.policy is {policy})')
    assert '/points: ' in line_


def test_what_has_waited_too_long_is_dropped(ros: Ros) -> None:
    """Also where there is room: it could not be published within max_delay."""
    node, sensor = start(ros, max_delay=0.4, load__clouds=100)
    with held_up(node):
        send(ros, node, sensor, 20)
        clock = node.channels[0]._clock
        oldest = node.channels[0].worker.inbox._items[18].at  # type: ignore[union-attr]
        ros.serve_while(lambda: clock.now() - oldest < 0.4e9)
    node.finish()
    # The newest is filtered: nothing is gained by dropping it.
    assert results(ros, sensor, 1) == [(19, 1)]
    assert node.channels[0].health._missed['dropped'] == 19


def test_what_passes_waits_for_nobody(ros: Ros) -> None:
    """Clouds before it are published at once: their blocks would not be complete soon."""
    node, sensor = start(ros, load__policy='pass_through', block=0.1, max_delay=60.0)
    send(ros, node, sensor, 1)
    wait_for_thread(node)
    assert node.channels[0].waiting == 1
    with held_up(node):
        send(ros, node, sensor, 9, first=1)
    # Behind the last one nothing waits: it is filtered.
    assert (node.channels[0].statistics.messages, node.channels[0].waiting) == (9, 1)
    assert node.channels[0].statistics.bypassed == {'overload': 8}


def test_degrade(ros: Ros) -> None:
    """The slow detectors are off while there is too much; each cloud is tested along its line."""
    node, sensor = start(
        ros, chain=['alpha_beta_gamma', 'sor'], load__policy='degrade', sor__multiplier=0.0
    )
    with held_up(node):
        send(ros, node, sensor, 7)
    send(ros, node, sensor, 3, first=7)
    wait_for_thread(node)
    node.finish()
    # A cloud is judged with the next one, and behind the seventh nothing waits; with this
    # multiplier sor rejects many.
    found = [width > 10 for _, width in results(ros, sensor, 10)]
    assert found == [False] * 5 + [True] * 5
    assert [width for _, width in results(ros, sensor, 10)][:5] == [1] * 5
    assert node.channels[0].statistics.degraded == 6


@pytest.mark.parametrize(
    'parameters',
    [
        {'chain': ['boosted_trees']},
        {'chain': ['sor']},
        {'chain': ['alpha_beta_gamma', 'sor'], 'vote': 2},
    ],
)
def test_nothing_to_degrade(ros: Ros, parameters: dict[str, object]) -> None:
    """Where the smoother alone could reject nothing, degraded clouds pass unfiltered."""
    node, sensor = start(ros, load__policy='degrade', **parameters)
    with held_up(node):
        send(ros, node, sensor, 7)
    node.finish()
    assert node.channels[0].statistics.bypassed == {'overload': 6}
    assert node.channels[0].statistics.degraded == 0


def test_the_policy_can_be_set(ros: Ros) -> None:
    """While it is too much."""
    node, sensor = start(ros)
    with held_up(node):
        send(ros, node, sensor, 9)
        assert ros.set(load__policy='pass_through', load__clouds=8) == ['', '']
        send(ros, node, sensor, 1, first=9)
    node.finish()
    assert node.channels[0].health._missed['dropped'] == 2
    assert node.channels[0].statistics.bypassed == {'overload': 7}


def test_the_end_of_the_thread_is_heard_of(ros: Ros) -> None:
    """An error that nobody foresaw ends the process, not the filtering alone."""
    node, sensor = start(ros)
    node.channels[0].worker.inbox.order(lambda: 1 / 0)
    thread = node.channels[0].worker._thread
    assert thread is not None
    thread.join(TIMEOUT)
    sensor.publish(line(0), expected=1)
    with pytest.raises(ZeroDivisionError):
        send(ros, node, sensor, 1)


def test_a_slider_stops_no_cloud(ros: Ros, monkeypatch: pytest.MonkeyPatch) -> None:
    """All clouds have output, and of the sets that came meanwhile only the newest is applied."""
    node, sensor = start(ros)
    channel = node.channels[0]
    applied: list[float] = []
    change = channel._filter.change

    def note(parameters: FilterParameters) -> None:
        applied.append(parameters.of(AlphaBetaGamma).significance)
        change(parameters)

    monkeypatch.setattr(channel._filter, 'change', note)
    significance = [1e-6 * (1 + step) for step in range(250)]
    client, replies = ros.parameters(), []
    with held_up(node):
        for number in range(5):
            for value in significance[50 * number :][:50]:
                changed = [Parameter('alpha_beta_gamma.significance', value=value)]
                replies.append(client.set_parameters(changed))
            send(ros, node, sensor, 1, first=number)
        for reply in replies:
            assert ros.wait(reply).results[0].successful
    node.finish()
    assert results(ros, sensor, 5) == [(number, 1) for number in range(5)]
    assert applied == significance[-1:]
    assert channel.statistics.failures == 0


# The end


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
    ros.serve_while(lambda: not channel.worker.inbox.closed)
    send(ros, node, sensor, 1)
    go_on.set()
    stopping.join(TIMEOUT)
    assert not thread.is_alive()
    assert node.channels[0].waiting == node.channels[0].statistics.messages == 0
    assert channel.health._missed['dropped'] == 1
