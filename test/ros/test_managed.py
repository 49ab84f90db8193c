# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The managed node, driven through its services with the real middleware."""

import pytest
from helpers.nodes import Ros, Sensor, line
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState

from lidar_outlier_filter.parameters.yaml_files import NODE_NAME
from lidar_outlier_filter.ros.node import ManagedFilterNode

OUTPUTS = {'/points/cleaned', '/points/outliers'}


class Manager:
    """Asks a node for transitions, as a manager of a stack does."""

    def __init__(self, ros: Ros) -> None:
        self._ros = ros

    def change(self, transition: int) -> bool:
        """Ask for a transition; return whether it succeeded."""
        request = ChangeState.Request(transition=Transition(id=transition))
        return bool(self._ros.call(ChangeState, 'change_state', request).success)

    def state(self) -> int:
        """Ask for the state."""
        return int(self._ros.call(GetState, 'get_state', GetState.Request()).current_state.id)


def make(ros: Ros, **parameters: object) -> tuple[ManagedFilterNode, Manager]:
    """Start a managed node. Its blocks are longer than what a test sends: all clouds wait."""
    node = ManagedFilterNode(
        context=ros.context, parameters={'block': 50.0, 'max_delay': 600.0} | parameters
    )
    ros.add(node)
    node.start()
    return node, Manager(ros)


def topics(node: ManagedFilterNode) -> tuple[set[str], bool]:
    """Return which of the outputs are advertised, and whether clouds are subscribed to."""
    published = node.get_publisher_names_and_types_by_node(NODE_NAME, '/')
    subscribed = [item.topic_name for item in node.subscriptions]
    return OUTPUTS & {name for name, _ in published}, '/points' in subscribed


def send(ros: Ros, node: ManagedFilterNode, sensor: Sensor, first: int, count: int) -> None:
    """Publish clouds, and serve until the node has received them."""
    channel = node.channels[0]
    sensor.wait_for_filter(node)
    before = channel.statistics.messages + channel.waiting
    for number in range(first, first + count):
        sensor.publish(line(0.01 * number), expected=10**9)
    ros.serve_while(lambda: channel.statistics.messages + channel.waiting < before + count)


def receive(ros: Ros, sensor: Sensor, count: int) -> None:
    """Serve until so many clouds have both outputs."""
    ros.serve_while(lambda: min(len(sensor.cleaned), len(sensor.outliers)) < count)


def test_from_state_to_state(ros: Ros, capfd: pytest.CaptureFixture[str]) -> None:
    """Clouds received while it is active are published; nothing is received or sent otherwise."""
    node, manager = make(ros)
    for number in (Transition.TRANSITION_ACTIVATE, 99):  # the state lacks them
        assert not manager.change(number)
    assert manager.state() == State.PRIMARY_STATE_UNCONFIGURED
    assert topics(node) == (set(), False)
    assert manager.change(Transition.TRANSITION_CONFIGURE)
    assert manager.state() == State.PRIMARY_STATE_INACTIVE
    assert topics(node) == (OUTPUTS, False)
    assert 'is ready' not in capfd.readouterr().err
    assert manager.change(Transition.TRANSITION_ACTIVATE)
    assert topics(node) == (OUTPUTS, True)
    assert 'is ready' in capfd.readouterr().err
    sensor = Sensor(ros, '/points')
    send(ros, node, sensor, 0, 5)
    assert sensor.cleaned == []
    assert manager.change(Transition.TRANSITION_DEACTIVATE)
    assert topics(node) == (OUTPUTS, False)
    receive(ros, sensor, 5)
    sensor.publish(line(1.0), expected=10**9)
    assert ros.set(gap_factor=1.7) == ['']
    assert manager.change(Transition.TRANSITION_ACTIVATE)
    send(ros, node, sensor, 200, 3)
    assert manager.change(Transition.TRANSITION_DEACTIVATE)
    receive(ros, sensor, 8)
    assert node.channels[0].statistics.messages == 8
    stamps = [msg.header.stamp for msg in sensor.outliers]
    sent = [*range(5), *range(200, 203)]
    assert stamps == [line(0.01 * number).header.stamp for number in sent]
    assert manager.change(Transition.TRANSITION_CLEANUP)
    assert topics(node) == (set(), False)


def test_configured_anew(ros: Ros) -> None:
    """After a cleanup the node filters by what the parameters are then."""
    node, manager = make(ros, chain=['lof'])
    for chain in (['lof'], ['sor', 'lof']):
        ros.set(chain=chain)
        assert list(node.filter_parameters.chain) == chain
        assert manager.change(Transition.TRANSITION_CONFIGURE)
        assert manager.change(Transition.TRANSITION_ACTIVATE)
        sensor = Sensor(ros, '/points')
        send(ros, node, sensor, 0, 2)
        assert list(node.channels[0]._filter.parameters.chain) == chain
        assert manager.change(Transition.TRANSITION_DEACTIVATE)
        receive(ros, sensor, 2)
        assert manager.change(Transition.TRANSITION_CLEANUP)
        sensor.destroy()


def test_a_shutdown_loses_nothing(ros: Ros) -> None:
    """From the active state, too."""
    node, manager = make(ros)
    assert manager.change(Transition.TRANSITION_CONFIGURE)
    assert manager.change(Transition.TRANSITION_ACTIVATE)
    sensor = Sensor(ros, '/points')
    send(ros, node, sensor, 0, 4)
    assert manager.change(Transition.TRANSITION_ACTIVE_SHUTDOWN)
    receive(ros, sensor, 4)
    assert manager.state() == State.PRIMARY_STATE_FINALIZED
    assert topics(node) == (set(), False)


def test_a_configuration_that_is_refused(ros: Ros, capfd: pytest.CaptureFixture[str]) -> None:
    """The node says why, and may be configured again."""
    _, manager = make(ros, inputs=['left', '/left'])
    assert not manager.change(Transition.TRANSITION_CONFIGURE)
    assert 'not configured: inputs must be different topics' in capfd.readouterr().err
    assert manager.state() == State.PRIMARY_STATE_UNCONFIGURED
