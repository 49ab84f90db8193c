# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The node as a process among others: live clouds over DDS, signals, exit statuses."""

import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import rclpy
from helpers import ROOT
from helpers.live import (
    ARRIVAL,
    clouds,
    collector,
    diagnoser,
    environment,
    filtering,
    next_status,
    publisher,
)
from helpers.nodes import flush, process
from helpers.programs import Program, ended
from rclpy.context import Context
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2

from lidar_outlier_filter.core.kernels.threads import cores
from lidar_outlier_filter.pipeline.pipeline import SplitCloud
from lidar_outlier_filter.ros.node import OutlierFilterNode, remappings

TOPIC = '/velodyne_points'
OUTPUTS = ('cleaned', 'outliers')
# No cloud may be lost by a short queue, and none flushed early by a slow machine.
PARAMETERS = f"""
/**:
  ros__parameters:
    max_delay: 600
    qos_overrides:
      {TOPIC}:
        subscription: {{reliability: reliable, depth: 100}}
"""


def filter_process(folder: Path, env: dict[str, str], parameters: str = PARAMETERS) -> Program:
    """Start the node on ``TOPIC`` with a parameter file."""
    path = folder / 'parameters.yaml'
    path.write_text(parameters, encoding='utf-8')
    remap = [word for old, new in remappings(TOPIC) for word in ('-r', f'{old}:={new}')]
    return filtering('--params-file', str(path), *remap, env=env)


def direct_outputs(recording: Path, blocks: str = 'time') -> list[SplitCloud]:
    """Filter a recording by calling the node in this process, as a replay does."""
    context = Context()
    rclpy.init(args=[], context=context)
    given = {'blocks': blocks}
    node = OutlierFilterNode(parameters=given, context=context, use_global_arguments=False)
    messages = [deserialize_message(data, PointCloud2) for data in clouds(recording)]
    results = [result for msg in messages for result in process(node, msg)] + flush(node)
    node.destroy_node()
    context.try_shutdown()
    assert len(results) == len(messages)
    assert sum(result.outliers.width for result in results) > 0
    return results


@pytest.mark.slow
@pytest.mark.parametrize(
    ('name', 'number', 'blocks'),
    [('vlp16_mrpt_mcap', signal.SIGINT, 'time'), ('os1_128_db3', signal.SIGTERM, 'auto')],
)
def test_live_equals_replay(
    recordings: Path, tmp_path: Path, name: str, number: signal.Signals, blocks: str
) -> None:
    """One process publishes, one filters, one collects: the very bytes that a direct call gives.

    The filter is said to go as soon as it has received the last cloud. What it has not served, and
    what waits for more to come, is judged and published before it exits with status 0.
    """
    env = environment()
    recording = recordings / 'bags' / name
    topics = [f'{TOPIC}/{kind}' for kind in OUTPUTS]
    given = f'{PARAMETERS}    blocks: {blocks}\n'
    with (
        collector(tmp_path, topics, env) as collecting,
        filter_process(tmp_path, env, given) as node,
    ):
        collecting.wait_for('matched')
        node.wait_for('filters')
        with publisher(recording, TOPIC, env) as publishing:
            publishing.send('go')
            publishing.wait_for('published')
            node.signal(number)
            assert node.wait() == 0
        collecting.close()
        assert collecting.wait() == 0
    assert 'Traceback' not in '\n'.join(node.output)
    expected = direct_outputs(recording, blocks)
    assert len(list(tmp_path.glob('*.cdr'))) == len(expected) * len(OUTPUTS)
    for index, result in enumerate(expected):
        for kind, cloud in zip(OUTPUTS, (result.cleaned, result.outliers), strict=True):
            received = (tmp_path / f'{kind}_{index}.cdr').read_bytes()
            # Not the serialised bytes: what is between aligned fields is random.
            assert deserialize_message(received, PointCloud2) == cloud


def test_large_clouds_arrive_best_effort(recordings: Path, tmp_path: Path) -> None:
    """With the profile of config/, clouds of 6 MB arrive without being repeated."""
    env = environment()
    recording = recordings / 'bags' / 'os1_128_db3'
    with (
        collector(tmp_path, [TOPIC], env, 'best_effort') as collecting,
        publisher(recording, TOPIC, env, 'best_effort') as publishing,
    ):
        collecting.wait_for('matched')
        publishing.send('go')
        for _ in clouds(recording):
            collecting.wait_for('received', ARRIVAL)
    received = [path.read_bytes() for path in sorted(tmp_path.glob('*.cdr'))]
    assert received == clouds(recording)


@pytest.mark.slow
def test_clouds_lost_on_the_way_are_counted(recordings: Path, tmp_path: Path) -> None:
    """Without the profile large clouds are lost; the node learns of it, and names the profile."""
    env = environment()
    del env['FASTRTPS_DEFAULT_PROFILES_FILE']
    names = ('vlp16_mrpt_mcap', 'os1_128_db3', 'vlp16_mrpt_mcap')  # 0.4 MB, 6 MB, 0.4 MB
    paths = ':'.join(str(recordings / 'bags' / name) for name in names)
    with (
        diagnoser(env) as diagnosing,
        filter_process(tmp_path, env, '/**: {ros__parameters: {}}') as node,
        publisher(paths, TOPIC, env, 'best_effort') as publishing,
    ):
        next_status(diagnosing)
        lost = '0'
        # The next cloud that arrives shows a loss: again, should the last one be lost too.
        while lost == '0':
            publishing.send('go')
            publishing.wait_for('published')
            status = next_status(diagnosing)
            lost = status['values']['lost']
        assert status['name'] == f'outlier_filter_node: {TOPIC}'
        assert status['level'] > 0
        assert 'lost in transit' in status['message']
        assert 'fastdds_large_clouds.xml' in status['message']
        node.signal(signal.SIGTERM)
        assert node.wait() == 0


