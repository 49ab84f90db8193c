# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels on disk are those of the present sources."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core.caching import IndexDataCacheFile

from lidar_outlier_filter.core.kernels import PORTABLE, kernel_cache

PRODUCT = kernel_cache.CORE.parent

KERNEL = """
from lidar_outlier_filter.core.kernels.kernels import kernel
{imports}

@kernel
def {name}(x):
    return {value}
"""
# The caller is two files away from the number.
FILES = {
    'toy/__init__.py': '',
    'toy/number.py': 'NUMBER = 10\n',
    'toy/callee.py': KERNEL.format(
        imports='from toy.number import NUMBER', name='add', value='x + NUMBER'
    ),
    'toy/caller.py': KERNEL.format(
        imports='from toy.callee import add', name='double', value='2 * add(x)'
    ),
}
CODE = """
import os
from lidar_outlier_filter.core.kernels.kernel_cache import CacheFile, complaints
CacheFile.allows_portable = 'HOST_ONLY' not in os.environ
from toy.caller import double
print(double(1), sum(double.stats.cache_hits.values()), len(complaints))
"""


@pytest.fixture
def toy(tmp_path: Path) -> Path:
    """Make a package of kernels that call each other across files."""
    (tmp_path / 'toy').mkdir()
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def run(toy: Path, **variables: str) -> list[int]:
    """Start Python anew; return the result, how often it was found on disk, and complaints."""
    paths = [str(toy), *filter(None, [os.environ.get('PYTHONPATH')])]
    env = {**os.environ, 'PYTHONPATH': os.pathsep.join(paths), **variables}
    env['PYTHONDONTWRITEBYTECODE'] = '1'  # sources change within a second, and keep their length
    command = [sys.executable, '-P', '-c', CODE]
    done = subprocess.run(command, env=env, check=False, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, '')
    return [int(word) for word in done.stdout.split()]


def test_only_present_sources_count(toy: Path) -> None:
    """A constant, two files away, changes the result; the times of files do not."""
    assert run(toy) == [22, 0, 0]
    for path in toy.rglob('*.py'):
        os.utime(path, (1, 1))
    assert run(toy) == [22, 1, 0]
    files = {path.name for path in toy.rglob('caller.double.*.nb[ic]')}
    (toy / 'toy' / 'number.py').write_text('NUMBER = 20\n')
    assert run(toy) == [42, 0, 0]
    # Those of the old sources are gone.
    found = {path.name for path in toy.rglob('caller.double.*.nb[ic]')}
    assert len(files) == len(found) == 2
    assert not files & found


@pytest.mark.parametrize('package', [PRODUCT, PRODUCT.parent / 'lidar_outlier_lab'])
def test_kernels_use_no_other_sources(package: Path) -> None:
    """A hash covers what a kernel calls, and the constants that it reads, of other files."""
    shared = {(kernel_cache.CORE / name).resolve() for name in kernel_cache.SHARED}
    kernels, outside = 0, []
    for source in package.rglob('*.py'):
        tree = ast.parse(source.read_text())
        imports = {
            name.asname or name.name: package.parent.joinpath(*str(node.module).split('.'))
            for node in tree.body
            if isinstance(node, ast.ImportFrom)
            for name in node.names
        }
        for function in tree.body:
            if not isinstance(function, ast.FunctionDef) or not any(
                isinstance(one, ast.Name) and one.id.endswith('kernel')
                for one in function.decorator_list
            ):
                continue
            kernels += 1
            for part in function.body:
                names = {one.id for one in ast.walk(part) if isinstance(one, ast.Name)}
                origins = {imports[name] for name in names & imports.keys()}
                mine = {origin for origin in origins if origin.with_suffix('.py').is_file()}
                outside += [one for one in mine if one.parent not in {*shared, source.parent}]
    assert kernels > 0
    assert not outside


def test_what_came_with_the_installation_is_read(toy: Path, tmp_path: Path) -> None:
    """Where new kernels go to another folder; but not those that check no bounds, by who does."""
    assert run(toy) == [22, 0, 0]
    assert run(toy, NUMBA_CACHE_DIR=str(tmp_path / 'other')) == [22, 1, 0]
    checked = str(tmp_path / 'checked')
    assert run(toy, NUMBA_CACHE_DIR=checked, NUMBA_BOUNDSCHECK='1') == [22, 0, 0]
    assert run(toy) == [22, 1, 0]


def test_no_folder_can_be_written(toy: Path, tmp_path: Path) -> None:
    """It works all the same, says so in one sentence, and leaves nothing behind."""
    temporary = tmp_path / 'temporary'
    temporary.mkdir()
    (toy / 'toy' / '__pycache__').write_text('')  # not a folder: root may write to each
    nowhere = {'HOME': '/dev/null', 'XDG_CACHE_HOME': '/dev/null', 'TMPDIR': str(temporary)}
    assert run(toy, **nowhere) == [22, 0, 1]
    assert not list(temporary.iterdir())


def test_a_kernel_that_cannot_be_saved_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    """A full disk is one sentence."""
    usual = IndexDataCacheFile('/dev/null', 'room.kernel-1.py311', None)  # type: ignore[no-untyped-call]
    file = kernel_cache.CacheFile(usual, __file__, None)
    monkeypatch.setattr(kernel_cache, 'complaints', [])
    for _ in range(2):
        file.save('key', 'data')
    assert kernel_cache.complaints == ['compiled kernels are not kept: /dev/null: Not a directory']


@pytest.fixture
def brought(toy: Path) -> Path:
    """Compile the toy package for all processors of a level; nothing is kept for this one."""
    assert run(toy, NUMBA_CPU_NAME=PORTABLE, NUMBA_CPU_FEATURES='') == [22, 0, 0]
    assert {path.parent.name for path in toy.rglob('*.nb[ic]')} == {'portable'}
    return toy


def test_portable_kernels_run_where_there_are_none_for_the_host(brought: Path) -> None:
    """They are never taken for those of the host, nor is what was compiled beside them."""
    assert run(brought) == [22, 1, 0]
    assert {path.parent.name for path in brought.rglob('*.nb[ic]')} == {'portable'}
    for path in brought.rglob('portable/caller.*'):
        path.unlink()
    assert run(brought) == [22, 0, 0]  # this one contains the portable callee
    assert run(brought) == [22, 1, 0]
    assert run(brought, HOST_ONLY='1') == [22, 0, 0]
    assert run(brought, HOST_ONLY='1') == [22, 1, 0]


def test_portable_kernels_that_are_not_run(brought: Path) -> None:
    """Of a processor that lacks something, of other sources, or damaged: a sentence each."""
    if kernel_cache.NEEDED:
        assert run(brought, NUMBA_CPU_FEATURES='+avx2') == [22, 0, 1]
    for suffix in ('nbi', '1.nbc'):
        (file,) = brought.rglob(f'portable/caller.double.*.{suffix}')
        content = file.read_bytes()
        file.write_bytes(content[:-50] + bytes([content[-50] ^ 1]) + content[-49:])
        assert run(brought, NUMBA_CACHE_DIR=str(brought / suffix)) == [22, 0, 1]
        file.write_bytes(content)
    assert run(brought) == [22, 1, 0]
    (brought / 'toy' / 'number.py').write_text('NUMBER = 20\n')
    assert run(brought) == [42, 0, 1]
