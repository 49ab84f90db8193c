# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Programs whose lines can be awaited, and a scheduler with its workers, started as users do."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

import psutil

if TYPE_CHECKING:
    from collections.abc import Iterator

COMMAND = 'lidar_outlier_filter.cli.main'


class Program:
    """A process whose lines on stderr can be awaited."""

    def __init__(self, *words: str) -> None:
        """Start it, in a session of its own."""
        self.process = subprocess.Popen(
            [sys.executable, '-P', '-m', *words],
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
        out, err = self.process.communicate(timeout=200)
        return self.process.returncode, self.said + err + out

    def interrupt(self) -> None:
        """Press Ctrl-C: every process of the terminal gets the signal."""
        os.killpg(self.process.pid, signal.SIGINT)

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


@contextmanager
def cluster(workers: int = 1) -> Iterator[tuple[str, Program]]:
    """Start a scheduler and workers, as users do; give its address, and its process."""
    plain = ('--no-dashboard', '--host', '127.0.0.1')
    with ExitStack() as stack:
        scheduler = stack.enter_context(
            program('distributed.cli.dask_scheduler', *plain, '--port', '0')
        )
        address = scheduler.until('Scheduler at:').split()[-1]
        words = (address, '--nthreads', '1', '--no-nanny', '--no-dashboard')
        started = [
            stack.enter_context(program('distributed.cli.dask_worker', *words))
            for _ in range(workers)
        ]
        for worker in started:
            worker.until('Registered to:')
        yield address, scheduler


def worker_processes() -> list[psutil.Process]:
    """List the workers that this process has started."""
    found = psutil.Process().children(recursive=True)
    return [one for one in found if any('spawn_main' in word for word in one.cmdline())]