@pytest.mark.parametrize(
    ('module', 'number'),
    [
        ('numpy', signal.SIGINT),
        ('diagnostic_msgs.msg', signal.SIGTERM),
        ('rclpy.node', signal.SIGINT),
    ],
)
def test_stopped_while_it_loads(module: str, number: signal.Signals) -> None:
    """In the midst of the imports: status 0, and not a word."""
    env = environment() | {'PYTHONPROFILEIMPORTTIME': '1'}
    with Program('-m', 'lidar_outlier_filter.cli.node', env=env) as node:
        node.wait_for('| lidar_outlier_filter')
        node.wait_for(f' {module}')
        node.signal(number)
        assert node.wait() == 0
    assert [line for line in node.output if not line.startswith('import time:')] == []


@pytest.mark.parametrize(
    ('text', 'sentence'),
    [
        (
            '/**: {ros__parameters: {gap_factr: 2}}',
            "outlier_filter_node: a parameter must .*'gap_factr' .*gap_factor.*",
        ),
        (
            f'/**: {{ros__parameters: {{qos_overrides.{TOPIC}.subscription.reliability: loose}}}}',
            '.*`loose`',
        ),
        ('no: parameters', 'outlier_filter_node: failed to initialize rcl: .*'),
    ],
)
def test_refused_parameters(tmp_path: Path, text: str, sentence: str) -> None:
    """A file that makes no sense, to the node or to ROS, ends the start with status 1."""
    with filter_process(tmp_path, environment(), text) as node:
        assert node.wait() == 1
    assert re.fullmatch(sentence, node.output[-1])
    assert 'Traceback' not in '\n'.join(node.output)


def test_threads_of_a_node_that_is_ready(tmp_path: Path) -> None:
    """Those of the middleware and a few for each core, whatever was compiled before."""
    with filter_process(tmp_path, environment(), '/**: {ros__parameters: {}}') as node:
        node.wait_for('is ready')
        count = len(list(Path(f'/proc/{node.pid}/task').iterdir()))
        node.signal(signal.SIGTERM)
        assert node.wait() == 0
    assert count <= 20 + 4 * cores()


def test_operated_without_ros2() -> None:
    """The example of the pages operates one of two nodes; status 1 is a refusal."""
    env, program = environment(), ROOT / 'doc/examples/operate.py'
    refused = ended(sys.executable, program, '/outlier_filter_node', 'start', env=env)
    assert refused.stderr.startswith('the arguments must be NODE and one of: diagnostics, set ')
    run = ('-m', 'lidar_outlier_filter.cli.node')
    beside = (*run, '--ros-args', '-r', '__ns:=/another')
    with Program(*beside, env=env) as another, Program(*run, '--lifecycle', env=env) as node:
        another.wait_for('is ready')
        node.wait_for('waiting to be configured')
        for words, response in (
            ('activate', 'success=False'),
            ('configure', 'success=True'),
            ('activate', 'success=True'),
            ('set scores true', 'successful=True'),
            ('set vote -1', 'successful=False'),
            ('enable false', "message='clouds pass unfiltered'"),
            ('diagnostics', 'disabled: clouds pass unfiltered\n  clouds/s: '),
        ):
            done = ended(sys.executable, program, '/outlier_filter_node', *words.split(), env=env)
            assert response in done.stdout
            assert done.returncode == response.endswith('=False')
        node.signal(signal.SIGTERM)
        assert node.wait() == 0


def test_a_recording_is_played_without_ros2(recordings: Path, tmp_path: Path) -> None:
    """The example of the pages publishes the bytes of a recording when somebody listens."""
    recording, env = recordings / 'bags' / 'vlp16_mrpt_mcap', environment()
    with collector(tmp_path, [TOPIC], env) as collecting:
        ended(sys.executable, ROOT / 'doc/examples/play.py', recording, '20', env=env)
        collecting.close()
        assert collecting.wait() == 0
    received = [path.read_bytes() for path in sorted(tmp_path.glob('*.cdr'))]
    assert received == clouds(recording)


# What it finishes takes hours: it waits for a thread, or computes, as a kernel does.
PROGRAM = """
import threading
from lidar_outlier_filter.ros.executable import on_stop

stop = threading.Event()
on_stop(stop.set)
print('ready', flush=True)
stop.wait()
print('finishing', flush=True)
{busy}
"""
WAITS = 'threading.Event().wait()'
COMPUTES = 'sum(range(10**15))'  # in C: Python handles no signal before it ends


@pytest.mark.parametrize(
    ('first', 'second', 'busy'),
    [
        (signal.SIGINT, signal.SIGINT, WAITS),
        (signal.SIGTERM, signal.SIGTERM, COMPUTES),
        (signal.SIGINT, signal.SIGTERM, COMPUTES),
    ],
)
def test_the_second_ends_it_at_once(
    first: signal.Signals, second: signal.Signals, busy: str
) -> None:
    """Whichever they are, and whatever runs."""
    command = [sys.executable, '-c', PROGRAM.format(busy=busy)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == 'ready\n'
        process.send_signal(first)
        assert process.stdout.readline() == 'finishing\n'
        process.send_signal(second)
        assert process.wait(60) == -second


def test_without_ros() -> None:
    """One sentence names what to do."""
    run = "import sys; sys.modules['rclpy'] = None; from lidar_outlier_filter.cli.node import main"
    done = ended(sys.executable, '-c', f'{run}; sys.exit(main([]))')
    assert (done.returncode, done.stdout) == (1, '')
    assert done.stderr == (
        'the module rclpy must be installed for this command: source ROS 2, or '
        "pip install '.[ros]' in the project, got none\n"
    )
