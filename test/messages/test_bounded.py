# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What is kept of what was sent is bounded, whatever is sent: names, layouts, reasons, frames."""

import copy
import tracemalloc
from types import SimpleNamespace

import pytest
from helpers.clouds import SECOND, STAMP, cloud, table
from helpers.nodes import NO_CLOUD, Ros, hold_up, line, wait_for_thread
from rclpy.qos import ReliabilityPolicy
from sensor_msgs.msg import PointCloud2

from lidar_outlier_filter.errors import MAX_CHARACTERS, CloudError
from lidar_outlier_filter.messages.cloud import MAX_LAYOUTS
from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.library import CloudFilter
from lidar_outlier_filter.pipeline.statistics import MAX_REASONS, OTHER_REASONS, CountsByReason

LONG = 300_000  # characters of a name


def named(name: str) -> PointCloud2:
    """Make a cloud with a further field of this name."""
    msg = line(0)
    msg.fields.append(copy.copy(msg.fields[-1]))
    msg.fields[-1].name = name
    return msg


def test_layouts() -> None:
    """Each is read as its first cloud was, and so many are reported; the oldest are forgotten."""
    informed: list[str] = []
    decoder = Decoder(FilterParameters(), informed.append)
    late = table(3, y=('f4', [1.0, 2.0, 3.0]), t=('f8', [0.0, 0.05, 11.5]))
    early = table(3, y=('f4', [1.0, 2.0, 3.0]), t=('f8', [0.0, 0.05, 0.1]))
    assert decoder.decode(cloud(early, STAMP)).t.tolist()[-1] == STAMP + SECOND // 10
    for number in range(MAX_LAYOUTS - 1):
        decoder.decode(named(f'name {number}'))
    for number in range(10):
        # What is used is not old.
        assert decoder.decode(cloud(late, STAMP)).t.tolist()[-1] == STAMP + 23 * SECOND // 2
        decoder.decode(named(f'hostile {number}'))
    assert len(informed) == len(decoder._conventions) == MAX_LAYOUTS
    for number in range(MAX_LAYOUTS):
        decoder.decode(named(f'more {number}'))
    # Read anew: in seconds, from 11.5 s on, it counts from the epoch.
    assert decoder.decode(cloud(late, STAMP)).t.tolist()[-1] == 23 * SECOND // 2
    assert len(informed) == MAX_LAYOUTS


def test_memory_of_names() -> None:
    """Less than two clouds' names is kept of many, and sentences about them are short."""
    said: list[str] = []
    clean = CloudFilter({'chain': ['sor'], 'block': 0.02}, said.append, said.append)
    clean.push(line(0))
    tracemalloc.start()
    for number in range(60):
        with pytest.raises(CloudError, match='the names of the fields') as refusal:
            clean.push(named(f'{number:05d}' * (LONG // 5)))
        said.append(str(refusal.value))
    kept, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert kept < 2 * LONG
    assert max(map(len, said)) < 4 * MAX_CHARACTERS


def test_kinds() -> None:
    """Beyond the bound all that is new is one kind, and what is known is still counted."""
    kinds = CountsByReason()
    for number in range(3 * MAX_REASONS):
        kinds.note(str(number))
    kinds.note('7')
    assert len(kinds) == MAX_REASONS + 1
    assert (kinds['7'], kinds[OTHER_REASONS]) == (2, 2 * MAX_REASONS)


def test_sentences() -> None:
    """Beginning and end are there of what is quoted; short ones are whole."""
    err = CloudError('a' * LONG, 'b' * MAX_CHARACTERS, 'c' + 'd' * LONG + 'e')
    assert len(str(err)) < 4 * MAX_CHARACTERS
    assert 'b' * MAX_CHARACTERS in str(err)
    assert str(err)[-2:] == 'de'
    assert ', got cd' in str(err)
    assert len(err.what) <= MAX_CHARACTERS + 1


def test_bytes_that_are_no_cloud(ros: Ros) -> None:
    """While a block takes long they wait, no more of them than of clouds; then they are counted."""
    # Clouds that waited longer than max_delay would be dropped.
    node = ros.filter('-p', 'load.clouds:=100', '-p', 'max_delay:=60.0')
    node.start()
    channel = node.channels[0]
    go_on = hold_up(node)
    for _ in range(500):
        channel.take(NO_CLOUD)
    assert channel.waiting == 100
    go_on.set()
    wait_for_thread(node)
    assert (channel.statistics.refused, channel.health.losses()) == (100, {'dropped': 400})


def test_quality_of_service(ros: Ros) -> None:
    """Best effort in, as any sensor can be received then; reliable out; and how much is kept."""
    moving = {'motion.source': 'odometry', 'motion.topic': 'odom'}
    node = ros.filter(parameters=moving)
    node.start()
    received = {item.topic_name: item.qos_profile for item in node.subscriptions}
    for name, depth in (('/points', 50), ('/odom', 1000)):
        assert received[name].reliability is ReliabilityPolicy.BEST_EFFORT
        assert received[name].depth == depth
    for publisher in (node.channels[0].publisher.cleaned, node.channels[0].publisher.outliers):
        assert publisher.qos_profile.reliability is ReliabilityPolicy.RELIABLE
        assert publisher.qos_profile.depth == 10


def test_losses_are_counted_as_the_middleware_counts_them(ros: Ros) -> None:
    """Those since it reported some before, not those of all time again."""
    node = ros.filter()
    node.start()
    channel = node.channels[0]
    subscription = channel._clouds
    assert subscription is not None
    (handler,) = (item for item in subscription.event_handlers if item.callback == channel._lost)
    for total, change in ((3, 3), (5, 2)):
        handler.callback(SimpleNamespace(total_count=total, total_count_change=change))
    assert channel.health._missed['lost in transit'] == 5
