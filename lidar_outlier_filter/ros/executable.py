# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The executable of the node: ends without a trace when it is stopped while it still loads."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from lidar_outlier_filter.pipeline.memory import keep_memory
from lidar_outlier_filter.ros.signals import leave, on_stop

if TYPE_CHECKING:
    from collections.abc import Callable

    from lidar_outlier_filter.ros.node import OutlierFilterNode


def main(*, lifecycle: bool = False, attach: Callable[[OutlierFilterNode], object] = id) -> int:
    """Load the node, a managed one if asked for, and run it; return the exit status.

    ``attach`` is called with the node before it starts.
    """
    on_stop(leave)
    keep_memory()
    # ROS, NumPy and numba take a second or two.
    from lidar_outlier_filter.ros.node import main as run  # noqa: PLC0415

    if not lifecycle:
        return run(attach=attach)
    from lidar_outlier_filter.ros.managed import ManagedFilterNode  # noqa: PLC0415

    return run(make=ManagedFilterNode, attach=attach)


if __name__ == '__main__':
    sys.exit(main())
