# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A scheduler with its workers, started as users do, and a replay that sends signals."""

import signal
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress

import psutil

from helpers.archives import SIGNALLING
from helpers.programs import TIMEOUT, Program

OWN = 0  # group of processes: as if all of a terminal get the signal


def signalling(number: signal.Signals, group: int, last: int, arguments: Iterable[str]) -> Program:
    """Start a replay that sends a group of processes a signal when so many tasks are done."""
    return Program('-P', '-c', SIGNALLING, str(int(number)), str(group), str(last), *arguments)


@contextmanager
def cluster(workers: int = 1) -> Iterator[tuple[str, Program]]:
    """Start a scheduler and workers, as users do; give its address, and its process."""
    plain = ('--no-dashboard', '--host', '127.0.0.1')
    with ExitStack() as stack:
        scheduler = stack.enter_context(
            Program('-P', '-m', 'distributed.cli.dask_scheduler', *plain, '--port', '0')
        )
        address = scheduler.wait_for('Scheduler at:').split()[-1]
        words = (address, '--nthreads', '1', '--no-nanny', '--no-dashboard')
        started = [
            stack.enter_context(Program('-P', '-m', 'distributed.cli.dask_worker', *words))
            for _ in range(workers)
        ]
        for worker in started:
            worker.wait_for('Registered to:')
        yield address, scheduler


def worker_processes() -> list[psutil.Process]:
    """List the workers that this process has started, and that have not ended."""
    return [one for one in psutil.Process().children(recursive=True) if _is_worker(one)]


def _is_worker(process: psutil.Process) -> bool:
    try:
        return any('spawn_main' in word for word in process.cmdline())
    except psutil.NoSuchProcess:  # it ends at this moment
        return False


def survivors(numbers: Iterable[int]) -> list[psutil.Process]:
    """Wait for the end of processes; list those that do not end."""
    found = []
    for number in numbers:
        with suppress(psutil.NoSuchProcess):
            found.append(psutil.Process(number))
    return psutil.wait_procs(found, timeout=TIMEOUT)[1]
