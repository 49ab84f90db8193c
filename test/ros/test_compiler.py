# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters wait for their kernels beside the filter, and the last request wins."""

import queue
import threading
from collections.abc import Callable

import pytest
from helpers.programs import TIMEOUT

from lidar_outlier_filter.core.kernels import kernel_cache
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline import compiling
from lidar_outlier_filter.ros import compiler
from lidar_outlier_filter.ros.compiler import Compiler

FIRST, SECOND, THIRD, FOURTH = (
    FilterParameters().changed({'chain': (name,)})
    for name in ('lof', 'sor', 'quadric', 'elevation')
)
THIRD_STRICT = THIRD.changed({'max_delay': 9.0})


class Loading:
    """Stands in for loading kernels, which takes until it is let go on, and for what is ready."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.begun: queue.SimpleQueue[FilterParameters] = queue.SimpleQueue()
        self.go_on = threading.Semaphore(0)
        self.ready: list[FilterParameters] = []
        self.error: Exception | None = None
        monkeypatch.setattr(compiler, 'load', self.load)
        monkeypatch.setattr(compiler, 'is_ready', lambda parameters: parameters in self.ready)

    def load(self, parameters: FilterParameters) -> bool:
        """Wait, and be ready."""
        self.begun.put(parameters)
        assert self.go_on.acquire(timeout=TIMEOUT)
        if self.error is not None:
            raise self.error
        self.ready.append(parameters)
        return True


class Beside(Compiler):
    """Notes what takes over, and what is warned of."""

    def __init__(self) -> None:
        self.taken: queue.SimpleQueue[FilterParameters] = queue.SimpleQueue()
        self.warned: list[str] = []
        super().__init__(self.taken.put, str, self.warned.append, lambda command: command())


@pytest.fixture
def loading(monkeypatch: pytest.MonkeyPatch) -> Loading:
    """Stand in for kernels."""
    return Loading(monkeypatch)


def test_what_is_ready_takes_over_at_once(loading: Loading) -> None:
    """In the thread that wants it."""
    loading.ready.append(FIRST)
    beside = Beside()
    beside.request(FIRST)
    assert beside.taken.get_nowait() == FIRST
    assert (beside.reply, beside.compiling) == ('', '')


def test_the_old_one_filters_until_then(loading: Loading) -> None:
    """The reply names both; before there is an old one, there is nothing to say."""
    loading.ready.append(FIRST)
    beside = Beside()
    beside.request(SECOND)
    assert beside.reply == ''
    assert 'sor' in beside.compiling
    loading.go_on.release()
    assert beside.taken.get(timeout=TIMEOUT) == SECOND
    beside.request(THIRD)
    assert beside.reply.startswith('chain quadric starts when its kernels are ready')
    assert beside.reply.endswith('until then: sor')
    loading.go_on.release()
    assert beside.taken.get(timeout=TIMEOUT) == THIRD
    beside.stop()
    assert (beside.reply, beside.compiling) == ('', '')


def test_the_last_wins(loading: Loading) -> None:
    """Whatever is loaded already; what was requested before never takes over, nor is it loaded.

    However many are requested, one thread loads: many would hold up the clouds.
    """
    beside = Beside()
    beside.request(FIRST)
    assert loading.begun.get(timeout=TIMEOUT) == FIRST
    for _ in range(20):
        for requested in (SECOND, THIRD, THIRD_STRICT):
            beside.request(requested)
    assert sum(one.name == 'compile' for one in threading.enumerate()) == 1
    loading.go_on.release()
    assert loading.begun.get(timeout=TIMEOUT) == THIRD_STRICT
    loading.go_on.release()
    assert beside.taken.get(timeout=TIMEOUT) == THIRD_STRICT
    loading.ready.append(FIRST)
    beside.request(FOURTH)
    assert loading.begun.get(timeout=TIMEOUT) == FOURTH
    beside.request(FIRST)  # is ready: FOURTH is no longer requested
    assert beside.taken.get(timeout=TIMEOUT) == FIRST
    loading.go_on.release()
    beside.stop()
    assert beside.taken.empty()
    assert loading.begun.empty()


def test_an_error_does_not_keep_it_waiting(loading: Loading) -> None:
    """It is warned of, and the first block raises it again."""
    loading.error = ValueError('no such thing')
    beside = Beside()
    beside.request(FIRST)
    loading.go_on.release()
    assert beside.taken.get(timeout=TIMEOUT) == FIRST
    assert beside.warned == ['a detector raised an error while it was compiled: no such thing']


def test_portable_kernels_are_replaced_beside_the_filter(
    loading: Loading, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They take over at once; those of the host between two clouds, and that is said once."""
    steps: queue.SimpleQueue[str] = queue.SimpleQueue()
    compiled = threading.Event()

    def compile_all(_processes: compiling.Processes, _work: object) -> list[str]:
        assert compiled.wait(TIMEOUT)
        return []

    monkeypatch.setattr(kernel_cache, 'portable', {'a kernel'})
    monkeypatch.setattr(kernel_cache, 'read_host', lambda: lambda: steps.put('replaced'))
    monkeypatch.setattr(compiling.Processes, 'run', compile_all)
    between: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
    taken: queue.SimpleQueue[FilterParameters] = queue.SimpleQueue()
    beside = Compiler(taken.put, steps.put, steps.put, between.put)
    beside.request(FIRST)
    loading.go_on.release()
    assert taken.get(timeout=TIMEOUT) == FIRST
    # Another threshold ends nothing.
    loading.ready.append(stricter := FIRST.changed({'max_delay': 9.0}))
    beside.request(stricter)
    assert taken.get(timeout=TIMEOUT) == stricter
    compiled.set()
    between.get(timeout=TIMEOUT)()
    assert steps.get_nowait() == 'replaced'
    assert steps.get_nowait() == 'now using kernels for this processor, compiled in 0 s'
    assert steps.empty()


def test_what_does_not_last_is_not_compiled(
    loading: Loading, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of chains that follow each other, processes compile the last: each takes all cores."""
    compiled: list[str] = []

    def run(_self: object, work: list[str], _show: object) -> list[str]:
        compiled.extend(work)
        return []

    monkeypatch.setattr(compiler, 'load', lambda _parameters: False)
    monkeypatch.setattr(compiler, 'shares', lambda parameters: parameters.chain)
    monkeypatch.setattr(compiler, 'make_ready', loading.ready.append)
    monkeypatch.setattr(compiling.Processes, 'run', run)
    loading.ready.append(FIRST)
    beside = Beside()
    beside.request(FIRST)
    for requested in (SECOND, THIRD, FOURTH):
        beside.request(requested)
        threading.Event().wait(0.1)
    assert beside.taken.get(timeout=TIMEOUT) == FIRST
    assert beside.taken.get(timeout=TIMEOUT) == FOURTH
    assert compiled == ['elevation']
