# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The pose source of a node, and its subscriptions to /tf and /tf_static."""

import importlib

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.motion import PoseSource
from lidar_outlier_filter.pipeline.tf import DYNAMIC, STATIC, Tf, pose_source

TF_DEPTH = 100  # messages, as tf2's own listener keeps


def make_motion(node: Node, parameters: FilterParameters) -> PoseSource | None:
    """Make the pose source that ``motion.source`` names; None for 'none'.

    Raises
    ------
    ParameterError
        If it needs a package that is not installed.

    """
    made = pose_source(parameters)
    if isinstance(made, Tf):
        _listen(node, made)
    return made


def _listen(node: Node, tf: Tf) -> None:
    try:
        messages = importlib.import_module('tf2_msgs.msg')
    except ImportError as err:
        must_be = "'none' or 'odometry' where tf2_msgs is not installed"
        raise ParameterError('motion.source', must_be, "'tf'") from err
    latched = QoSProfile(depth=TF_DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(messages.TFMessage, DYNAMIC, tf.take, TF_DEPTH)
    node.create_subscription(messages.TFMessage, STATIC, tf.take_static, latched)
