# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels on disk are those of the present sources."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from pathlib import Path

KERNEL = """
from lidar_outlier_filter.core.kernels import kernel
{imports}

@kernel
def {name}(x):
    return {value}
"""
# The caller is three files away from the number, and each file names the next in another way.
FILES = {
    'number.py': 'NUMBER = {number}\n',
    'callee.py': KERNEL.format(
        imports='from toy import (\n    number,\n)\nNUMBER = number.NUMBER',
        name='add',
        value='x + NUMBER',
    ),
    'room/__init__.py': '',
    'room/middle.py': KERNEL.format(
        imports='import toy.callee\nadd = toy.callee.add', name='twice', value='2 * add(x)'
    ),
    'caller.py': KERNEL.format(
        imports='from toy.room.middle import twice', name='answer', value='twice(x)'
    ),
    '__init__.py': '',
}
CODE = """
from toy.caller import answer
print(answer(1), sum(answer.stats.cache_hits.values()))
"""


@pytest.fixture
def toy(tmp_path: Path) -> Path:
    """Make a package of kernels that call each other across files."""
    for name, text in FILES.items():
        path = tmp_path / 'toy' / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text.replace('{number}', '10'))
    return tmp_path


def run(toy: Path) -> list[int]:
    """Start Python anew; return the answer and how often it was found on disk."""
    paths = [str(toy), *filter(None, [os.environ.get('PYTHONPATH')])]
    env = {**os.environ, 'PYTHONPATH': os.pathsep.join(paths)}
    done = subprocess.run(
        [sys.executable, '-c', CODE], env=env, check=True, capture_output=True, text=True
    )
    return [int(word) for word in done.stdout.split()]


def test_only_what_a_kernel_can_reach_makes_it_old(toy: Path) -> None:
    """A constant, three files away, changes the answer; a file that is not imported does not."""
    assert run(toy) == [22, 0]
    (toy / 'toy' / 'other.py').write_text('NUMBER = 20\n')
    assert run(toy) == [22, 1]
    files = {path.name for path in toy.rglob('caller.answer-*.nb[ic]')}
    (toy / 'toy' / 'number.py').write_text('NUMBER = 20\n')
    assert run(toy) == [42, 0]
    # Those of the old sources are gone.
    assert len(files) == len(list(toy.rglob('caller.answer-*.nb[ic]'))) == 2
    assert not files & {path.name for path in toy.rglob('caller.answer-*.nb[ic]')}
