# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""2-D scans over the real middleware: node, replay and library give equal bytes."""

from pathlib import Path
from typing import Any

import pytest
from helpers.drives import content, write_messages
from helpers.laser_scans import Scanner
from helpers.nodes import NO_CLOUD, Ros, Sensor
from rclpy.serialization import serialize_message
from sensor_msgs.msg import LaserScan, MultiEchoLaserScan

from lidar_outlier_filter import CloudFilter
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.topics import MULTI_ECHO, SCAN
from lidar_outlier_filter.recordings.info import describe_recording
from lidar_outlier_filter.recordings.recorded_clouds import RecordedClouds
from lidar_outlier_filter.recordings.replay import replay

SCANNER = Scanner()
KINDS = {
    SCAN: (LaserScan, SCANNER.scan),
    MULTI_ECHO: (MultiEchoLaserScan, SCANNER.several_echoes),
}
SCANS, BROKEN = 24, 7  # and after which one a broken one comes


def broken(make: Any) -> bytes:
    """Make a scan of no direction."""
    msg = make(0)
    msg.angle_increment = 0.0
    return bytes(serialize_message(msg))


@pytest.mark.parametrize(
    ('name', 'parameters'),
    [(SCAN, {}), (SCAN, {'blocks': 'message', 'halo': 0.1}), (MULTI_ECHO, {})],
)
def test_equal_bytes(ros: Ros, tmp_path: Path, name: str, parameters: dict[str, Any]) -> None:
    """A broken scan and a broken message among them are refused and counted, by each."""
    kind, make = KINDS[name]
    sent = [bytes(serialize_message(make(number))) for number in range(SCANS)]
    sent[BROKEN:BROKEN] = [broken(make), NO_CLOUD]
    library = CloudFilter(parameters)
    outputs = [one for number in range(SCANS) for one in library.push(make(number))]
    outputs += library.flush()
    expected = [
        [bytes(serialize_message(part)) for part in (one.cleaned, one.outliers)] for one in outputs
    ]
    assert library.statistics.outliers > 0

    write_messages(
        tmp_path / 'drive',
        {'/scan': name},
        [('/scan', number * 10**9 // SCANNER.rate, data) for number, data in enumerate(sent)],
    )
    (report,) = replay(tmp_path / 'drive', tmp_path / 'out', parameters=parameters).topics
    assert (report.messages, report.refused) == (SCANS + 2, 2)
    found = content(tmp_path / 'out')
    assert [data for _, data in found['/scan']] == sent
    cleaned, outliers = (
        [data for _, data in found[f'/scan/{part}']] for part in ('cleaned', 'outliers')
    )
    assert [list(both) for both in zip(cleaned, outliers, strict=True)] == expected
    (info,) = describe_recording(tmp_path / 'drive').clouds.values()
    assert info.fields == ('ranges float32', 'intensities float32')
    assert len(list(RecordedClouds(tmp_path / 'drive', FilterParameters()))) == SCANS

    live = parameters | {'input_type': kind.__name__, 'max_delay': 60.0}
    node = ros.filter('-r', 'points:=/scan', parameters=live)
    node.start()
    sensor = Sensor(ros, '/scan', kind, published=kind)
    sensor.wait_for_filter(node)
    channel = node.channels[0]
    for number, data in enumerate(sent, 1):
        sensor.publish(data, expected=SCANS)
        while channel.waiting + channel.statistics.messages + channel.statistics.refused < number:
            ros.executor.spin_once(0.05)
    node.finish()
    sensor.wait_for_outputs()
    assert channel.statistics.refused == 2
    received = [
        [bytes(serialize_message(part)) for part in both]
        for both in zip(sensor.cleaned, sensor.outliers, strict=True)
    ]
    assert received == expected
