# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Live tests: what starts the processes, and those to publish, collect, count, diagnose.

    live.py publish QOS RECORDING TOPIC     all clouds of a recording, or several with : between,
                                            when said to
    live.py collect QOS FOLDER TOPIC ...    every cloud to FOLDER/<last word of TOPIC>_<number>.cdr
    live.py count TOPIC                     say how many clouds came, when stdin is closed
    live.py diagnose                        every status of /diagnostics, as JSON
    live.py filter --ros-args ...           the node itself, which says when nothing is lost by it

QOS is reliable or best_effort. All say on stdout, one line each, what has happened, and go when
their stdin is closed; the node goes when a signal comes.
"""

from __future__ import annotations

import itertools
import json
import os
import sys
import threading
import time
import zlib
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import PointCloud2

from helpers import TESTS
from helpers.programs import Program
from lidar_outlier_filter.ros.executable import main as run

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from rclpy.node import Node

    from lidar_outlier_filter.ros.node import OutlierFilterNode

PROFILE = Path(__file__).parents[2] / 'config' / 'fastdds_large_clouds.xml'
# The same for a cloud that is on its way between two that are connected: nothing is compiled.
ARRIVAL = 240.0
CLOUD = 'sensor_msgs/msg/PointCloud2'
KEEP_ALL = QoSProfile(history=HistoryPolicy.KEEP_ALL)
BEST_EFFORT = QoSProfile(history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.BEST_EFFORT)


_started = itertools.count()


def new_domain() -> int:
    """Choose a ROS domain, from 1 to 100, that no other test of this run uses."""
    worker = int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0').removeprefix('gw'))
    workers = int(os.environ.get('PYTEST_XDIST_WORKER_COUNT', '1'))
    # Another run on this machine most likely begins elsewhere.
    run = os.environ.get('PYTEST_XDIST_TESTRUNUID', str(os.getpid()))
    return 1 + (zlib.crc32(run.encode()) + worker + workers * next(_started)) % 100


def environment() -> dict[str, str]:
    """Make the environment of the processes of one test: a domain of its own, on this machine."""
    return {
        'ROS_DOMAIN_ID': str(new_domain()),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'FASTRTPS_DEFAULT_PROFILES_FILE': str(PROFILE),
    }


def _start(*words: str | Path, env: Mapping[str, str]) -> Program:
    """Start one of the programs of this file."""
    paths = (str(TESTS), *filter(None, [env.get('PYTHONPATH') or os.environ.get('PYTHONPATH')]))
    return Program(__file__, *words, env={**env, 'PYTHONPATH': os.pathsep.join(paths)})


def publisher(
    recording: Path | str, topic: str, env: Mapping[str, str], qos: str = 'reliable'
) -> Program:
    """Start the program that publishes, when somebody listens, as often as it is said to go.

    It says 'published', if reliable when all has arrived. That somebody listens it learns before
    the listener does: what is sent best effort before that is lost.
    """
    return _start('publish', qos, recording, topic, env=env)


def collector(
    folder: Path, topics: list[str], env: Mapping[str, str], qos: str = 'reliable'
) -> Program:
    """Start the program that collects; it says 'matched' when every topic has a publisher.

    Each publisher learns of the collector at a time of its own, seconds later on a busy machine,
    and sends it nothing before: the node must say so, too, as :func:`filtering` does.
    """
    return _start('collect', qos, folder, *topics, env=env)


def filtering(*arguments: str, env: Mapping[str, str]) -> Program:
    """Start the node; it says 'filters' when its outputs are received.

    Clouds that come before that may be dropped, or filtered for nobody.

    Parameters
    ----------
    arguments : of ROS, those that follow ``--ros-args``
    env : added to the environment

    """
    return _start('filter', '--ros-args', *arguments, env=env)


def diagnoser(env: Mapping[str, str]) -> Program:
    """Start the program that says what is on /diagnostics."""
    return _start('diagnose', env=env)


def counter(topic: str, env: Mapping[str, str]) -> Program:
    """Start the program that counts; it says 'matched' when the topic has a publisher."""
    return _start('count', topic, env=env)


def next_status(program: Program) -> dict[str, Any]:
    """Wait for the next status of /diagnostics."""
    status: dict[str, Any] = json.loads(program.wait_for('status ').removeprefix('status '))
    return status


def clouds(recording: Path) -> list[bytes]:
    """Read the clouds of a recording as they are serialised in ROS 2."""
    with AnyReader([recording]) as reader:
        requested = [item for item in reader.connections if item.msgtype == CLOUD]
        return [bytes(data) for _, _, data in reader.messages(requested)]


@contextmanager
def _ros() -> Iterator[tuple[Node, SingleThreadedExecutor]]:
    rclpy.init(args=[])
    node = rclpy.create_node(f'live_{os.getpid()}')
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    yield node, executor
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()


def _say(*words: object) -> None:
    sys.stdout.write(' '.join(map(str, words)) + '\n')
    sys.stdout.flush()


def _publish(qos: QoSProfile, recordings: str, topic: str) -> None:
    messages = [data for path in recordings.split(':') for data in clouds(Path(path))]
    somebody = Future()
    with _ros() as (node, executor):
        events = PublisherEventCallbacks(matched=lambda _: somebody.set_result(None))
        publisher = node.create_publisher(PointCloud2, topic, qos, event_callbacks=events)
        executor.spin_until_future_complete(somebody)
        for _ in sys.stdin:
            for message in messages:
                publisher.publish(message)
            assert publisher.wait_for_all_acked(Duration(seconds=ARRIVAL))
            _say('published', time.monotonic())


def _collect(qos: QoSProfile, folder: Path, topics: list[str]) -> None:
    missing, end = set(topics), Future()

    def match(topic: str) -> None:
        if missing:
            missing.discard(topic)
            if not missing:
                _say('matched')

    with _ros() as (node, executor):
        inboxes = [
            _Inbox(node, topic, qos, folder / topic.rpartition('/')[2], match) for topic in topics
        ]
        threading.Thread(target=lambda: end.set_result(sys.stdin.read())).start()
        executor.spin_until_future_complete(end)
        for inbox in inboxes:
            inbox.empty()


class _Inbox:
    """Stores the clouds of one topic."""

    def __init__(
        self, node: Node, topic: str, qos: QoSProfile, path: Path, match: Callable[[str], object]
    ) -> None:
        self._path = path
        self._count = 0
        self._subscription = node.create_subscription(
            PointCloud2,
            topic,
            self._store,
            qos,
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(matched=lambda _: match(topic)),
        )

    def _store(self, data: bytes) -> None:
        path = self._path.with_name(f'{self._path.name}_{self._count}.cdr')
        path.write_bytes(data)
        self._count += 1
        _say('received', path.name, time.monotonic())

    def empty(self) -> None:
        """Store what has arrived and was not served."""
        with self._subscription.handle:
            while taken := self._subscription.handle.take_message(PointCloud2, True):  # noqa: FBT003
                self._store(taken[0])


def _count(topic: str) -> None:
    end, count = Future(), itertools.count()
    with _ros() as (node, executor):
        events = SubscriptionEventCallbacks(matched=lambda _: _say('matched'))
        listen = lambda _: next(count)  # noqa: E731
        node.create_subscription(
            PointCloud2, topic, listen, BEST_EFFORT, raw=True, event_callbacks=events
        )
        threading.Thread(target=lambda: end.set_result(sys.stdin.read())).start()
        executor.spin_until_future_complete(end)
        _say('clouds', next(count))


def _diagnose() -> None:
    end = Future()

    def note(msg: DiagnosticArray) -> None:
        for status in msg.status:
            found = {item.key: item.value for item in status.values}
            level = int.from_bytes(status.level, 'little')
            said = {'name': status.name, 'level': level, 'message': status.message}
            _say('status', json.dumps(said | {'values': found}))

    with _ros() as (node, executor):
        node.create_subscription(DiagnosticArray, '/diagnostics', note, KEEP_ALL)
        threading.Thread(target=lambda: end.set_result(sys.stdin.read())).start()
        executor.spin_until_future_complete(end)


def _filter() -> int:
    def watch(node: OutlierFilterNode) -> None:
        def check() -> None:
            if all(all(channel.publisher.requested) for channel in node.channels):
                timer.cancel()
                _say('filters')

        timer = node.create_timer(0.05, check, clock=Clock(clock_type=ClockType.STEADY_TIME))

    return run(attach=watch)


if __name__ == '__main__':
    role, quality, first, *rest = (*sys.argv[1:], '', '')
    profile = BEST_EFFORT if quality == 'best_effort' else KEEP_ALL
    if role == 'diagnose':
        _diagnose()
    elif role == 'count':
        _count(quality)
    elif role == 'filter':
        sys.exit(_filter())
    elif role == 'publish':
        _publish(profile, first, rest[0])
    else:
        _collect(profile, Path(first), [topic for topic in rest if topic])
