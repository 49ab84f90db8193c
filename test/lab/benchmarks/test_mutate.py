# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The script makes the changes that it says, and says truly which of them are caught."""

from __future__ import annotations

from importlib.util import module_from_spec, spec_from_file_location
from typing import TYPE_CHECKING

import pytest
from helpers import ROOT

from lidar_outlier_filter.errors import FilterError

if TYPE_CHECKING:
    from pathlib import Path
    from types import ModuleType

CODE = 'def is_small(x):\n    return x < 10\n\n\ndef is_large(x):\n    return x > 99\n'
TESTS = """
from toy import is_large, is_small


def test_small():
    assert is_small(9)
    assert not is_small(10)


def test_large():
    assert is_large(100)
"""


@pytest.fixture(scope='module')
def mutate() -> ModuleType:
    """Load the script."""
    spec = spec_from_file_location('mutate', ROOT / 'benchmarks' / 'mutate.py')
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def toy(tmp_path: Path) -> Path:
    """Make a project of two functions, of which the tests know one well."""
    root = tmp_path / 'project'
    root.mkdir()
    (root / 'toy.py').write_text(CODE)
    (root / 'test_toy.py').write_text(TESTS)
    return root


def test_a_toy(mutate: ModuleType, toy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Changes of one function are caught, one of the other survives; the toy stays as it is."""
    small = mutate.find(toy, 'toy.py', 'is_small', ['test_toy.py'])
    large = mutate.find(toy, 'toy.py', 'is_large', ['test_toy.py::test_large'])
    assert [(one.line, one.old, one.new) for one in (*small, *large)] == [
        (2, 'x < 10', '(x <= 10)'),
        (2, '10', '11'),
        (6, 'x > 99', '(x >= 99)'),
        (6, '99', '100'),
    ]
    outcomes = mutate.judge_all([*small, *large], 2, toy)
    by = [outcome.caught_by for outcome in outcomes]
    assert by == ['test_toy.py::test_small'] * 2 + ['', 'test_toy.py::test_large']
    mutate.show([*small, *large], outcomes)
    said = capsys.readouterr().out
    assert said.count('SURVIVED') == 1
    assert '3 of 4 changes were caught: 75.0%' in said
    assert (toy / 'toy.py').read_text() == CODE
    assert sorted(path.name for path in toy.parent.iterdir()) == ['project']


def test_a_crash(mutate: ModuleType, toy: Path) -> None:
    """A change that ends Python is caught."""
    (one, *_) = mutate.find(toy, 'toy.py', 'is_small', ['test_toy.py'])
    (outcome,) = mutate.judge_all([one._replace(new='__import__("os").abort()')], 1, toy)
    assert outcome.caught_by == 'a crash, or no end'


@pytest.mark.parametrize(
    ('code', 'changed'),
    [
        ('a + b * 2', ['(a - b * 2)', '(b / 2)', '3']),
        ('a and not b', ['(a or not b)', '(b)']),
        ('n += 1', ['pass', '2']),
        ('f(True)', ['pass', 'False']),
        ('x: Literal[1] = 2', ['3']),
        ("f'{a + 1}'", []),
        ('if TYPE_CHECKING:\n    a = 1', []),
    ],
)
def test_changes(mutate: ModuleType, toy: Path, code: str, changed: list[str]) -> None:
    """Signs, conditions, numbers and statements; neither types nor texts."""
    (toy / 'toy.py').write_text(f'é = None\n{code}\n1\n')
    found = mutate.find(toy, 'toy.py', '', [])
    assert [one.new for one in found] == [*changed, '2']
    for one in found:
        mutate.apply(one, toy)
        text = (toy / 'toy.py').read_text()
        compile(text, 'toy.py', 'exec')
        (toy / 'toy.py').write_text(f'é = None\n{code}\n1\n')


@pytest.mark.parametrize(
    ('file', 'function', 'sentence'),
    [
        ('other.py', '', r'^the file to change must be there, got other.py$'),
        ('toy.py', 'is_none', r'^the function in toy.py must be there once, got is_none$'),
        ('test_toy.py', 'test_none', r'^the function in test_toy.py must be there once'),
    ],
)
def test_nothing_to_change(
    mutate: ModuleType, toy: Path, file: str, function: str, sentence: str
) -> None:
    """It is refused before anything is run."""
    with pytest.raises(FilterError, match=sentence):
        mutate.find(toy, file, function, ['test_toy.py'])


@pytest.mark.parametrize('line', ['assert False', 'pytest.skip("too busy")'])
def test_tests_that_could_catch_nothing(mutate: ModuleType, toy: Path, line: str) -> None:
    """Tests that fail or are skipped where nothing is changed are refused."""
    (toy / 'test_toy.py').write_text(f'import pytest\n\ndef test_small():\n    {line}\n')
    found = mutate.find(toy, 'toy.py', '', ['test_toy.py'])
    with pytest.raises(FilterError, match='must be passed where nothing is changed'):
        mutate.judge_all(found, 1, toy)
