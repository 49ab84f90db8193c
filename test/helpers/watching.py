# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A node that is a process, a sensor that sends it clouds at 10 Hz, and all that it says."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Self

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import PointCloud2

from helpers.clouds import STAMP, cloud, table
from helpers.live import KEEP_ALL

PERIOD = 0.1  # seconds between two clouds
# A sensor is there long before a node. Fast DDS tells of a participant at its start and every three
# seconds, and one that starts in between waits for the next time, whatever its program.
ANNOUNCED_S = 2.0
RINGS, COLUMNS = 16, 256
TIMEOUT = 600.0  # seconds
RELIABLE = 'qos_overrides./points.subscription.reliability:=reliable'


def sweep(number: int) -> PointCloud2:
    """Make a sweep of 16 rings in a round hall, with one stray point."""
    turned = np.tile(2 * np.pi * np.arange(COLUMNS) / COLUMNS, RINGS)
    ring = np.repeat(np.arange(RINGS), COLUMNS)
    up = np.deg2rad(2.0 * ring - 15.0)
    reach = 10.0 + np.random.default_rng(number).normal(0, 0.01, len(ring))
    reach[COLUMNS * 7 + number % COLUMNS] = 4.0
    columns = {
        'x': ('f4', reach * np.cos(up) * np.cos(turned)),
        'y': ('f4', reach * np.cos(up) * np.sin(turned)),
        'z': ('f4', reach * np.sin(up)),
        'time': ('f4', PERIOD * turned / (2 * np.pi)),
    }
    rows = table(len(ring), ring=('u2', ring), **columns)
    return cloud(rows, STAMP + round(number * PERIOD * 1e9))


@dataclass
class Status:
    """What /diagnostics said: when (monotonic), its level and sentence, and its values."""

    at: float
    level: int
    message: str
    values: Mapping[str, str]

    def count(self, name: str) -> int:
        """Return a count; 0 where nothing was counted."""
        return int(self.values.get(name, 0))

    @property
    def bypassed(self) -> int:
        """Count the clouds that passed unfiltered."""
        return sum(
            int(value) for key, value in self.values.items() if key.startswith('unfiltered for')
        )

    @property
    def filtered(self) -> int:
        """Count the clouds that were filtered."""
        return self.count('messages') - self.bypassed


@dataclass
class Watch:
    """A sensor and a listener for one node, which is a process."""

    env: Mapping[str, str]
    arguments: list[str]
    sent: int = 0
    published: list[float] = field(default_factory=list)
    samples: list[Status] = field(default_factory=list)

    def __enter__(self) -> Self:
        """Start the node."""
        os.environ.update({key: self.env[key] for key in self.env if key.startswith('ROS_')})
        rclpy.init(args=[])
        self.node = rclpy.create_node('watch')
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self._clouds = self.node.create_publisher(PointCloud2, 'points', KEEP_ALL)
        self.node.create_subscription(PointCloud2, 'points/cleaned', self._published, KEEP_ALL)
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._sampled, KEEP_ALL)
        settings = [word for one in [RELIABLE, *self.arguments] for word in ('-p', one)]
        command = ['-P', '-m', 'lidar_outlier_filter.ros.executable', '--ros-args', *settings]
        self._log = tempfile.TemporaryFile('w+')
        time.sleep(ANNOUNCED_S)
        self.began = time.monotonic()
        self.process = subprocess.Popen(
            [sys.executable, *command], env={**os.environ, **self.env}, stderr=self._log
        )
        self._next = self.began
        return self

    def __exit__(self, *_: object) -> None:
        """End the node, and this side."""
        self.process.kill()
        self.process.wait()
        self._log.close()
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown()

    def log(self) -> str:
        """Return what the node has logged."""
        self._log.seek(0)
        return self._log.read()

    def serve(self, until: Callable[[], bool], seconds: float = TIMEOUT) -> float:
        """Send clouds until something is so, or some time is over; return when (monotonic)."""
        end = time.monotonic() + seconds
        while not until() and time.monotonic() < end:
            if self.process.poll() is not None:
                raise RuntimeError(f'the node has ended:\n{self.log()}')
            if time.monotonic() >= self._next:
                self._next = max(self._next + PERIOD, time.monotonic() - PERIOD)
                self._send()
            self.executor.spin_once(max(0.0, self._next - time.monotonic()))
        return time.monotonic()

    def settle(self) -> Status:
        """Send no more; wait until the node has counted all that was sent; return its counts."""
        end, before = time.monotonic() + TIMEOUT, len(self.samples)
        while time.monotonic() < end:
            self.executor.spin_once(0.1)
            sample = self.samples[-1]
            lost = sample.count('dropped') + sample.count('refused')
            if len(self.samples) > before and sample.count('messages') + lost == self.sent:
                break
        return self.samples[-1]

    def stop(self) -> int:
        """Ask the node to end; return its exit status."""
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(TIMEOUT)

    def _send(self) -> None:
        # A cloud that nobody is subscribed to is not sent.
        if self._clouds.get_subscription_count():
            self._clouds.publish(sweep(self.sent))
            self.sent += 1

    def _published(self, _msg: PointCloud2) -> None:
        self.published.append(time.monotonic())

    def _sampled(self, msg: DiagnosticArray) -> None:
        for status in msg.status:
            values = {item.key: item.value for item in status.values}
            level = int.from_bytes(status.level, 'little')
            self.samples.append(Status(time.monotonic(), level, str(status.message), values))
