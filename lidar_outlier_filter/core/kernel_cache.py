# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The sources that a compiled kernel on disk was made from.

numba looks at the kernel's own file only. A kernel that calls one of another file would keep the
old machine code after a change there. So the stamp of a kernel covers all files of its package that
its own file imports, directly or by others.
"""

from __future__ import annotations

import re
import sys
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

# At the start of a line: what is imported for types, or late, is no part of a kernel.
_IMPORT = re.compile(
    r'^(?:from\s+([\w.]+)\s+import\s+(\([^)]*\)|[^\n]*)|import\s+([^\n]*))', re.MULTILINE
)


def stamp(module: str) -> bytes:
    """Hash the file of a module and all files of its package that it imports, however far.

    Parameters
    ----------
    module : its full name; it must be imported, or about to be.

    """
    total = sha256()
    for path in sorted(_reachable(module)):
        total.update(str(path.name).encode() + _content(path))
    return total.digest()


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
