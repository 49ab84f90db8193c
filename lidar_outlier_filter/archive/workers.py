# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Processes for tasks: threads of this one, workers of this machine, or a Dask cluster.

Dask sends a task to another worker when one dies or fails, restarts workers of this machine, and
gives up on a task during which several workers died.
"""

# ruff: noqa: PLC0415  distributed is an extra, and takes half a second

from __future__ import annotations

import logging
import os
import signal
from concurrent.futures import CancelledError, Executor, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.core.kernels.threads import keep_memory
from lidar_outlier_filter.errors import FilterError, SchedulerError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from distributed import Worker

RETRIES = 2  # of a task that failed on a worker, as for want of a network
NICENESS = 2  # of a worker, above that of the command
MAX_WAIT_S = 30.0  # for a scheduler to respond
QUIET = {
    # By default Dask samples its processes a hundred times per second: 2 % of their time.
    'distributed.worker.profile.enabled': False,
    'distributed.admin.system-monitor.interval': '5s',
}


@dataclass(frozen=True)
class Workers:
    """An executor of tasks.

    Attributes
    ----------
    executor : runs functions
    count : returns how many tasks run at once
    client, address : of Dask and its scheduler; None: the executor has threads of this process
    keep : called regularly; replaces workers that are gone for good, or reports that there is none

    """

    executor: Executor
    count: Callable[[], int]
    client: Any = None
    address: str = ''
    keep: Callable[[], object] = bool

    def check(self) -> None:
        """Refuse to continue without a scheduler."""
        if self.client is not None and self.client.status != 'running':
            raise self.gone()
        self.keep()

    def gone(self) -> SchedulerError:
        """Return the error for a scheduler that is gone."""
        must_be = 'there until the end'
        return SchedulerError(f'the scheduler {self.address}', must_be, 'no response')


def dask_setup(worker: Worker) -> None:
    """Ignore the Ctrl-C of a terminal, which the command handles, and keep freed memory.

    A worker calls this when it starts with ``--preload lidar_outlier_filter.archive.workers``.
    By default Dask returns all free memory to the system, which costs a third of the time.
    """
    if worker.nanny is not None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(NICENESS)
    keep_memory()


def are_available() -> bool:
    """Return whether Dask is installed."""
    return find_spec('distributed') is not None


@contextmanager
def threads(number: int) -> Iterator[Workers]:
    """Use threads of this process; the kernels of each use all cores."""
    executor = ThreadPoolExecutor(number)
    try:
        yield Workers(executor, lambda: number)
    finally:
        executor.shutdown(cancel_futures=True)


@contextmanager
def local_workers(jobs: int) -> Iterator[Workers]:
    """Start workers on this machine, each a process with one thread."""
    _require()
    from dask import config
    from distributed import LocalCluster

    with ExitStack() as stack:
        with config.set(QUIET):
            cluster = LocalCluster(
                n_workers=jobs,
                threads_per_worker=1,
                processes=True,
                host='127.0.0.1',
                dashboard_address=':0',  # any free port
                silence_logs=logging.CRITICAL,
                preload=[__name__],
            )
        stack.callback(cluster.close, timeout=MAX_WAIT_S)
        # A worker that takes more than 15 s to restart is given up by Dask: start another one.
        yield stack.enter_context(_client(cluster, lambda: cluster.scale(jobs)))


@contextmanager
def cluster_workers(
    address: str | None, file: str | None = None, inform: Callable[[str], object] = str
) -> Iterator[Workers]:
    """Use the workers of a running cluster, found by the address of its scheduler or its file."""
    _require()
    with _client(address, scheduler_file=file) as workers:

        def keep() -> None:
            if not workers.count():
                inform('the cluster has no worker: waiting for one')

        yield replace(workers, keep=keep)


@contextmanager
def _client(
    cluster: Any, keep: Callable[[], object] = bool, scheduler_file: str | None = None
) -> Iterator[Workers]:
    from distributed import Client

    try:
        client = Client(
            cluster, timeout=MAX_WAIT_S, set_as_default=False, scheduler_file=scheduler_file
        )
    except (OSError, ValueError, TimeoutError) as err:
        must_be = f'that of a Dask scheduler that responds within {MAX_WAIT_S:g} s'
        raise SchedulerError('--scheduler', must_be, cluster or scheduler_file) from err

    def count() -> int:
        try:
            threads: dict[str, int] = client.nthreads()
            return sum(threads.values())
        except (OSError, TimeoutError, CancelledError) as err:
            raise workers.gone() from err

    with ExitStack() as stack:
        # A lost connection is reported by :class:`SchedulerError`.
        for handler in logging.getLogger('distributed').handlers:
            stack.callback(handler.setLevel, handler.level)
            handler.setLevel(logging.CRITICAL + 1)
        stack.enter_context(client)
        executor = client.get_executor(retries=RETRIES, pure=False)
        workers = Workers(executor, count, client, client.scheduler.address, keep)
        try:
            yield workers
        finally:
            if client.status == 'running':
                executor.shutdown(wait=False)


def _require() -> None:
    if not are_available():
        must_be = 'installed for several processes (pip install lidar_outlier_filter[archive])'
        raise FilterError('the module distributed', must_be, 'none')
