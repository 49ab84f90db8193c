# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels on disk are those of the present sources."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core.caching import IndexDataCacheFile

from lidar_outlier_filter.core.kernels import kernel_cache

PACKAGE = Path(kernel_cache.__file__).parents[1]
no_caches = shutil.ignore_patterns('__pycache__')

KERNEL = """
from lidar_outlier_filter.core.kernels.kernels import kernel
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
    env['PYTHONDONTWRITEBYTECODE'] = '1'  # sources change within a second, and keep their length
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


# Two copies of the package: what was compiled in one is used in the other, which cannot be written.
TWICE = """
from lidar_outlier_filter.core.kernels import kernel_cache
from toy.caller import answer
print(answer(1), sum(answer.stats.cache_hits.values()), len(kernel_cache.complaints))
"""


def run_elsewhere(toy: Path, **env: str) -> list[int]:
    """Start Python anew in a changed environment; return answer, hits and complaints."""
    paths = [str(toy), *filter(None, [os.environ.get('PYTHONPATH')])]
    env = {**os.environ, 'PYTHONPATH': os.pathsep.join(paths), **env}
    done = subprocess.run(
        [sys.executable, '-P', '-c', TWICE], env=env, check=False, capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, '')
    return [int(word) for word in done.stdout.split()]


def test_times_of_files_do_not_matter(toy: Path) -> None:
    """An image, or an installation, may set others."""
    assert run(toy) == [22, 0]
    for path in toy.rglob('*.py'):
        os.utime(path, (1, 1))
    assert run(toy) == [22, 1]


def test_what_came_with_the_installation_is_read(toy: Path, tmp_path: Path) -> None:
    """Where new kernels go to another folder."""
    assert run(toy) == [22, 0]
    assert run_elsewhere(toy, NUMBA_CACHE_DIR=str(tmp_path / 'other')) == [22, 1, 0]


def test_kernels_that_check_bounds_are_others(toy: Path, tmp_path: Path) -> None:
    """They are not those that came with the installation, though numba's key is the same."""
    assert run(toy) == [22, 0]
    folder = str(tmp_path / 'checked')
    assert run_elsewhere(toy, NUMBA_CACHE_DIR=folder, NUMBA_BOUNDSCHECK='1') == [22, 0, 0]
    assert run(toy) == [22, 1]


def test_no_folder_can_be_written(toy: Path, tmp_path: Path) -> None:
    """It works all the same, says so in one sentence, and leaves nothing behind."""
    temporary = tmp_path / 'temporary'
    temporary.mkdir()
    for folder in (toy / 'toy', toy / 'toy' / 'room'):
        # A file in the place of the folder: root may write to every folder.
        (folder / '__pycache__').write_text('')
    copy = shutil.copytree(PACKAGE, toy / PACKAGE.name, ignore=no_caches)
    for folder in [copy, *(path for path in copy.rglob('*') if path.is_dir())]:
        (folder / '__pycache__').write_text('')
    nowhere = {'HOME': '/dev/null', 'XDG_CACHE_HOME': '/dev/null', 'TMPDIR': str(temporary)}
    assert run_elsewhere(toy, **nowhere) == [22, 0, 1]
    assert not list(temporary.iterdir())


def test_a_kernel_that_cannot_be_saved_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    """A full disk is one sentence."""
    usual = IndexDataCacheFile('/dev/null', 'room.kernel-1.py311', None)  # type: ignore[no-untyped-call]
    file = kernel_cache.CacheFile(usual, __file__, 'lidar_outlier_filter.core.kernels.kernels')
    monkeypatch.setattr(kernel_cache, 'complaints', [])
    for _ in range(2):
        file.save('key', 'data')
    assert kernel_cache.complaints == [
        'what is compiled is not kept, as /dev/null: Not a directory'
    ]
