# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Processes that tests start, and whose lines are awaited."""

import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Self

# Seconds until what a test waits for is given up; reached in failures only. Kernels take minutes
# to compile beside other work. A little less than the time-out of a test: that says where it was.
TIMEOUT = 540.0


def ended(
    *command: object, folder: Path | None = None, env: Mapping[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run a program to its end; return its status, and what it says."""
    return subprocess.run(
        [*map(str, command)],
        cwd=folder,
        env={**os.environ, **(env or {})},
        capture_output=True,
        text=True,
        check=False,
        timeout=TIMEOUT,
    )


class Program:
    """A process that a test started: its lines are awaited, and it does not outlive the test."""

    def __init__(self, *command: str | Path, env: Mapping[str, str] | None = None) -> None:
        """Start Python with these arguments, in a session of its own."""
        self._process = subprocess.Popen(
            [sys.executable, *map(str, command)],
            env={**os.environ, 'PYTHONUNBUFFERED': '1', **(env or {})},
            start_new_session=True,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.output: list[str] = []
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._reading = threading.Thread(target=self._read)
        self._reading.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line.rstrip('\n'))
        self._lines.put(None)

    def wait_for(self, text: str, patience: float = TIMEOUT) -> str:
        """Wait for the next line with this text in it, and return it."""
        for line in self._rest(patience):
            if text in line:
                return line
        raise AssertionError(f'ended without {text!r}:\n' + '\n'.join(self.output))

    def _rest(self, patience: float = TIMEOUT) -> Iterator[str]:
        end = time.monotonic() + patience
        while True:
            try:
                line = self._lines.get(timeout=max(0.0, end - time.monotonic()))
            except queue.Empty:
                raise AssertionError('no more lines:\n' + '\n'.join(self.output)) from None
            if line is None:
                return
            self.output.append(line)
            yield line

    def signal(self, number: int) -> None:
        """Send it a signal."""
        self._process.send_signal(number)

    def send(self, line: str) -> None:
        """Write a line to its stdin."""
        assert self._process.stdin is not None
        self._process.stdin.write(line + '\n')
        self._process.stdin.flush()

    def close(self) -> None:
        """Close its stdin, which says the programs below to go."""
        assert self._process.stdin is not None
        self._process.stdin.close()

    def wait(self) -> int:
        """Wait for its end; return the exit status. All it said is in ``output`` then."""
        for _ in self._rest():
            pass
        return self._process.wait(TIMEOUT)

    @property
    def pid(self) -> int:
        """Its number, and that of its group."""
        return self._process.pid

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End it, with all that it has started, if it has not ended."""
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._reading.join()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()
