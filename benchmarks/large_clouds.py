# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Which share of large clouds a middleware loses between two processes, by size and by setting.

    python benchmarks/large_clouds.py [--seconds S] [--write]
    RMW_IMPLEMENTATION=rmw_cyclonedds_cpp python benchmarks/large_clouds.py --write
    python benchmarks/large_clouds.py --zenoh --write

Clouds of 1 to 6 MB are sent at 10 Hz, best effort and reliable, with a queue of five as drivers
have; nobody filters. ``--zenoh`` sends bytes of that size over Zenoh alone, without ROS; it needs
``pip install eclipse-zenoh``. ``--write`` puts the table of this middleware into
``doc/large_clouds.md``.
"""

# ruff: noqa: INP001, T201, PLC0415  a script, which prints, and imports one middleware

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lidar_outlier_lab.results.markdown import table, write

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

ROOT = Path(__file__).resolve().parents[1]
CONFIG = ROOT / 'config'
PAGE = ROOT / 'doc' / 'large_clouds.md'
COMMAND = 'benchmarks/large_clouds.py --write'
MEGABYTES = (1, 2, 4, 6)
KINDS = ('best_effort', 'reliable')
RATE = 10.0  # clouds a second
QUEUE = 5
POINT = 48  # bytes
TOPIC = 'large_clouds'
DOMAIN = '87'
REST = 2.0  # seconds for what is on its way, and until both sides know of each other
FOUND = 60.0  # seconds until two processes have found each other
# What is set in the environment, by middleware and by the name of the setting.
SETTINGS: dict[str, dict[str, dict[str, str]]] = {
    'rmw_fastrtps_cpp': {
        'as it is': {},
        '`config/fastdds_large_clouds.xml`': {
            'FASTRTPS_DEFAULT_PROFILES_FILE': str(CONFIG / 'fastdds_large_clouds.xml')
        },
        '`FASTDDS_BUILTIN_TRANSPORTS=LARGE_DATA`': {'FASTDDS_BUILTIN_TRANSPORTS': 'LARGE_DATA'},
    },
    'rmw_cyclonedds_cpp': {
        'as it is': {},
        '`config/cyclonedds_large_clouds.xml`': {
            'CYCLONEDDS_URI': f'file://{CONFIG / "cyclonedds_large_clouds.xml"}'
        },
    },
    'zenoh': {
        'as it is: waits 1 ms before it drops': {},
        'waits 50 ms before it drops': {'WAIT_BEFORE_DROP': '50000'},
    },
}
ENDPOINT = 'tcp/127.0.0.1:7465'
WAIT = 'transport/link/tx/queue/congestion_control/drop/wait_before_drop'  # microseconds


class RosSide:
    """One of two processes, with ROS."""

    def __init__(self, kind: str) -> None:
        """Make a node."""
        import rclpy
        from rclpy.qos import QoSProfile, ReliabilityPolicy

        rclpy.init(args=[])
        self._node = rclpy.create_node('side')
        self._quality = QoSProfile(depth=QUEUE, reliability=ReliabilityPolicy[kind.upper()])

    def send(self, size: int, count: int) -> None:
        """Publish clouds, as a sensor does."""
        from sensor_msgs.msg import PointCloud2

        publisher = self._node.create_publisher(PointCloud2, TOPIC, self._quality)
        msg = PointCloud2(height=1, width=size // POINT, point_step=POINT, row_step=size)
        msg.data = os.urandom(size)
        until(publisher.get_subscription_count)
        time.sleep(REST)
        for _ in due(count):
            publisher.publish(msg)
        time.sleep(REST)

    def listen(self) -> int:
        """Count clouds, as bytes, until the sensor goes."""
        import rclpy
        from sensor_msgs.msg import PointCloud2

        came: list[bytes] = []
        self._node.create_subscription(PointCloud2, TOPIC, came.append, self._quality, raw=True)
        until(lambda: self._node.count_publishers(TOPIC))
        while self._node.count_publishers(TOPIC):
            rclpy.spin_once(self._node, timeout_sec=0.2)
        return len(came)


class ZenohSide:
    """One of two processes, with Zenoh alone."""

    def __init__(self, kind: str) -> None:
        """Configure a session on this machine."""
        import zenoh

        self._zenoh, self._config = zenoh, zenoh.Config()
        self._control = getattr(
            zenoh.CongestionControl, 'DROP' if kind == 'best_effort' else 'BLOCK'
        )
        self._config.insert_json5('scouting/multicast/enabled', 'false')
        if wait := os.environ.get('WAIT_BEFORE_DROP'):
            self._config.insert_json5(WAIT, wait)

    def _open(self, mine: str, others: str) -> Any:
        self._config.insert_json5('listen/endpoints', mine)
        self._config.insert_json5('connect/endpoints', others)
        return self._zenoh.open(self._config)

    def send(self, size: int, count: int) -> None:
        """Publish bytes, as a sensor does."""
        data = os.urandom(size)
        with self._open('[]', f'["{ENDPOINT}"]') as session:
            publisher = session.declare_publisher(TOPIC, congestion_control=self._control)
            until(lambda: publisher.matching_status.matching)
            for _ in due(count):
                publisher.put(data)
            time.sleep(REST)

    def listen(self) -> int:
        """Count what comes until the sensor goes."""
        came: list[int] = []
        with self._open(f'["{ENDPOINT}"]', '[]') as session:
            session.declare_subscriber(TOPIC, lambda sample: came.append(len(sample.payload)))
            until(session.info.peers_zid)
            while session.info.peers_zid():
                time.sleep(0.1)
        return len(came)


def until(is_so: Callable[[], object]) -> None:
    """Wait until the other side is found."""
    end = time.monotonic() + FOUND
    while not is_so():
        if time.monotonic() > end:
            sys.exit(f'the other process must be found within {FOUND:.0f} s, got none')
        time.sleep(0.05)


def due(count: int) -> Iterator[int]:
    """Wait for the moment of each cloud."""
    begin = time.monotonic()
    for number in range(count):
        time.sleep(max(begin + number / RATE - time.monotonic(), 0))
        yield number


def lost(name: str, setting: Mapping[str, str], size: int, count: int, kind: str) -> float:
    """Send clouds from one process to another; give the share that was lost."""
    env = os.environ | {'ROS_DOMAIN_ID': DOMAIN} | setting
    call = [sys.executable, __file__, '--side', name, str(size), str(count), kind]
    with (
        subprocess.Popen(  # noqa: S603  ours
            [*call, 'listen'], env=env, stdout=subprocess.PIPE, text=True
        ) as listener,
        subprocess.Popen([*call, 'send'], env=env) as sensor,  # noqa: S603  ours
    ):
        said, _ = listener.communicate()
        if sensor.wait() or listener.returncode:
            sys.exit('both processes must end well, got another exit status')
    return 1 - int(said) / count


def be_side(name: str, size: str, count: str, kind: str, role: str) -> None:
    """Be one of the two processes."""
    side = ZenohSide(kind) if name == 'zenoh' else RosSide(kind)
    if role == 'send':
        side.send(int(size), int(count))
    else:
        print(side.listen())


def middleware() -> str:
    """Name the middleware that ROS has here."""
    from rclpy.utilities import get_rmw_implementation_identifier

    return str(get_rmw_implementation_identifier())


def measure(name: str, seconds: float) -> str:
    """Measure all settings of a middleware; return the table."""
    count, rows = round(seconds * RATE), []
    for text, setting in SETTINGS[name].items():
        row = [text]
        for kind in KINDS:
            for size in MEGABYTES:
                share = lost(name, setting, size * 10**6, count, kind)
                print(f'{name}, {text}, {kind}, {size} MB: {share:.1%} of {count}', flush=True)
                row.append(f'{100 * share:.0f} %')
        rows.append(row)
    head = [f'{size} MB, {kind.replace("_", " ")}' for kind in KINDS for size in MEGABYTES]
    return table([f'`{name}`', *head], rows)


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument('--seconds', type=float, default=20.0)
    parser.add_argument('--zenoh', action='store_true')
    parser.add_argument('--write', action='store_true')
    parser.add_argument('--side', nargs=5, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.side:
        be_side(*options.side)
        return
    name = 'zenoh' if options.zenoh else middleware()
    text = measure(name, options.seconds)
    print(text)
    if options.write:
        write(PAGE, f'large clouds, {name}', text, command=COMMAND)


if __name__ == '__main__':
    main()
