# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels on disk: valid for exactly the sources that they were made from.

numba looks at the kernel's own file only. A kernel that calls one of another file would keep the
old machine code after a change there. So kernels carry a hash of all files that they may be made
from: those of their own folder, and those of the rooms of ``core`` that every detector uses. Those
that check the bounds of arrays (``NUMBA_BOUNDSCHECK=1``) have another hash. Kernels of another hash
are not read, and removed when the kernel is compiled anew.

They lie beside the sources where that can be written, and are read there where it cannot. New ones
then go to the user's own cache, or to a folder that is removed at the end.
"""

from __future__ import annotations

import atexit
import os
import re
import shutil
import tempfile
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import IndexDataCacheFile
from numba.core.event import Event, Listener, register

from lidar_outlier_filter.core.kernels import listeners

DIGITS = 16  # of the hash, hexadecimal, in the name of a file
CORE = Path(__file__).parents[1]
# The folders whose kernels and constants those of all others may use.
SHARED = ('.', 'detectors', 'kernels', 'neighbours', 'points', 'scan_pattern')

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

    def __init__(self, usual: IndexDataCacheFile, source: str) -> None:
        """Lie where numba would put the files of a kernel of the file ``source``."""
        index, room = Path(usual._index_path), Path(source).parent  # noqa: SLF001  it has no other name
        # In the name, not in the index: an index of other sources may name classes that are gone.
        mine = stamp(room)[:DIGITS]
        # Without the number of its line: a kernel that moves replaces its files.
        name = re.sub(r'-\d+(?=\.py\d+$)', '', index.stem)
        super().__init__(str(index.parent), f'{name}.{mine}', mine)  # type: ignore[no-untyped-call]
        self._name, self._mine = f'{name}.', f'{name}.{mine}.'
        self._installed = IndexDataCacheFile(  # type: ignore[no-untyped-call]
            str(room / '__pycache__'), f'{name}.{mine}', mine
        )

    def load(self, key: Any) -> Any:
        """Read machine code, or what came with the installation; None where there is none."""
        try:
            found = super().load(key)  # type: ignore[no-untyped-call]
            return self._installed.load(key) if found is None else found  # type: ignore[no-untyped-call]
        except OSError:  # as a folder that is none; a file that is missing is None anyway
            return None

    def save(self, key: Any, data: Any) -> None:
        """Write machine code, and remove what was made from other sources."""
        try:
            super().save(key, data)  # type: ignore[no-untyped-call]
        except OSError as err:
            _complain(f'what is compiled is not kept, as {self._cache_path}: {err.strerror}')
            return
        for path in Path(self._cache_path).glob(f'{self._name}*.nb[ic]'):
            if not path.name.startswith(self._mine):
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
def stamp(folder: Path) -> str:
    """Hash the sources that kernels of a folder may be made from."""
    total = sha256(b'bounds' if numba.config.BOUNDSCHECK else b'')  # type: ignore[attr-defined]
    for room in (*(CORE / name for name in SHARED), folder):
        for path in sorted(room.glob('*.py')):
            total.update(path.name.encode() + sha256(path.read_bytes()).digest())
    return total.hexdigest()
