# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Small wrong changes to the code, one at a time, each run against the tests that must catch it.

    python benchmarks/mutate.py [--only PATTERN] [--jobs N] [--list]

The changes are listed in mutations.toml. A table for each file names it and the tests that stand
near it; each change has the old text, which must occur exactly once, the new one, and why it
matters. It may name tests of its own.

All work is done in copies of the project in a temporary folder. The tests must pass there unchanged
first, which compiles the kernels, too. Each change then begins with a fresh copy of that. Compiled
kernels carry a stamp of their sources: those that the change reaches are compiled anew.

Printed are what became of each change, and the score. The exit status is 0 where all were caught,
1 where one survived, and 2 where the list does not fit the code or the tests do not run.
"""

# ruff: noqa: INP001  a script, no package

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import TYPE_CHECKING, NamedTuple

from rich.console import Console
from rich.table import Table

from lidar_outlier_filter.errors import FilterError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

ROOT = Path(__file__).resolve().parents[1]
LIST = Path(__file__).with_name('mutations.toml')
# Bytecode is left out: Python would take that of an equally long file of the same second.
LEFT_OUT = shutil.ignore_patterns('.git', '.venv', '*.pyc', '.*_cache')
TEST_SECONDS = 300  # for one test, where Python can still stop it
RUN_SECONDS = 900  # for all tests of one change, where a kernel does not end
PASSED, FAILED = 0, 1  # exit statuses of pytest


class Mutation(NamedTuple):
    """One change: a text of a file that becomes another, why it matters, and who must catch it."""

    file: str
    old: str
    new: str
    why: str
    tests: tuple[str, ...]

    @property
    def name(self) -> str:
        """Name it for people."""
        return f'{self.file}: {self.why}'


class Outcome(NamedTuple):
    """What became of a change: the test that caught it, empty where it survived, and seconds."""

    caught_by: str
    seconds: float


def read(path: Path) -> list[Mutation]:
    """Read a list of changes."""
    listed = tomllib.loads(path.read_text(encoding='utf-8'))
    return [
        Mutation(
            module['file'],
            item['old'],
            item['new'],
            item['why'],
            tuple(item.get('tests', module['tests'])),
        )
        for module in listed['module']
        for item in module['mutation']
    ]


def choose(pattern: str) -> list[Mutation]:
    """Read the changes whose file or reason holds a pattern, and check that they fit the code."""
    mutations = [mutation for mutation in read(LIST) if re.search(pattern, mutation.name)]
    if not mutations:
        raise FilterError('--only', 'found in the file or the reason of a change', pattern)
    check(mutations, ROOT)
    return mutations


def check(mutations: Iterable[Mutation], root: Path) -> None:
    """Refuse changes that do not fit the project in ``root``.

    Raises
    ------
    FilterError
        If an old text does not occur exactly once, or a file or a test does not exist.

    """
    for mutation in mutations:
        changed(mutation, root)
        for test in mutation.tests:
            file, _, name = test.partition('::')
            path = root / file
            if not path.is_file():
                raise FilterError(f'the test file of {mutation.name}', 'there', file)
            if name and f'def {name.partition("[")[0]}(' not in path.read_text(encoding='utf-8'):
                raise FilterError(f'the test of {mutation.name}', f'in {file}', name)


def changed(mutation: Mutation, root: Path) -> str:
    """Return the text of a file after a change."""
    path = root / mutation.file
    if not path.is_file():
        raise FilterError('the file to change', 'there', mutation.file)
    text = path.read_text(encoding='utf-8')
    count = text.count(mutation.old)
    if count != 1:
        raise FilterError(f'the old text of {mutation.name}', 'there exactly once', count)
    return text.replace(mutation.old, mutation.new)


def apply(mutation: Mutation, root: Path) -> None:
    """Change a file of the project in ``root``."""
    text = changed(mutation, root)
    (root / mutation.file).write_text(text, encoding='utf-8')


def copy(source: Path, folder: Path) -> Path:
    """Copy a project into an empty folder, beside the recordings that it reads."""
    recordings = source.parent / 'shared'
    if recordings.exists():
        (folder / 'shared').symlink_to(recordings.resolve())
    return Path(shutil.copytree(source, folder / source.name, symlinks=True, ignore=LEFT_OUT))


def run(root: Path, tests: Iterable[str], *options: str) -> tuple[int | None, str]:
    """Run tests of a project; return pytest's exit status and output, None where it has no end."""
    words = ['-m', 'pytest', '-q', '-n0', '-p', 'no:cacheprovider', f'--timeout={TEST_SECONDS}']
    paths = [str(root), *filter(None, [os.environ.get('PYTHONPATH')])]
    env = os.environ | {
        'PYTHONPATH': os.pathsep.join(paths),
        'PYTHONDONTWRITEBYTECODE': '1',
    }
    try:
        done = subprocess.run(  # noqa: S603  the tests are the project's own
            [sys.executable, *words, *options, *tests],
            cwd=root,
            env=env,
            check=False,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=RUN_SECONDS if '-x' in options else None,
        )
    except subprocess.TimeoutExpired:
        return None, ''
    return done.returncode, done.stdout


