# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C and SIGTERM: while a command imports, twice while it works, and when all is written."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest
from helpers import ROOT, names
from helpers.drives import write_drive
from helpers.programs import ended

from lidar_outlier_filter.cli.terminal import SIGNALS, handlers_kept, ignore

# A process that was started in the background of a shell would ignore SIGINT.
BEGIN = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from lidar_outlier_filter.cli import start
from lidar_outlier_filter.cli.terminal import stopping
def interrupt(number=signal.SIGINT):
    os.kill(os.getpid(), number)
"""
IMPORTS = """
requested = sys.argv.pop()
class Finder:
    def find_spec(self, name, path, target=None):
        if name == requested:
            interrupt()
sys.meta_path.insert(0, Finder())
{wrapped}
sys.exit(start())
"""
DEAF = """
from itertools import repeat
with stopping():
    print('works', flush=True)
    sum(repeat(0))
"""
DONE = """
import lidar_outlier_filter.cli.tables as tables
show = tables.show_file
def slow(*what):
    interrupt(), interrupt(signal.SIGTERM)
    show(*what)
    interrupt()
tables.show_file = slow
import atexit
atexit.register(interrupt)
sys.exit(start())
"""
# Whoever catches all that an import raises would lose the exception.
SWALLOWED = """
import builtins
plain = builtins.__import__
def swallow(name, *rest):
    try:
        return plain(name, *rest)
    except ImportError:
        raise
    except BaseException:
        raise ImportError('something else') from None
builtins.__import__ = swallow
"""


def cloud(folder: Path) -> str:
    """Write a small cloud."""
    path = folder / 'cloud.csv'
    path.write_text('x,y,z\n' + ''.join(f'{i},{i * i % 7},0\n' for i in range(50)))
    return str(path)


@pytest.mark.parametrize(
    ('module', 'wrapped'),
    [('lidar_outlier_filter.cli.main', ''), ('numpy', ''), ('rich', SWALLOWED)],
)
def test_interrupted_import(tmp_path: Path, module: str, wrapped: str) -> None:
    """Ctrl-C in the first second, when all is imported, gives status 130 and not a word."""
    program = BEGIN + IMPORTS.format(wrapped=wrapped)
    command = [sys.executable, '-c', program, 'clean', cloud(tmp_path), module]
    done = ended(*command)
    assert (done.returncode, done.stdout, done.stderr) == (130, '', '')
    assert [path.name for path in tmp_path.iterdir()] == ['cloud.csv']


def catches(process: subprocess.Popen[str], number: signal.Signals) -> bool:
    """Return whether a process still catches a signal."""
    status = Path(f'/proc/{process.pid}/status').read_text()
    (caught,) = (line.split()[1] for line in status.splitlines() if line.startswith('SigCgt'))
    return bool(int(caught, 16) >> (number - 1) & 1)


@pytest.mark.parametrize('number', SIGNALS)
def test_the_second_signal_ends_at_once(number: signal.Signals) -> None:
    """Where no handler ever comes to run, the second signal ends the process."""
    command = [sys.executable, '-c', BEGIN + DEAF]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == 'works\n'
            process.send_signal(number)
            while catches(process, number):  # the first has not come yet
                assert process.poll() is None
            process.send_signal(number)
            assert process.wait(timeout=10) == -number
        finally:
            process.kill()  # it would work for ever where this fails


@pytest.mark.slow
def test_all_is_written(tmp_path: Path) -> None:
    """Signals after the output is complete change nothing: the status says that all is done."""
    command = [sys.executable, '-c', BEGIN + DONE, 'clean', cloud(tmp_path)]
    done = ended(*command)
    assert done.returncode == 0
    assert 'Traceback' not in done.stderr
    assert f'written to {tmp_path}/cloud_cleaned.csv' in done.stdout


def test_the_caller_keeps_its_handlers() -> None:
    """Whoever runs a command within a process finds its handlers as they were."""
    before = [signal.getsignal(number) for number in SIGNALS]
    with handlers_kept():
        ignore()
        assert [signal.getsignal(number) for number in SIGNALS] == [signal.SIG_IGN] * 2
    assert [signal.getsignal(number) for number in SIGNALS] == before


def test_tables_name_both_exit_statuses() -> None:
    """128 + the number of the signal, as shells have it."""
    rows = [
        line
        for page in (ROOT / 'doc').glob('*.md')
        for line in page.read_text().splitlines()
        if line.startswith('| 130')
    ]
    assert len(rows) == 4
    assert all(row.startswith('| 130, 143 | interrupted by SIGINT (Ctrl-C), by') for row in rows)


@pytest.mark.slow
@pytest.mark.parametrize(
    ('words', 'begun', 'number'),
    [
        ('replay long --output out', '.out.partial-*/out/*.mcap', signal.SIGTERM),
        ('replay long --output out', '.out.partial-*/out/*.mcap', signal.SIGKILL),
        ('clean long.csv', '.long_cleaned.csv.partial-*', signal.SIGINT),
        ('clean long.csv --tile 10', '.long_cleaned.csv.partial-*', signal.SIGTERM),
    ],
)
def test_ended_in_the_middle(
    tmp_path: Path, words: str, begun: str, number: signal.Signals
) -> None:
    """Nothing is left, and no trace; what a kill leaves is hidden, and the next run removes it."""
    if 'replay' in words:
        write_drive(tmp_path / 'long', 800)
    else:
        (tmp_path / 'long.csv').write_text('x,y,z\n' + '1.5,2.5,0\n' * 1_200_000)
    before = names(tmp_path)
    command = [sys.executable, '-c', BEGIN + 'sys.exit(start())', *words.split()]
    with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as process:
        while not any(path.stat().st_size for path in tmp_path.glob(begun)):
            with pytest.raises(subprocess.TimeoutExpired):
                process.wait(timeout=0.02)
        process.send_signal(number)
        _, said = process.communicate(timeout=60)
    assert 'Traceback' not in said
    if number != signal.SIGKILL:
        assert process.returncode == 128 + number
        assert names(tmp_path) == before
    else:
        assert [name for name in names(tmp_path) if not name.startswith('.')] == before
        assert ended(*command, folder=tmp_path).returncode == 0
        assert names(tmp_path) == [*before, 'out']
