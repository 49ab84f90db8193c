# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Values of the parameters of a node."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lidar_outlier_filter.parameters.filter import describe

if TYPE_CHECKING:
    from lidar_outlier_filter.ros.node import OutlierFilterNode


def values(node: OutlierFilterNode) -> dict[str, object]:
    """Read all parameters of the node from ROS."""
    return {item.name: node.get_parameter(item.name).value for item in describe()}