def begin(root: Path, mutations: Sequence[Mutation]) -> None:
    """Run all tests of some changes in a project as it is.

    Raises
    ------
    FilterError
        If one fails or is skipped: it could catch nothing.

    """
    tests = dict.fromkeys(test for mutation in mutations for test in mutation.tests)
    # A file with all its tests holds those that are named beside it.
    named = [test for test in tests if '::' not in test or test.partition('::')[0] not in tests]
    status, said = run(root, named)
    if status != PASSED or re.search(r'\d+ skipped', said):
        raise FilterError('the tests of the changes', 'passed where nothing is changed', said)


def judge(mutation: Mutation, source: Path) -> Outcome:
    """Run the tests of a change in a copy of a project that has it.

    Raises
    ------
    FilterError
        If they do not run, as where the changed file cannot be imported.

    """
    with TemporaryDirectory(dir=source.parent) as folder:
        root = copy(source, Path(folder))
        apply(mutation, root)
        start = perf_counter()
        status, said = run(root, mutation.tests, '-x')
        seconds = perf_counter() - start
    if status == PASSED:
        return Outcome('', seconds)
    # A negative status is that of a signal: the change has crashed Python.
    if status is None or status < PASSED:
        return Outcome('a crash, or no end', seconds)
    found = re.findall(r'^(?:FAILED|ERROR) (\S+)|(\+ Timeout \+)', said, re.MULTILINE)
    # Where pytest is not installed the status is that of failed tests, too.
    if status > FAILED or not found:
        raise FilterError(f'the tests of {mutation.name}', 'run', said)
    return Outcome(found[0][0] or 'a test without end', seconds)


def judge_all(mutations: Sequence[Mutation], jobs: int, root: Path = ROOT) -> list[Outcome]:
    """Judge changes, some at a time, and say what becomes of each when it is known."""

    def one(mutation: Mutation) -> Outcome:
        outcome = judge(mutation, source)
        word = 'caught' if outcome.caught_by else 'SURVIVED'
        sys.stdout.write(f'{word:8} {outcome.seconds:4.0f} s  {mutation.name}\n')
        sys.stdout.flush()
        return outcome

    with TemporaryDirectory(prefix='mutate-') as folder:
        source = copy(root, Path(folder))
        begin(source, mutations)
        pool = ThreadPoolExecutor(jobs)
        try:
            return list(pool.map(one, mutations))
        finally:
            pool.shutdown(cancel_futures=True)


def show(mutations: Sequence[Mutation], outcomes: Sequence[Outcome]) -> None:
    """Print a table, and the score."""
    console = Console()
    table = Table('file', 'change', 'caught by', 's')
    table.columns[-1].justify = 'right'
    for mutation, outcome in zip(mutations, outcomes, strict=True):
        by = outcome.caught_by.rpartition('/')[2] or '[bold]survived[/bold]'
        file = mutation.file.partition('/')[2]
        table.add_row(file, mutation.why, by, f'{outcome.seconds:.0f}')
    console.print(table)
    caught = sum(bool(outcome.caught_by) for outcome in outcomes)
    share = f'{caught / len(outcomes):.1%}'
    console.print(f'{caught} of {len(outcomes)} changes were caught: {share}', highlight=False)


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line, and run; returns the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument('--only', default='', metavar='PATTERN', help='regular expression')
    parser.add_argument('--jobs', type=int, default=1, metavar='N', help='changes at a time')
    parser.add_argument('--list', action='store_true', help='print the changes, run nothing')
    options = parser.parse_args(arguments)
    try:
        mutations = choose(options.only)
        if options.list:
            sys.stdout.writelines(f'{item.name}\n' for item in mutations)
            return 0
        outcomes = judge_all(mutations, options.jobs)
    except FilterError as err:
        sys.stderr.write(f'{err}\n')
        return 2
    show(mutations, outcomes)
    return 0 if all(outcome.caught_by for outcome in outcomes) else 1


if __name__ == '__main__':
    sys.exit(main())
