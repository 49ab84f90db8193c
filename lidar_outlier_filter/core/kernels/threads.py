# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Work in threads: kernels let go of the GIL, so plain threads use all cores. And their memory."""

import ctypes
import itertools
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache
from typing import TypeVar

Result = TypeVar('Result')

# Of glibc's mallopt (malloc.h): what is given back to the system, and what is not kept at all.
TRIM_THRESHOLD, MMAP_THRESHOLD, ARENA_MAX = -1, -3, -8
MAX_FREE_BYTES = 1 << 29  # bytes: what is larger, or free beyond that, goes back to the system
MAX_HELPERS = 256  # helpers; they are started when there is work that no idle one takes


@cache
def _helpers() -> ThreadPoolExecutor:
    """Return threads that are kept: starting some for every call costs more than many calls."""
    return ThreadPoolExecutor(MAX_HELPERS, 'helper')


os.register_at_fork(after_in_child=_helpers.cache_clear)  # a forked process has no threads


def cores() -> int:
    """Count the cores that this process may use."""
    return len(os.sched_getaffinity(0))


@cache
def keep_memory() -> None:
    """Keep the memory of one cloud for the next, where the C library is glibc. Chains call it.

    By default it goes back to the system after every cloud, and comes again page by page, filled
    with zeros: with large clouds that is a tenth of all the time. One arena for the threads to
    come, because each would keep what is free in its own.
    """
    set_option = getattr(ctypes.CDLL(None), 'mallopt', None)
    if set_option is not None:
        for option, value in (
            (ARENA_MAX, 1),
            (MMAP_THRESHOLD, MAX_FREE_BYTES),
            (TRIM_THRESHOLD, MAX_FREE_BYTES),
        ):
            set_option(option, value)


def run(
    work: Callable[[int, int], Result], count: int, chunk: int, threads: int = 0
) -> list[Result]:
    """Do ``work(begin, end)`` for the ranges of ``chunk`` that make up ``range(count)``.

    The ranges do not depend on the number of threads, and neither does the result of work that
    reads its own range only. One range, or one thread, is done by the caller itself.

    Parameters
    ----------
    work : callable
        Must let go of the GIL to gain anything.
    count, chunk : int
        At least 0, and at least 1.
    threads : int
        Maximum number of threads; 0: all cores.

    Returns
    -------
    list
        What the work returned, in the order of the ranges.

    Raises
    ------
    Exception
        The first one that work raised, in the order of the ranges; what has not begun is left.

    """
    begins = range(0, count, chunk)
    helpers = min(threads or cores(), len(begins)) - 1
    if helpers <= 0:
        return [work(begin, min(begin + chunk, count)) for begin in begins]
    done: dict[int, Result] = {}
    failed: dict[int, BaseException] = {}
    numbers = itertools.count()  # taken by one thread each, because of the GIL

    def some() -> None:
        # Ranges are taken in order, and a taken one is finished. So the first error is found.
        while not failed and (number := next(numbers)) < len(begins):
            begin = begins[number]
            try:
                done[number] = work(begin, min(begin + chunk, count))
            except BaseException as error:  # noqa: BLE001  it is raised below
                failed[number] = error

    # The caller works as well, and then cancels tasks that have not begun. So it never waits for a
    # thread that does other work, and nested calls cannot deadlock.
    tasks = [_helpers().submit(some) for _ in range(helpers)]
    some()
    wait([task for task in tasks if not task.cancel()])
    if failed:
        raise failed[min(failed)]
    return [done[number] for number in range(len(begins))]
