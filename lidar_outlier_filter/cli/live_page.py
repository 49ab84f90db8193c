# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A node and its page: the one module that knows both."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lidar_outlier_filter.report.served import PageServer
    from lidar_outlier_filter.ros.node import OutlierFilterNode


def serve_page(node: OutlierFilterNode, port: int = 0) -> PageServer:
    """Serve the page of a node that is not started yet, and log its address once."""
    # Without a page none of this is loaded.
    from lidar_outlier_filter.report.served import PageServer  # noqa: PLC0415
    from lidar_outlier_filter.ros.access import NodeAccess  # noqa: PLC0415

    server = PageServer(NodeAccess(node), port)
    node.show(server.show)
    server.start()
    node.get_logger().info(f'page: {server.address}')
    return server
