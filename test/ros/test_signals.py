# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What SIGINT and SIGTERM do to the node: the first lets it finish, the second does not."""

import signal
import subprocess
import sys

import pytest

# What it finishes takes hours: it waits for a thread, or computes, as a kernel does.
PROGRAM = """
import threading
from lidar_outlier_filter.ros.executable import on_stop

stop = threading.Event()
on_stop(stop.set)
print('ready', flush=True)
stop.wait()
print('finishing', flush=True)
{busy}
"""
WAITS = 'threading.Event().wait()'
COMPUTES = 'sum(range(10**15))'  # in C: Python handles no signal before it ends


@pytest.mark.parametrize(
    ('first', 'second', 'busy'),
    [
        (signal.SIGINT, signal.SIGINT, WAITS),
        (signal.SIGTERM, signal.SIGTERM, COMPUTES),
        (signal.SIGINT, signal.SIGTERM, COMPUTES),
    ],
)
def test_the_second_ends_it_at_once(
    first: signal.Signals, second: signal.Signals, busy: str
) -> None:
    """Whichever they are, and whatever runs."""
    command = [sys.executable, '-c', PROGRAM.format(busy=busy)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == 'ready\n'
        process.send_signal(first)
        assert process.stdout.readline() == 'finishing\n'
        process.send_signal(second)
        assert process.wait(60) == -second
