# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Processes that replay recordings, or clean files: of this machine, or of a cluster that runs.

Dask, whose both are, sends work to another worker when one dies or fails, starts workers of this
machine anew, and gives up on what several workers died of.
"""

# ruff: noqa: PLC0415  distributed is an extra, and takes half a second

from __future__ import annotations

import logging
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager, suppress
from itertools import count
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from lidar_outlier_filter.archive import worker_start
from lidar_outlier_filter.errors import FilterError, RecordingError, SchedulerError, said_by

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator

RETRIES = 2  # of work that failed on a worker, as for want of a network
AHEAD = 2  # files of each worker that are cleaned, or wait
PATIENCE = 30.0  # seconds for a scheduler to answer
# Dask looks at what its processes do a hundred times in a second: 2 % of their time.
QUIET = {
    'distributed.worker.profile.enabled': False,
    'distributed.admin.system-monitor.interval': '5s',
}
STEP = 0.5  # seconds between two looks at whether to go on waiting


class Workers:
    """The workers of one scheduler; ``client`` is Dask's."""

    def __init__(
        self, client: Any, address: str, keep: Callable[[], object] = lambda: None
    ) -> None:
        """Take Dask's client of the scheduler at an address.

        ``keep`` is called while work is waited for, and starts workers that have gone for good.
        """
        self.client, self._address, self._keep = client, address, keep
        self._run, self._numbers = uuid4().hex[:8], count()

    @property
    def count(self) -> int:
        """How many recordings they replay, or files they clean, at once."""
        with self._answering():
            threads: dict[str, int] = self.client.nthreads()
        return sum(threads.values())

    @property
    def ahead(self) -> int:
        """How many files they shall have at once, with those that are done."""
        return AHEAD * self.count + 1

    def send(self, work: Callable[..., object], *given: object) -> Any:
        """Send work to be done with what is given; return the future of what comes of it."""
        key = f'{work.__name__}-{self._run}-{next(self._numbers)}'
        with self._answering():
            return self.client.submit(work, *given, key=key, retries=RETRIES, pure=False)

    def first_done(self, futures: Collection[Any]) -> list[Any]:
        """Wait for the first of some futures, not for long; return those that are done.

        Raises
        ------
        SchedulerError
            If the scheduler has gone.

        """
        from distributed import wait

        self.check()
        self._keep()
        with self.client.as_current(), suppress(TimeoutError, CancelledError):
            wait(list(futures), timeout=STEP, return_when='FIRST_COMPLETED')
        return [future for future in futures if future.done()]

    def deaths(self, future: Any) -> int:
        """Count the workers that died with work that was given up for it; 0: it was not."""
        from distributed.scheduler import KilledWorker

        error = future.exception() if future.status == 'error' else None
        return error.allowed_failures + 1 if isinstance(error, KilledWorker) else 0

    def result(self, future: Any, what: str) -> Any:
        """Return what came of work on ``what``, which is done.

        Raises
        ------
        FilterError
            If the work raised it, or failed on each worker that tried, or several died of it.
        SchedulerError
            If the scheduler has gone.

        """
        from distributed.scheduler import KilledWorker

        try:
            return future.result()
        except KilledWorker as err:
            must_be = 'judged without a worker that dies'
            got = f'{err.allowed_failures + 1} that died'
            raise RecordingError(what, must_be, got) from err
        except CancelledError as err:
            raise SchedulerError(*self._gone()) from err
        except FilterError:
            raise
        except Exception as err:  # whatever comes from another machine
            raise RecordingError(what, 'judged by the workers', said_by(err)) from err

    def check(self) -> None:
        """Refuse to go on without a scheduler.

        Raises
        ------
        SchedulerError
            If it has gone.

        """
        if self.client.status != 'running':
            raise SchedulerError(*self._gone())

    def give_up(self, future: Any) -> None:
        """Forget a recording or a file; where nobody answers, there is nothing to forget."""
        with suppress(SchedulerError), self._answering():
            self.client.cancel([future], force=True)

    @contextmanager
    def _answering(self) -> Iterator[None]:
        """Refuse to go on without a scheduler."""
        self.check()
        try:
            yield
        except (OSError, TimeoutError, CancelledError) as err:
            raise SchedulerError(*self._gone()) from err

    def _gone(self) -> tuple[str, str, str]:
        return f'the scheduler {self._address}', 'there until the end', 'no answer any more'


def check_code(worker: str, code: str, own: str) -> None:
    """Refuse a worker whose code is not that of this process.

    Raises
    ------
    SchedulerError
        If it is of another version.

    """
    if code != own:
        raise SchedulerError(f'the worker {worker}', f'of version {own}, as this process', code)


def are_available() -> bool:
    """Return whether this machine can have several workers."""
    from importlib.util import find_spec

    return find_spec('distributed') is not None


@contextmanager
def local_workers(jobs: int) -> Iterator[Workers]:
    """Start workers on this machine, each a process with one thread; end them at the end.

    Raises
    ------
    FilterError
        If Dask is not installed.

    """
    with ExitStack() as stack:
        _require()
        from dask import config
        from distributed import Client, LocalCluster

        with config.set(QUIET):
            cluster = LocalCluster(
                n_workers=jobs,
                threads_per_worker=1,
                processes=True,
                host='127.0.0.1',
                dashboard_address=':0',  # any port: others may use the usual one
                silence_logs=logging.CRITICAL,
                preload=[worker_start.__name__],
            )
        stack.callback(cluster.close, timeout=PATIENCE)
        client = stack.enter_context(Client(cluster, set_as_default=False))
        # Dask gives up on a worker that dies and takes 15 s to come back: this starts another.
        yield Workers(client, cluster.scheduler_address, lambda: cluster.scale(jobs))


@contextmanager
def cluster_workers(address: str, inform: Callable[[str], object] = str) -> Iterator[Workers]:
    """Use the workers of a cluster that runs; ``inform`` gets a sentence where it has none yet.

    Raises
    ------
    FilterError
        If Dask is not installed.
    SchedulerError
        If no scheduler answers at the address.

    """
    _require()
    from distributed import Client

    try:
        client = Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as err:
        must_be = f'that of a Dask scheduler that answers within {PATIENCE:g} s'
        raise SchedulerError('--scheduler', must_be, address) from err
    with _silent(), client:
        if not client.nthreads():
            inform(f'the cluster of {address} has no worker yet: all waits for one')
        yield Workers(client, address)


@contextmanager
def _silent() -> Iterator[None]:
    """Keep Dask from writing of lost connections, of which :class:`SchedulerError` says all."""
    names = [name for name in logging.root.manager.loggerDict if name.startswith('distributed')]
    loggers = [logging.getLogger(name) for name in names]  # each has a level of its own
    before = [logger.level for logger in loggers]
    try:
        for logger in loggers:
            logger.setLevel(logging.CRITICAL + 1)
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)


def _require() -> None:
    if not are_available():
        must_be = 'installed for several processes (pip install lidar_outlier_filter[archive])'
        raise FilterError('the module distributed', must_be, 'none')
