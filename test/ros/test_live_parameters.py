# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Tuning while clouds flow: what is set, saved, put back, and switched off and on again."""

import threading
from concurrent.futures import Future as Promise
from pathlib import Path
from typing import Any

import pytest
from helpers.nodes import Ros, values
from helpers.programs import TIMEOUT
from rcl_interfaces.msg import ParameterEvent
from rclpy.parameter import Parameter
from rclpy.task import Future
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import SetBool, Trigger

from lidar_outlier_filter.core.detectors.builtin import Quadric, Sor
from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.ros import live_parameters
from lidar_outlier_filter.ros.live_parameters import SAVED_HEADER, NodeAccess, _write_whole

SMOOTHER = ('-p', 'chain:=[alpha_beta_gamma]')


def test_saved_parameters_load(ros: Ros, tmp_path: Path) -> None:
    """What ~/save_parameters writes serves as --params-file: a second node is like the first."""
    path = tmp_path / 'new folder' / 'saved.yaml'
    node = ros.filter('-p', f'save_to:={path}', '-p', 'halo:=0.02')
    node.start()
    assert ros.set(alpha_beta_gamma__significance=1e-9, gap_factor=2.5) == ['', '']
    output = ros.call(Trigger, 'save_parameters', Trigger.Request())
    assert (output.success, output.message) == (True, str(path))
    assert [item.name for item in path.parent.iterdir()] == [path.name]
    again = ros.filter('--params-file', str(path), '-r', '__node:=again')
    assert values(again) == values(node)


