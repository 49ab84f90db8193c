# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Names of topics and types: what ROS 2 allows, and the output topics of an input topic."""

import re

from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.pipeline.compressed import DECODERS

CLOUD = 'sensor_msgs/msg/PointCloud2'
COMPRESSED = 'point_cloud_interfaces/msg/CompressedPointCloud2'
SCAN = 'sensor_msgs/msg/LaserScan'
MULTI_ECHO = 'sensor_msgs/msg/MultiEchoLaserScan'
SCANS = (SCAN, MULTI_ECHO)
ODOMETRY = 'nav_msgs/msg/Odometry'
TRANSFORMS = 'tf2_msgs/msg/TFMessage'
CLEANED, OUTLIERS = '/cleaned', '/outliers'  # behind the name of the topic
# Words of letters, digits and single underscores, between slashes; no word begins with a digit.
_NAME = re.compile(r'(~?/)?[A-Za-z_]\w*(/[A-Za-z_]\w*)*', re.ASCII)


def output_topics(topic: str) -> tuple[str, str]:
    """Return the topics of the cleaned and of the outlier clouds of ``topic``.

    A topic of point_cloud_transport is named after the plain one and the format: outputs are plain.
    """
    plain, _, last = topic.rpartition('/')
    topic = plain if plain and last in DECODERS else topic
    return topic + CLEANED, topic + OUTLIERS


def resolve(name: str) -> str:
    """Return a name as ROS expands it for a node without a namespace."""
    if name.startswith('~'):
        return '/outlier_filter_node' + name.removeprefix('~')
    return name if name.startswith('/') else f'/{name}'


def check_name(what: str, name: str) -> None:
    """Refuse a topic name that is invalid in ROS 2.

    Raises
    ------
    RecordingError
        If it is invalid. ``what`` is the subject of the message.

    """
    if not _NAME.fullmatch(name) or '__' in name:
        raise RecordingError(what, 'a name that ROS 2 allows', name)
