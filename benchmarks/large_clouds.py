# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Which share of large clouds a middleware loses between two processes, by size and by setting.

    python benchmarks/large_clouds.py [--seconds S] [--write]
    RMW_IMPLEMENTATION=rmw_cyclonedds_cpp python benchmarks/large_clouds.py --write

Clouds of 1 to 6 MB are sent at 10 Hz, best effort and reliable, with a queue of five as drivers
have; nobody filters. ``--write`` puts the table of this middleware into ``doc/large_clouds.md``.
"""

# ruff: noqa: INP001, T201, PLC0415  a script, which prints, and imports one middleware

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from lidar_outlier_lab.results.markdown import table, write

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
}


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


def lost(setting: Mapping[str, str], size: int, count: int, kind: str) -> float:
    """Send clouds from one process to another; give the share that was lost."""
    env = os.environ | {'ROS_DOMAIN_ID': DOMAIN} | setting
    call = [sys.executable, __file__, '--side', str(size), str(count), kind]
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


def be_side(size: str, count: str, kind: str, role: str) -> None:
    """Be one of the two processes: publish as a sensor does, or count clouds until it goes."""
    import rclpy
    from rclpy.qos import QoSProfile, ReliabilityPolicy
    from sensor_msgs.msg import PointCloud2

    rclpy.init(args=[])
    node = rclpy.create_node('side')
    quality = QoSProfile(depth=QUEUE, reliability=ReliabilityPolicy[kind.upper()])
    if role == 'send':
        publisher = node.create_publisher(PointCloud2, TOPIC, quality)
        width = int(size) // POINT
        msg = PointCloud2(height=1, width=width, point_step=POINT, row_step=int(size))
        msg.data = os.urandom(int(size))
        until(publisher.get_subscription_count)
        time.sleep(REST)
        for _ in due(int(count)):
            publisher.publish(msg)
        time.sleep(REST)
        return
    came: list[bytes] = []
    node.create_subscription(PointCloud2, TOPIC, came.append, quality, raw=True)
    until(lambda: node.count_publishers(TOPIC))
    while node.count_publishers(TOPIC):
        rclpy.spin_once(node, timeout_sec=0.2)
    print(len(came))


def measure(name: str, seconds: float) -> str:
    """Measure all settings of a middleware; return the table."""
    count, rows = round(seconds * RATE), []
    for text, setting in SETTINGS[name].items():
        row = [text]
        for kind in KINDS:
            for size in MEGABYTES:
                share = lost(setting, size * 10**6, count, kind)
                part = f'{100 * share:.1f} % of {count}'
                print(f'{name}, {text}, {kind}, {size} MB: {part}', flush=True)
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
    parser.add_argument('--write', action='store_true')
    parser.add_argument('--side', nargs=4, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.side:
        be_side(*options.side)
        return
    from rclpy.utilities import get_rmw_implementation_identifier

    name = get_rmw_implementation_identifier()
    text = measure(name, options.seconds)
    print(text)
    if options.write:
        write(PAGE, f'large clouds, {name}', text, command=COMMAND)


if __name__ == '__main__':
    main()
