# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the C library does with memory that is free; imports nothing that takes time."""

from __future__ import annotations

import ctypes

# Of glibc's mallopt (malloc.h): what is given back to the system, and what is not kept at all.
TRIM_THRESHOLD, MMAP_THRESHOLD, ARENA_MAX = -1, -3, -8
KEPT = 1 << 29  # bytes: what is larger, or free beyond that, goes back to the system


def keep_memory() -> None:
    """Keep the memory of one cloud for the next, where the C library is glibc.

    By default it goes back to the system after every cloud, and comes again page by page, filled
    with zeros: with large clouds that is a sixth of all the time. One arena, because every thread
    would keep what is free in its own. Threads that have one already keep it: call this first.
    """
    set_option = getattr(ctypes.CDLL(None), 'mallopt', None)
    if set_option is not None:
        for option, value in ((ARENA_MAX, 1), (MMAP_THRESHOLD, KEPT), (TRIM_THRESHOLD, KEPT)):
            set_option(option, value)
