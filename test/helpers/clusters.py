# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Programs whose lines can be awaited, and a scheduler with its workers, started as users do."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING

import psutil

from helpers.archives import SIGNALLING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from contextlib import AbstractContextManager

PATIENCE = 300.0  # seconds for an end that comes, on a machine with much other work
OWN = 0  # group of processes: as if all of a terminal get the signal


class Program:
    """A process whose lines on stderr can be awaited."""

    def __init__(self, *words: str) -> None:
        """Start Python with some words, in a session of its own."""
        self.process = subprocess.Popen(
            [sys.executable, '-P', *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        self.said = ''

    def until(self, text: str) -> str:
        """Read up to the line that holds a text."""
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self.said += line
            if text in line:
                return line
        raise AssertionError(f'{text} never came: {self.said}')

    def rest(self) -> tuple[int, str]:
        """Wait for the end; return the exit status, and all that was said."""
        out, err = self.process.communicate(timeout=PATIENCE)
        return self.process.returncode, self.said + err + out

    def kill(self) -> None:
        """End it, with all that it has started, at once."""
        os.killpg(self.process.pid, signal.SIGKILL)


@contextmanager
def program(*words: str) -> Iterator[Program]:
    """Start a program, and end it with all that it has started."""
    one = Program(*words)
    try:
        yield one
    finally:
        if one.process.poll() is None:
            one.kill()
        one.process.communicate()


def signalling(
    number: signal.Signals, group: int, last: int, arguments: Iterable[str]
) -> AbstractContextManager[Program]:
    """Start a replay that sends a group of processes a signal when so many tasks are done."""
    return program('-c', SIGNALLING, str(int(number)), str(group), str(last), *arguments)


@contextmanager
def cluster(workers: int = 1) -> Iterator[tuple[str, Program]]:
    """Start a scheduler and workers, as users do; give its address, and its process."""
    plain = ('--no-dashboard', '--host', '127.0.0.1')
    with ExitStack() as stack:
        scheduler = stack.enter_context(
            program('-m', 'distributed.cli.dask_scheduler', *plain, '--port', '0')
        )
        address = scheduler.until('Scheduler at:').split()[-1]
        words = (address, '--nthreads', '1', '--no-nanny', '--no-dashboard')
        started = [
            stack.enter_context(program('-m', 'distributed.cli.dask_worker', *words))
            for _ in range(workers)
        ]
        for worker in started:
            worker.until('Registered to:')
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
    return psutil.wait_procs(found, timeout=PATIENCE)[1]
