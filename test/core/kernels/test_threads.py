# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Work in threads is done once, in any number of them, and its errors come out."""

import os
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest

from lidar_outlier_filter.core.kernels import threads


@pytest.mark.parametrize('number', [0, 1, 2, 7])
@pytest.mark.parametrize('count', [0, 1, 9, 10, 11, 95])
def test_ranges_cover_all_in_order(count: int, number: int) -> None:
    """The last range is what is left; the results come in order, whoever was first."""
    expected = [(i, min(i + 10, count)) for i in range(0, count, 10)]
    assert threads.run(lambda begin, end: (begin, end), count, 10, number) == expected


def test_no_more_threads_than_asked_for() -> None:
    """Fifty ranges are done by two threads at most, one of them the caller."""
    barrier = threading.Barrier(2)

    def work(begin: int, _: int) -> int:
        if begin < 2:
            barrier.wait(10)
        return threading.get_ident()

    workers = set(threads.run(work, 50, 1, 2))
    assert len(workers) == 2
    assert threading.get_ident() in workers


@pytest.mark.parametrize(('count', 'number', 'helpers'), [(50, 3, 2), (2, 7, 1), (1, 7, 0)])
def test_the_caller_is_one_of_them(
    monkeypatch: pytest.MonkeyPatch, count: int, number: int, helpers: int
) -> None:
    """One helper less is asked than there may be threads, or than there are ranges."""
    pool = threads._helpers()
    submit, asked = pool.submit, list[object]()

    def noted(work: Callable[[], object]) -> object:
        asked.append(work)
        return submit(work)

    monkeypatch.setattr(pool, 'submit', noted)
    threads.run(lambda *_: None, count, 1, number)
    assert len(asked) == helpers


def test_threads_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """A hundred calls start no hundred threads; the pool is new, so nobody else's are counted."""
    barrier = threading.Barrier(2)
    pool = ThreadPoolExecutor(threads.MAX_HELPERS)
    monkeypatch.setattr(threads, '_helpers', lambda: pool)
    known = {ident for _ in range(100) for ident in threads.run(_meet(barrier), 2, 1, 2)}
    assert len(known) < 20


def _meet(barrier: threading.Barrier) -> Callable[[int, int], int]:
    def work(*_: int) -> int:
        barrier.wait(10)
        return threading.get_ident()

    return work


@pytest.mark.parametrize('number', [1, 4])
def test_first_error_comes_out(number: int) -> None:
    """Ranges 3 and 4 fail, at the same time where they can; 3 is first in order."""
    barrier = threading.Barrier(min(number, 2))

    def work(begin: int, _: int) -> None:
        if begin >= 3:
            barrier.wait(10)
            raise ValueError(begin)

    with pytest.raises(ValueError, match=r'^3$'):
        threads.run(work, 5, 1, number)


def test_cores_are_those_of_the_process() -> None:
    """A process bound to one core counts one."""
    assert threads.cores() == len(os.sched_getaffinity(0))
    program = (
        'import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))});'
        'from lidar_outlier_filter.core.kernels.threads import cores; print(cores())'
    )
    result = subprocess.run([sys.executable, '-c', program], check=True, capture_output=True)
    assert result.stdout == b'1\n'


def test_callers_and_levels_do_not_wait_for_each_other() -> None:
    """Work that itself spreads over threads, asked for by several threads at once."""

    def sums(begin: int, end: int) -> int:
        return sum(threads.run(lambda i, j: sum(range(i, j)), end - begin, 7, 2))

    with ThreadPoolExecutor(4) as callers:
        results = list(callers.map(lambda _: threads.run(sums, 400, 100, 2), range(8)))
    assert results == [[4950] * 4] * 8


def test_works_in_a_forked_process() -> None:
    """A child that was forked while others were at work has threads of its own."""
    program = """
import os, threading, warnings
from lidar_outlier_filter.core.kernels import threads
warnings.simplefilter('ignore')  # newer Pythons warn of what is tried here
started, go_on = threading.Event(), threading.Event()
work = lambda *_: (started.set(), go_on.wait(30))
other = threading.Thread(target=lambda: threads.run(work, 2, 1, 2))
other.start()
started.wait(30)
child = os.fork()
if child == 0:
    result = threads.run(lambda i, j: j - i, 10, 3, 2)
    os._exit(0 if result == [3, 3, 3, 1] else 1)
status = os.waitpid(child, 0)[1]
go_on.set()
other.join()
print(os.waitstatus_to_exitcode(status))
"""
    result = subprocess.run(
        [sys.executable, '-c', program], check=True, capture_output=True, timeout=60
    )
    assert result.stdout == b'0\n'
