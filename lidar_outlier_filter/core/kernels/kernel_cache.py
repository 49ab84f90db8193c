# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels on disk: valid for exactly the sources that they were made from.

numba looks at the kernel's own file only. A kernel that calls one of another file would keep the
old machine code after a change there. So the files of a kernel carry, in their names, a hash of all
files of the package that the kernel's own file imports, directly or by others. Files of another
hash are never read, because they may name classes that are gone. They are removed when the kernel
is compiled anew. Kernels that check the bounds of arrays (``NUMBA_BOUNDSCHECK=1``) have another
hash.

They lie beside the sources where that can be written, and are read there where it cannot. New ones
then go to the user's own cache, or to a folder that is removed at the end.
"""

from __future__ import annotations

import atexit
import os
import re
import shutil
import sys
import tempfile
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numba
from numba.core.caching import IndexDataCacheFile
from numba.core.event import Event, Listener, register

from lidar_outlier_filter.core.kernels.compile_listeners import listeners

if TYPE_CHECKING:
    from collections.abc import Iterator

# At the start of a line: what is imported for types, or late, is no part of a kernel.
_IMPORT = re.compile(
    r'^(?:from\s+([\w.]+)\s+import\s+(\([^)]*\)|[^\n]*)|import\s+([^\n]*))', re.MULTILINE
)
_PACKAGE = 'lidar_outlier_filter'
_DIGITS = 16  # of the hash, hexadecimal, in the name of a file


complaints: list[str] = []  # why what is compiled is not kept, one sentence for each reason


class _Compilations(Listener):
    """Calls the listeners before numba compiles a kernel."""

    def on_start(self, event: Event) -> None:
        module = event.data['dispatcher'].py_func.__module__
        for listener in tuple(listeners):
            listener(module)

    def on_end(self, _event: Event) -> None:
        """Do nothing."""


register('numba:compile', _Compilations())  # type: ignore[no-untyped-call]


class CacheFile(IndexDataCacheFile):
    """The files of one kernel on disk: an index, and machine code for each of its signatures."""

    def __init__(self, usual: IndexDataCacheFile, source: str, module: str) -> None:
        """Lie where numba would put the files of a kernel of ``module``, the file ``source``."""
        index: Path = Path(usual._index_path)  # noqa: SLF001  numba has no other name for it
        # Not numba's stamp, the time of the file: an image or an installation may set another.
        mine = stamp(module)[:_DIGITS]
        base = f'{index.stem}.{mine}'
        super().__init__(str(index.parent), base, mine)  # type: ignore[no-untyped-call]
        name, _, python = index.stem.rpartition('.')
        self._all = f'{name.rpartition("-")[0]}-*.{python}.*.nb[ic]'  # of whatever line and hash
        self._mine = f'.{mine}.'
        beside = Path(source).parent / '__pycache__'
        self._installed = None  # what the installation has brought, where that is read-only
        if beside != index.parent:
            self._installed = IndexDataCacheFile(str(beside), base, mine)  # type: ignore[no-untyped-call]

    def load(self, key: Any) -> Any:
        """Read machine code, or what came with the installation; None where there is none."""
        try:
            found = super().load(key)  # type: ignore[no-untyped-call]
            if found is None and self._installed is not None:
                found = self._installed.load(key)  # type: ignore[no-untyped-call]
        except OSError:  # as a folder that is none; a file that is missing is None anyway
            return None
        return found

    def save(self, key: Any, data: Any) -> None:
        """Write machine code, and remove what was made from other sources."""
        try:
            super().save(key, data)  # type: ignore[no-untyped-call]
        except OSError as err:
            _complain(f'what is compiled is not kept, as {self._cache_path}: {err.strerror}')
            return
        for path in Path(self._cache_path).glob(self._all):
            if self._mine not in path.name:
                path.unlink(missing_ok=True)


def use_temporary_folder() -> None:
    """Keep what is compiled for this process and those that it starts: no other folder is found."""
    folder = tempfile.mkdtemp(prefix='lidar_outlier_filter-')
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    numba.config.CACHE_DIR = folder  # type: ignore[attr-defined]
    os.environ['NUMBA_CACHE_DIR'] = folder  # of the processes that this one starts
    _complain(
        'what is compiled is kept until the end of this process only: no folder for it can be '
        'written; name one in NUMBA_CACHE_DIR'
    )


def _complain(sentence: str) -> None:
    if sentence not in complaints:
        complaints.append(sentence)


@cache
def stamp(module: str) -> str:
    """Hash the file of a module, and all files of its package and of this one that it imports.

    Parameters
    ----------
    module : its full name; it must be imported, or about to be. Of a package: all its modules

    """
    total = sha256(b'bounds' if numba.config.BOUNDSCHECK else b'')  # type: ignore[attr-defined]
    own = Path(str(sys.modules[_PACKAGE].__file__)).parent
    # In an order that does not depend on where packages lie.
    for path in sorted(_reachable(module), key=lambda path: (own not in path.parents, path)):
        total.update(path.name.encode() + _content(path))
    return total.hexdigest()


def _reachable(module: str) -> set[Path]:
    first = _file_of(module)
    tops = {module.partition('.')[0], _PACKAGE}
    found: set[Path] = set()
    pending = {first}
    if first is not None and first.name == '__init__.py':
        pending |= {*first.parent.rglob('*.py')}
    while pending:
        path = pending.pop()
        if path is not None and path not in found:
            found.add(path)
            names = (name for name in _imports(path) if name.partition('.')[0] in tops)
            pending |= {_file_of(name) for name in names}
    return found


def _file_of(module: str) -> Path | None:
    """Find the file of a module of an imported package; None where the name is not of a module."""
    top, *rest = module.split('.')
    file = Path(str(sys.modules[top].__file__))
    if file.name != '__init__.py':  # a module that is no package
        return None if rest else file
    stem = file.parent.joinpath(*rest)
    candidates = (stem.with_suffix('.py'), stem / '__init__.py')
    return next((path for path in candidates if path.is_file()), None)


@cache
def _content(path: Path) -> bytes:
    return sha256(path.read_bytes()).digest()


@cache
def _imports(path: Path) -> frozenset[str]:
    """Name what a file imports: modules, and what may be modules."""
    return frozenset(_names(path.read_text('utf-8')))


def _names(text: str) -> Iterator[str]:
    for origin, names, modules in _IMPORT.findall(text):
        if origin:
            yield origin
            yield from (f'{origin}.{name}' for name in re.findall(r'\w+', names))
        else:
            yield from re.findall(r'[\w.]+', modules)
