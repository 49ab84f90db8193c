# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Work in threads: kernels let go of the GIL, so plain threads use all cores."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, TypeVar

from lidar_outlier_filter.errors import FilterError

if TYPE_CHECKING:
    from collections.abc import Callable

Result = TypeVar('Result')


def cores() -> int:
    """Count the cores that this process may use."""
    return len(os.sched_getaffinity(0))


def run(
    work: Callable[[int, int], Result], count: int, chunk: int, threads: int = 0
) -> list[Result]:
    """Do ``work(begin, end)`` for the ranges of ``chunk`` that make up ``range(count)``.

    The ranges do not depend on the number of threads, and neither does the answer of work that
    looks at nothing but its own range. One range, or one thread, is done by the caller itself.

    Parameters
    ----------
    work : callable
        Must let go of the GIL to gain anything.
    count, chunk : int
        At least 0, and at least 1.
    threads : int
        At most so many at once; 0 for as many as there are cores.

    Returns
    -------
    list
        What the work returned, in the order of the ranges.

    Raises
    ------
    Exception
        The first one that work raised, in the order of the ranges; what has not begun is left.

    """
    if threads < 0:
        raise FilterError('threads', 'at least 0', threads)
    begins = range(0, count, chunk)
    workers = min(threads or cores(), len(begins))

    def one(begin: int) -> Result:
        return work(begin, min(begin + chunk, count))

    if workers <= 1:
        return [one(begin) for begin in begins]
    # A pool of its own for every call costs 0.1 ms, and there is none to share: neither with a
    # process forked off, which would inherit it without its threads, nor with other callers.
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(one, begins))
