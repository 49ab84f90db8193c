# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The list of changes fits the code, and the script says truly which of them are caught."""

from __future__ import annotations

import ast
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lidar_outlier_filter.errors import FilterError

if TYPE_CHECKING:
    from types import ModuleType

ROOT = Path(__file__).resolve().parents[3]
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


def change(mutate: ModuleType, old: str, new: str, *tests: str) -> Any:
    """Make a change of the toy."""
    return mutate.Mutation('toy.py', old, new, 'a reason', tests or ('test_toy.py',))


def test_every_change_fits_the_code(mutate: ModuleType) -> None:
    """Its old text is there exactly once, its tests are there, and what it makes is Python."""
    mutations = mutate.read(mutate.LIST)
    assert len({mutation.name for mutation in mutations}) == len(mutations) >= 84
    mutate.check(mutations, ROOT)
    for mutation in mutations:
        assert mutation.tests
        ast.parse(mutate.changed(mutation, ROOT))


def test_a_toy(mutate: ModuleType, toy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One change is caught, one survives, one ends Python; the toy itself stays as it is."""
    mutations = [
        change(mutate, 'x < 10', 'x > 10'),
        change(mutate, 'x > 99', 'x > 98', 'test_toy.py::test_large'),
        change(mutate, 'return x < 10', 'import os; os.abort()'),
    ]
    outcomes = mutate.judge_all(mutations, 2, toy)
    by = [outcome.caught_by for outcome in outcomes]
    assert by == ['test_toy.py::test_small', '', 'a crash, or no end']
    mutate.show(mutations, outcomes)
    said = capsys.readouterr().out
    assert said.count('SURVIVED') == 1
    assert '2 of 3 changes were caught: 66.7%' in said
    assert (toy / 'toy.py').read_text() == CODE
    assert sorted(path.name for path in toy.parent.iterdir()) == ['project']


@pytest.mark.parametrize(
    ('given', 'sentence'),
    [
        (('toy.py', 'x < 11', ''), r'^the old text of toy.py: a reason must be .*, got 0$'),
        (('toy.py', 'return x', ''), r'must be there exactly once, got 2$'),
        (('other.py', 'x < 10', ''), r'^the file to change must be there, got other.py$'),
        (('toy.py', 'x < 10', 'no.py'), r'^the test file of .* must be there, got no.py$'),
        (('toy.py', 'x < 10', 'test_toy.py::no'), r'must be in test_toy.py, got no$'),
    ],
)
def test_a_change_that_does_not_fit(
    mutate: ModuleType, toy: Path, given: tuple[str, str, str], sentence: str
) -> None:
    """It is refused before anything is run."""
    file, old, test = given
    with pytest.raises(FilterError, match=sentence):
        mutate.check([mutate.Mutation(file, old, 'x', 'a reason', (test or 'test_toy.py',))], toy)


@pytest.mark.parametrize('line', ['assert False', 'pytest.skip("too busy")'])
def test_tests_that_could_catch_nothing(mutate: ModuleType, toy: Path, line: str) -> None:
    """Tests that fail or are skipped where nothing is changed are refused."""
    (toy / 'test_toy.py').write_text(f'import pytest\n\ndef test_small():\n    {line}\n')
    with pytest.raises(FilterError, match='must be passed where nothing is changed'):
        mutate.judge_all([change(mutate, 'x < 10', 'x > 10')], 1, toy)


def test_a_change_that_cannot_be_imported(mutate: ModuleType, toy: Path) -> None:
    """It says nothing about the tests, and is refused."""
    with pytest.raises(FilterError, match=r'^the tests of toy\.py: a reason must be run'):
        mutate.judge_all([change(mutate, 'x < 10', 'x <')], 1, toy)


def test_the_list_is_printed(mutate: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    """Of all changes those whose file or reason a pattern is found in."""
    assert mutate.main(['--list', '--only', r'blocks\.py: exactly']) == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert line.endswith('core/judging/blocks.py: exactly max_points may be held')
    assert mutate.main(['--list', '--only', 'no such reason']) == 2
    assert capsys.readouterr().err.startswith('--only must be found in the file or the reason')
