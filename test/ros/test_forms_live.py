# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A profile scanner in the forms of drivers: node, replay and library give equal bytes."""

from dataclasses import replace
from pathlib import Path

import pytest
from helpers.clouds import cloud
from helpers.nodes import Ros

from lidar_outlier_filter import CloudFilter
from lidar_outlier_filter.recordings.bags import Recording
from lidar_outlier_filter.recordings.recorded_clouds import split_clouds
from lidar_outlier_filter.recordings.replay import replay
from lidar_outlier_lab.simulation.forms import form_clouds
from lidar_outlier_lab.simulation.scenes.mapping_streets import street
from lidar_outlier_lab.simulation.world.drive import Drive
from lidar_outlier_lab.simulation.world.recording import TOPIC, write

CHAIN = {'chain': ['alpha_beta_gamma'], 'max_delay': 60.0}


def short(seed: int) -> Drive:
    """Draw a drive of 0.3 s."""
    return replace(street(seed), lines=45)


@pytest.mark.parametrize('name', ['turns_10', 'packets', 'afresh', 'rows', 'ring_0', 'time_of_24'])
def test_equal_bytes(ros: Ros, tmp_path: Path, name: str) -> None:
    """Lines are decided alike, whoever reads the clouds."""
    clouds = list(form_clouds(name, 1, short))
    messages = [cloud(one.points, one.stamp) for one in clouds]
    library = CloudFilter(CHAIN)
    found = [output for msg in messages for output in library.push(msg)] + library.flush()
    expected = [bytes(output.outliers.data) for output in found]
    assert sum(map(len, expected)) > 0

    node = ros.filter(parameters=CHAIN)
    sensor = ros.sensor(node)
    channel = node.channels[0]
    for sent, msg in enumerate(messages, 1):
        sensor.publish(msg, expected=len(messages))
        while channel.waiting + channel.statistics.messages < sent:
            ros.executor.spin_once(0.05)
    node.finish()
    sensor.wait_for_outputs()
    assert [bytes(msg.data) for msg in sensor.outliers] == expected

    write(iter(clouds), tmp_path / 'drive')
    replay(tmp_path / 'drive', tmp_path / 'cleaned', parameters=CHAIN)
    with Recording(tmp_path / 'cleaned') as source:
        split = [bytes(msg.data) for bad, msg in split_clouds(source, TOPIC) if bad]
    assert split == expected
