# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels on disk: valid for exactly the sources that they were made from.

numba looks at the kernel's own file only. A kernel that calls one of another file would keep the
old machine code after a change there. So the files of a kernel carry, in their names, a hash of all
files of the package that the kernel's own file imports, directly or by others. Files of another
hash are never read, because they may name classes that are gone. They are removed when the kernel
is compiled anew.
"""

from __future__ import annotations

import re
import sys
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numba.core.caching import IndexDataCacheFile

if TYPE_CHECKING:
    from collections.abc import Iterator

# At the start of a line: what is imported for types, or late, is no part of a kernel.
_IMPORT = re.compile(
    r'^(?:from\s+([\w.]+)\s+import\s+(\([^)]*\)|[^\n]*)|import\s+([^\n]*))', re.MULTILINE
)
_DIGITS = 16  # of the hash, hexadecimal, in the name of a file


class CacheFile(IndexDataCacheFile):
    """The files of one kernel on disk: an index, and machine code for each of its signatures."""

    def __init__(self, usual: IndexDataCacheFile, module: str) -> None:
        """Lie beside the files that numba would use for a kernel of ``module``."""
        index: Path = Path(usual._index_path)  # noqa: SLF001  numba has no other name for it
        source: bytes = usual._source_stamp  # noqa: SLF001
        base = f'{index.stem}.{stamp(module)[:_DIGITS]}'
        super().__init__(str(index.parent), base, source)  # type: ignore[no-untyped-call]
        name, _, python = index.stem.rpartition('.')
        self._all = f'{name.rpartition("-")[0]}-*.{python}.*.nb[ic]'  # of whatever line and hash
        self._mine = f'.{stamp(module)[:_DIGITS]}.'

    def save(self, key: Any, data: Any) -> None:
        """Write machine code, and remove what was made from other sources."""
        super().save(key, data)  # type: ignore[no-untyped-call]
        for path in Path(self._cache_path).glob(self._all):
            if self._mine not in path.name:
                path.unlink(missing_ok=True)


@cache
def stamp(module: str) -> str:
    """Hash the file of a module and all files of its package that it imports, however far.

    Parameters
    ----------
    module : its full name; it must be imported, or about to be.

    """
    total = sha256()
    for path in sorted(_reachable(module)):
        total.update(path.name.encode() + _content(path))
    return total.hexdigest()


def _reachable(module: str) -> set[Path]:
    top = module.partition('.')[0]
    root = Path(str(sys.modules[top].__file__)).parent
    found: set[Path] = set()
    pending = {_file_of(root, module)}
    while pending:
        path = pending.pop()
        if path is not None and path not in found:
            found.add(path)
            pending |= {_file_of(root, name) for name in _imports(path) if name.startswith(top)}
    return found


def _file_of(root: Path, module: str) -> Path | None:
    """Find the file of a module below ``root``; None where the name is not that of a module."""
    stem = root.joinpath(*module.split('.')[1:])
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