@pytest.mark.parametrize(
    ('namespace', 'ros_home', 'save_to', 'expected'),
    [
        ('', 'ros', '', 'ros/outlier_filter_node.yaml'),
        ('/left/front', 'ros', '', 'ros/left.front.outlier_filter_node.yaml'),
        ('', '', '', '.ros/outlier_filter_node.yaml'),
        ('', 'ros', '~/two/folders/a.yaml', 'two/folders/a.yaml'),
    ],
)
def test_where_parameters_are_saved(  # noqa: PLR0913
    ros: Ros,
    namespace: str,
    ros_home: str,
    save_to: str,
    expected: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Without ``save_to`` where ROS keeps its files, by the node's name; folders are made."""
    monkeypatch.setenv('HOME', str(tmp_path))
    monkeypatch.setenv('ROS_HOME', str(tmp_path / ros_home) if ros_home else '')
    node = ros.filter(namespace=namespace, parameters={'save_to': save_to})
    node.start()
    for _ in range(2):
        output = ros.call(Trigger, 'save_parameters', Trigger.Request(), namespace)
        assert (output.success, output.message) == (True, str(tmp_path / expected))
    assert (tmp_path / expected).is_file()


def test_all_that_a_node_has_can_be_loaded_into_it(ros: Ros) -> None:
    """One by one, as by ``ros2 param load``, or together: also what is read-only, as it is."""
    node = ros.filter('-p', 'halo:=0.02')
    node.start()
    names = [str(name) for name in node.list_parameters([], 0).names]
    loaded = {name.replace('.', '__'): node.get_parameter(name).value for name in names}
    assert {'inputs', 'qos_overrides__/points__subscription__depth'} < set(loaded)
    before = values(node)
    assert set(ros.set(**loaded)) == {''}
    assert ros.set_together(**loaded) == ''
    assert values(node) == before


def test_numbers_may_be_text(ros: Ros) -> None:
    """So ros2cli hands over what YAML 1.1 takes for no number, and 2 as an integer."""
    node = ros.filter()
    assert ros.set(gap_factor=2) == ['']
    assert node.get_parameter('gap_factor').type_ is Parameter.Type.DOUBLE
    assert ros.set(quadric__significance='1e-06', sor__k='12') == ['', '']
    assert (node.filter_parameters.of(Quadric).significance, node.filter_parameters.of(Sor).k) == (
        1e-6,
        12,
    )
    (reason,) = ros.set(sor__k='12.5')
    assert reason == "sor.k must be a whole number, got '12.5'"


@pytest.mark.parametrize('name', ['~nosuch/x', '/', '..', 'x' * 300])
def test_a_name_that_no_file_can_have(
    ros: Ros, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The caller is said why nothing was saved, and the node serves on."""
    monkeypatch.chdir(tmp_path)
    node = ros.filter(parameters={'save_to': name})
    node.start()
    output = ros.call(Trigger, 'save_parameters', Trigger.Request())
    assert not output.success
    said = 'the parameters were not saved: the file must be one that can be written, got '
    assert output.message.startswith(said)
    assert list(tmp_path.iterdir()) == []
    assert ros.set(save_to=str(tmp_path / 'saved.yaml')) == ['']
    assert ros.call(Trigger, 'save_parameters', Trigger.Request()).success


def test_reset_puts_parameters_back(ros: Ros) -> None:
    """All parameters are again as at the start, together, and ROS learns which changed."""
    node = ros.filter('-p', 'gap_factor:=3.0', parameters={'alpha_beta_gamma.after': 8})
    node.start()
    before = values(node)
    changes = {'alpha_beta_gamma__order': 2, 'alpha_beta_gamma__before': 6}
    assert ros.set_together(gap_factor=2.0, **changes) == ''
    result: Future = Future()

    def note(event: ParameterEvent) -> None:
        if event.node == '/outlier_filter_node':
            result.set_result({item.name for item in event.changed_parameters})

    ros.client.create_subscription(ParameterEvent, '/parameter_events', note, 10)
    ros.serve_while(lambda: not node.count_subscribers('/parameter_events'))
    output = ros.call(Trigger, 'reset', Trigger.Request())
    changed = ['gap_factor', 'alpha_beta_gamma.before', 'alpha_beta_gamma.order']
    assert (output.success, output.message) == (
        True,
        f'reset to start values: {", ".join(changed)}',
    )
    assert values(node) == before
    assert node.filter_parameters.gap_factor == 3.0
    assert ros.wait(result) == set(changed)
    output = ros.call(Trigger, 'reset', Trigger.Request())
    assert (output.success, output.message) == (True, 'reset to start values: nothing to do')


def test_changes_are_logged_once(ros: Ros, capfd: pytest.CaptureFixture[str]) -> None:
    """Each change of parameters, and each change between filtering and passing, is one line."""
    node = ros.filter(*SMOOTHER)
    node.start()
    capfd.readouterr()
    assert ros.set(gap_factor=4.0) == ros.set(gap_factor=4.0) == ['']
    ros.call(SetBool, 'enable', SetBool.Request(data=False))
    said = capfd.readouterr().err
    assert said.count('parameters set: gap_factor: 4.0\n') == 1
    assert said.count('now: clouds pass unfiltered\n') == 1


def test_disabled_clouds_pass(ros: Ros, sweeps: list[PointCloud2]) -> None:
    """Off, clouds pass as they are, in order, counted; what waited is judged."""
    node = ros.filter('-p', 'max_delay:=600.0', *SMOOTHER)
    sensor = ros.sensor(node)
    sensor.publish(sweeps[0], expected=1)
    ros.serve_while(lambda: node.channels[0].statistics.messages + node.channels[0].waiting == 0)
    output = ros.call(SetBool, 'enable', SetBool.Request(data=False))
    assert (output.success, output.message) == (True, 'clouds pass unfiltered')
    for number in (1, 2):
        sensor.publish(sweeps[number], expected=number + 1)
        sensor.wait_for_outputs()
    assert ros.call(SetBool, 'enable', SetBool.Request(data=True)).message == 'filtering'
    sensor.publish(sweeps[3], expected=4)
    ros.serve_while(lambda: node.channels[0].statistics.messages + node.channels[0].waiting == 3)
    node.finish()
    sensor.wait_for_outputs()
    assert [msg.header for msg in sensor.cleaned] == [msg.header for msg in sweeps]
    assert [msg.width > 100 for msg in sensor.outliers] == [True, False, False, True]
    assert [msg.width for msg in sensor.outliers][1:3] == [0, 0]
    assert [bytes(msg.data) for msg in sensor.cleaned[1:3]] == [
        bytes(msg.data) for msg in sweeps[1:3]
    ]
    assert node.channels[0].statistics.bypassed == {'disabled': 2}
    assert node.channels[0].statistics.messages == 4
    assert node.channels[0].statistics.points == sum(msg.width for msg in sweeps)


@pytest.mark.parametrize('begin', [SAVED_HEADER, '# mine\n'])
def test_no_more_is_read_of_a_file_than_its_first_line(tmp_path: Path, begin: str) -> None:
    """It may be larger than memory."""
    path = tmp_path / 'saved.yaml'
    path.write_text(begin)
    with path.open('r+b') as stream:
        stream.truncate(2**42)  # sparse
    if begin == SAVED_HEADER:
        _write_whole(path, 'new: 1\n')
        assert path.read_text() == SAVED_HEADER + 'new: 1\n'
    else:
        with pytest.raises(ParameterError, match='the file must be new, or saved by'):
            _write_whole(path, '')
    # Empty, by its size; reading it waits for the kernel to say something.
    with pytest.raises(ParameterError, match='the file must be new, or saved by'):
        _write_whole(Path('/proc/kmsg'), '')


@pytest.mark.parametrize('kind', ['file', 'link', 'edited'])
def test_a_file_of_somebody_else_is_kept(ros: Ros, tmp_path: Path, kind: str) -> None:
    """Only a file that was saved before is replaced, and no symbolic link."""
    saved, other = tmp_path / 'saved.yaml', tmp_path / 'other.yaml'
    node = ros.filter('-p', f'save_to:={saved}')
    node.start()
    if kind == 'link':
        assert ros.set(save_to=str(other)) == ['']
        assert ros.call(Trigger, 'save_parameters', Trigger.Request()).success
        saved.symlink_to(other)
        assert ros.set(save_to=str(saved)) == ['']
    else:
        saved.write_text('notes: of mine\n' if kind == 'file' else '# mine\n/**:\n')
    before = saved.read_text()
    output = ros.call(Trigger, 'save_parameters', Trigger.Request())
    assert not output.success
    assert 'the file must be new, or saved by ~/save_parameters, got' in output.message
    assert saved.read_text() == before
    assert saved.is_symlink() == (kind == 'link')


# What a page sets, from a thread that is not the executor's

NAME = 'gap_factor'
LATE = 'the node did not reply within 0.01 s'


def test_a_change_that_is_given_up_is_not_made(ros: Ros, monkeypatch: pytest.MonkeyPatch) -> None:
    """A node that serves again later does not do what its page said was not done."""
    monkeypatch.setattr(live_parameters, 'NODE_TIMEOUT', 0.01)
    node = ros.filter()
    before = node.get_parameter(NAME).value
    assert NodeAccess(node).set({NAME: '7.5'}) == LATE
    assert ros.set(sor__k=12) == ['']
    assert node.get_parameter(NAME).value == before != 7.5


def test_a_change_that_is_begun_is_waited_for(ros: Ros, monkeypatch: pytest.MonkeyPatch) -> None:
    """However long it takes: what is said of it is true."""
    begun, given_up = threading.Event(), threading.Event()

    class Impatient(Promise[str]):
        def result(self, timeout: float | None = None) -> str:
            if timeout is not None:  # it runs out when the change has begun
                assert begun.wait(TIMEOUT)
                raise TimeoutError
            return super().result()

        def cancel(self) -> bool:
            given_up.set()
            return super().cancel()

    monkeypatch.setattr(live_parameters, 'Future', Impatient)
    node = ros.filter()
    set_really = node.set_parameters_atomically

    def set_slowly(values: Any) -> Any:
        begun.set()
        assert given_up.wait(TIMEOUT)
        return set_really(values)

    monkeypatch.setattr(node, 'set_parameters_atomically', set_slowly)
    said: list[str] = []
    page = threading.Thread(target=lambda: said.append(NodeAccess(node).set({NAME: '7.5'})))
    page.start()
    ros.serve_while(page.is_alive)
    assert said == ['']
    assert node.get_parameter(NAME).value == 7.5
