# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The executable of the node: ends without a trace when it is stopped while it still loads."""

from __future__ import annotations

import ctypes
import sys
from typing import TYPE_CHECKING

from lidar_outlier_filter.ros.signals import leave, on_stop

if TYPE_CHECKING:
    from collections.abc import Callable

    from lidar_outlier_filter.ros.node import OutlierFilterNode

# Of glibc's mallopt (malloc.h): what is given back to the system, and what is not kept at all.
TRIM_THRESHOLD, MMAP_THRESHOLD, ARENA_MAX = -1, -3, -8
KEPT = 1 << 29  # bytes: what is larger, or free beyond that, goes back to the system


def keep_memory() -> None:
    """Keep the memory of one cloud for the next, where the C library is glibc.

    By default it goes back to the system after every cloud, and comes again page by page, filled
    with zeros: with large clouds that is a sixth of all the time. One arena, because every thread
    would keep what is free in its own.
    """
    set_option = getattr(ctypes.CDLL(None), 'mallopt', None)
    if set_option is not None:
        for option, value in ((ARENA_MAX, 1), (MMAP_THRESHOLD, KEPT), (TRIM_THRESHOLD, KEPT)):
            set_option(option, value)


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
