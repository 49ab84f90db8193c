# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Compressed clouds over the real middleware, with the real message of point_cloud_transport."""

import importlib
import sys
from collections.abc import Iterator

import pytest
from helpers.compressed import COMPRESS, compressed
from helpers.interfaces import build
from helpers.nodes import Ros, Sensor, line
from rclpy.serialization import serialize_message

from lidar_outlier_filter.errors import ParameterError

PARAMETERS = {
    'chain': ['alpha_beta_gamma'],
    'line_source': 'message',
    'block': 0.01,
    'halo': 0.0,
    'max_delay': 60.0,
}


@pytest.fixture(scope='module')
def kind(tmp_path_factory: pytest.TempPathFactory) -> Iterator[type]:
    """Give the class of the message, compiled where it is not installed."""
    folder = tmp_path_factory.mktemp('interfaces')
    build(folder)
    sys.path.append(str(folder))
    yield importlib.import_module('point_cloud_interfaces.msg').CompressedPointCloud2
    sys.path.remove(str(folder))


@pytest.mark.parametrize('name', COMPRESS)
def test_outputs_are_those_of_plain_clouds(ros: Ros, kind: type, name: str) -> None:
    """To the byte; a damaged cloud among them is refused and counted, and the stream goes on."""
    topics = ['/points', f'/packed/{name}']
    node = ros.filter(parameters=PARAMETERS | {'inputs': topics})
    node.start()
    plain, packed = Sensor(ros, topics[0]), Sensor(ros, topics[1], kind, outputs='/packed')
    for sensor, channel in zip((plain, packed), node.channels, strict=True):
        sensor.wait_for_filter(channel)
    for number in range(4):
        data = serialize_message(line(0.01 * number))
        plain.publish(data, expected=3)
        packed.publish(compressed(data, name, compressed_data=b'x'), expected=3)
        packed.publish(compressed(data, name), expected=3)
    plain.wait_for_outputs()
    packed.wait_for_outputs()
    assert [channel.statistics.refused for channel in node.channels] == [0, 4]
    assert (packed.cleaned, packed.outliers) == (plain.cleaned, plain.outliers)
    assert [msg.width for msg in packed.outliers] == [1, 1, 1]


def test_without_the_message(
    ros: Ros, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """The name of a topic means nothing then, and the log says why no cloud may come."""
    monkeypatch.setitem(sys.modules, 'point_cloud_interfaces.msg', None)
    node = ros.filter('-r', 'points:=/points/zstd', parameters=PARAMETERS)
    node.start()
    sentence = '/points/zstd: read as PointCloud2: point_cloud_interfaces is not installed'
    assert sentence in capfd.readouterr().err
    sensor = Sensor(ros, '/points/zstd', outputs='/points')
    sensor.wait_for_filter(node)
    sensor.publish(line(0), expected=1)
    sensor.publish(line(0.01), expected=1)
    sensor.wait_for_outputs()


def test_plain_and_compressed_clouds_of_one_sensor_are_refused(ros: Ros) -> None:
    """Their outputs would have the same names."""
    with pytest.raises(ParameterError, match='inputs must be one topic of a sensor, plain or'):
        ros.filter(parameters={'inputs': ['/points', '/points/zstd']})
