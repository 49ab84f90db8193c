# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A recording over and over through the node, faster than real time: memory, and the verdicts.

    python benchmarks/soak.py RECORDING [--hours N] [NAME:=VALUE ...]

The clouds of the recording follow each other for so many hours of sensor time. Each answer must be,
bit for bit, what it was in the first loop that has another before it. Printed are, twenty times,
the memory of the process and how many answers were not; exit status 1 if any was.
"""

# ruff: noqa: INP001  a script, no package

from __future__ import annotations

import argparse
import sys
import time
import zlib
from pathlib import Path
from typing import Any

import psutil
import rclpy
from rclpy.context import Context
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / 'test')]

from helpers.live import clouds  # noqa: E402
from helpers.nodes import process  # noqa: E402

from lidar_outlier_filter.parameters.yaml_files import parse  # noqa: E402
from lidar_outlier_filter.ros.node import OutlierFilterNode  # noqa: E402

SECOND = 10**9
PAUSE = 3 * 10**8  # between the last cloud and the first of the next loop, nanoseconds
LOOKS = 20


class Soak:
    """A node, the clouds it is given again and again, and what it said of them at first."""

    def __init__(self, recording: Path, settings: dict[str, object]) -> None:
        self.context = Context()
        rclpy.init(args=[], context=self.context)
        self.node = OutlierFilterNode(
            parameters=settings, context=self.context, use_global_arguments=False
        )
        stored = [deserialize_message(data, PointCloud2) for data in clouds(recording)]
        self.clouds = [(_stamp(msg), msg) for msg in stored]
        times = [stamp for stamp, _ in self.clouds]
        # Whole blocks, which are aligned absolutely: else these would be other questions.
        block = round(self.node.filter_parameters.block * SECOND)
        self.period = -(-(max(times) - min(times) + PAUSE) // block) * block
        self.loops = self.answers = self.different = 0
        self._first: dict[int, int] = {}

    @property
    def hours(self) -> float:
        """Return how much sensor time has passed."""
        return self.loops * self.period / SECOND / 3600

    def loop(self) -> None:
        """Filter the recording once, later than the last time."""
        for number, (stamp, msg) in enumerate(self.clouds):
            later = stamp + self.loops * self.period
            msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(later, SECOND)
            for answer in process(self.node, msg, (self.loops, number)):
                self._compare(*answer.tag, answer)
        self.loops += 1

    def _compare(self, loop: int, number: int, answer: Any) -> None:
        self.answers += 1
        found = zlib.crc32(answer.outliers.data, zlib.crc32(answer.cleaned.data))
        if loop > 0:
            self.different += self._first.setdefault(number, found) != found


def _stamp(msg: PointCloud2) -> int:
    return int(msg.header.stamp.sec) * SECOND + int(msg.header.stamp.nanosec)


def main() -> int:
    """Read the command line, and run."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument('recording', type=Path)
    parser.add_argument('--hours', type=float, default=2.0)
    parser.add_argument('settings', nargs='*', metavar='NAME:=VALUE')
    options = parser.parse_args()
    settings = dict(item.split(':=', 1) for item in options.settings)
    soak = Soak(
        options.recording, {'scores': True} | {key: parse(settings[key]) for key in settings}
    )
    itself, begin = psutil.Process(), time.monotonic()
    for look in range(1, LOOKS + 1):
        while soak.hours < look * options.hours / LOOKS:
            soak.loop()
        seconds = time.monotonic() - begin
        sys.stdout.write(
            f'{soak.hours:.2f} h of sensor time in {seconds:.0f} s: {soak.loops} loops, '
            f'{soak.answers} answers, {soak.different} different, '
            f'{soak.node.statistics.refused} refused, {itself.memory_info().rss / 1e6:.1f} MB\n'
        )
        sys.stdout.flush()
    return 1 if soak.different or soak.node.statistics.refused else 0


if __name__ == '__main__':
    sys.exit(main())
