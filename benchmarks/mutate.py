# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Small wrong changes to a module, one at a time, each run against the tests that should catch it.

    scripts/environment python benchmarks/mutate.py FILE[::FUNCTION] TEST ... [--most N] [--jobs N]

A change turns a comparison, a sum, a product or a condition around, makes a number larger by one,
or leaves out a statement. Of more than ``--most`` some are drawn. A change that survives is either
one that changes nothing, or a test that is missing: look at each.

All work is done in copies of the project in a temporary folder. The tests must pass there unchanged
first, which compiles the kernels, too. Each change then begins with a fresh copy of that. Compiled
kernels carry a stamp of their sources: those that the change reaches are compiled anew.

Printed are what became of each change, and the score. The exit status is 0 where all were caught,
1 where one survived, and 2 where there is nothing to change or the tests do not run.
"""

# ruff: noqa: INP001  a script, no package

from __future__ import annotations

import argparse
import ast
import copy as copies
import os
import random
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import TYPE_CHECKING, Any, NamedTuple

from rich.console import Console
from rich.table import Table

from lidar_outlier_filter.errors import FilterError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

ROOT = Path(__file__).resolve().parents[1]
# Bytecode is left out: Python would take that of an equally long file of the same second.
LEFT_OUT = shutil.ignore_patterns('.git', '.venv', '*.pyc', '.*_cache')
TEST_SECONDS = 300  # for one test, where Python can still stop it
RUN_SECONDS = 900  # for all tests of one change, where a kernel does not end
PASSED, FAILED = 0, 1  # exit statuses of pytest


# What a sign becomes.
TURNED: dict[type[ast.AST], type[ast.AST]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.And: ast.Or,
    ast.Or: ast.And,
}


class Mutation(NamedTuple):
    """One change: a part of a file, from one character to another, that becomes another text."""

    file: str
    line: int
    begin: int
    end: int
    old: str
    new: str
    tests: tuple[str, ...]

    @property
    def name(self) -> str:
        """Name it for people."""
        old, new = (' '.join(text.split()) for text in (self.old, self.new))
        return f'{self.file}:{self.line}: {old} → {new}'


class Outcome(NamedTuple):
    """What became of a change: the test that caught it, empty where it survived, and seconds."""

    caught_by: str
    seconds: float


def find(root: Path, file: str, function: str, tests: Sequence[str]) -> list[Mutation]:
    """List the changes of a file, or of one function or class of it.

    Raises
    ------
    FilterError
        If there is no such file or function, or nothing in it to change.

    """
    path = root / file
    if not path.is_file():
        raise FilterError('the file to change', 'there', file)
    text = path.read_text(encoding='utf-8')
    tree: ast.AST = ast.parse(text)
    if function:
        named = (ast.FunctionDef, ast.ClassDef)
        parts = [one for one in ast.walk(tree) if isinstance(one, named) and one.name == function]
        if len(parts) != 1:
            raise FilterError(f'the function in {file}', 'there once', function)
        tree = parts[0]
    lines = [0]  # bytes before each line
    for line in text.encode().splitlines(keepends=True):
        lines.append(lines[-1] + len(line))
    found = []
    for node in _code(tree):
        for new in _turned(node):
            begin = lines[node.lineno - 1] + node.col_offset
            end = lines[(node.end_lineno or 0) - 1] + (node.end_col_offset or 0)
            old = text.encode()[begin:end].decode()
            found.append(Mutation(file, node.lineno, begin, end, old, new, tuple(tests)))
    if not found:
        raise FilterError(f'what can be changed in {file}', 'at least one place', 'none')
    return found


def _code(node: ast.AST) -> Iterator[Any]:
    """Walk statements and expressions; not annotations, texts, and what is for types only."""
    yield node
    for name, value in ast.iter_fields(node):
        if name in {'annotation', 'returns', 'decorator_list'}:
            continue
        for child in value if isinstance(value, list) else [value]:
            is_type = isinstance(child, ast.If) and 'TYPE_CHECKING' in ast.unparse(child.test)
            if isinstance(child, ast.AST) and not isinstance(child, ast.JoinedStr) and not is_type:
                yield from _code(child)


def _turned(node: ast.AST) -> Iterator[str]:
    """Write what a node may become."""
    other: Any = copies.deepcopy(node)
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        other.ops = [TURNED[type(node.ops[0])]()]
        yield f'({ast.unparse(other)})'
    elif isinstance(node, ast.BinOp | ast.BoolOp) and type(node.op) in TURNED:
        other.op = TURNED[type(node.op)]()
        yield f'({ast.unparse(other)})'
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        yield f'({ast.unparse(node.operand)})'
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        yield str(not node.value)
    elif isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        yield str(node.value + 1)
    elif isinstance(node, ast.AugAssign) or (
        isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)
    ):
        yield 'pass'


def apply(mutation: Mutation, root: Path) -> None:
    """Change a file of the project in ``root``."""
    path = root / mutation.file
    text = path.read_bytes()
    path.write_bytes(text[: mutation.begin] + mutation.new.encode() + text[mutation.end :])


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
    table = Table('change', 'caught by', 's')
    table.columns[-1].justify = 'right'
    for mutation, outcome in zip(mutations, outcomes, strict=True):
        by = outcome.caught_by.rpartition('/')[2] or '[bold]survived[/bold]'
        table.add_row(mutation.name.rpartition('/')[2], by, f'{outcome.seconds:.0f}')
    console.print(table)
    caught = sum(bool(outcome.caught_by) for outcome in outcomes)
    share = f'{caught / len(outcomes):.1%}'
    console.print(f'{caught} of {len(outcomes)} changes were caught: {share}', highlight=False)


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line, and run; returns the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument('what', metavar='FILE[::FUNCTION]', help='what is changed')
    parser.add_argument('tests', nargs='+', metavar='TEST', help='what should catch it')
    parser.add_argument('--most', type=int, default=50, metavar='N', help='changes; default: 50')
    parser.add_argument('--seed', type=int, default=1, metavar='N', help='that draws them')
    parser.add_argument('--jobs', type=int, default=1, metavar='N', help='changes at a time')
    options = parser.parse_args(arguments)
    file, _, function = options.what.partition('::')
    try:
        mutations = find(ROOT, file, function, options.tests)
        if len(mutations) > options.most:
            drawn = random.Random(options.seed).sample(mutations, options.most)  # noqa: S311  no secret
            mutations = sorted(drawn)
        outcomes = judge_all(mutations, options.jobs)
    except FilterError as err:
        sys.stderr.write(f'{err}\n')
        return 2
    show(mutations, outcomes)
    return 0 if all(outcome.caught_by for outcome in outcomes) else 1


if __name__ == '__main__':
    sys.exit(main())
