# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds that come faster than they are judged."""

from sensor_msgs.msg import PointCloud2

from helpers.nodes import Ros, Sensor, line
from lidar_outlier_filter.ros.node import OutlierFilterNode

# Blocks of one cloud, which no halo holds up; half of the queue is five clouds.
SHORT = {
    'chain': ['alpha_beta_gamma'],
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
    while len(sensor.outliers) < count:
        ros.executor.spin_once(0.05)
    return [(_number(msg), msg.width) for msg in sensor.outliers]


def _number(msg: PointCloud2) -> int:
    stamp, first = msg.header.stamp, line(0.0).header.stamp
    seconds: float = stamp.sec - first.sec + (stamp.nanosec - first.nanosec) * 1e-9
    return round(100 * seconds)
