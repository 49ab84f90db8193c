# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels on disk: valid for exactly the sources that they were made from.

numba checks the kernel's own file only. A kernel that calls one of another file would keep the
old machine code after a change there. So kernels carry a hash of all files that they may be made
from: those of their own folder, and of the folders of ``core`` that every detector uses. Those
that check the bounds of arrays (``NUMBA_BOUNDSCHECK=1``) have another hash. Kernels of another hash
or numba are not read, and removed when the kernel is compiled anew.

They lie beside the sources where that can be written, and are read there where it cannot. New ones
then go to the user's own cache, or to a folder that is removed at the end. Portable ones came with
the package, in folders ``portable``: they run where none was compiled for the host. What is
compiled from them is kept by itself, so that nobody takes it for code of the host alone.
"""

import atexit
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import IndexDataCacheFile
from numba.core.compiler_lock import global_compiler_lock
from numba.core.event import Event, Listener, register

from lidar_outlier_filter.core.kernels import PORTABLE, listeners

DIGITS = 16  # of the hash, hexadecimal, in the name of a file
CORE = Path(__file__).parents[1]
# The folders whose kernels and constants those of all others may use.
SHARED = ('.', 'detectors', 'kernels', 'neighbours', 'points', 'scan_pattern')

# What a processor of the portable level has, in numba's words.
NEEDED = {'+avx2', '+bmi', '+bmi2', '+f16c', '+fma', '+lzcnt', '+movbe', '+xsave'}
if PORTABLE == 'generic':
    NEEDED = set()

complaints: list[str] = []  # why kernels are not read, or not kept: a sentence for each reason
portable: set[Any] = set()  # the kernels of this process that run portable code
_replaced: list[Any] = []  # code that another thread may still be running


class _Compilations(Listener):
    """Calls the listeners before numba compiles a kernel."""

    def on_start(self, event: Event) -> None:
        module = event.data['dispatcher'].py_func.__module__
        for listener in tuple(listeners):
            listener(module)

    def on_end(self, _event: Event) -> None:
        """Do nothing."""


register('numba:compile', _Compilations())  # type: ignore[no-untyped-call]


class _Files(IndexDataCacheFile):
    """The files of one kernel in a folder: an index, and machine code for each of its signatures.

    Each ends with a digest of its content: what is damaged is not read.
    """

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[BytesIO]:
        content = BytesIO()
        with super()._open_for_write(filepath) as file:
            yield content
            file.write(content.getvalue() + sha256(content.getvalue()).digest())

    def _load_index(self) -> Any:
        return super()._load_index() if _is_whole(self._index_path) else {}  # type: ignore[no-untyped-call]

    def _load_data(self, name: str) -> Any:
        if not _is_whole(self._data_path(name)):  # type: ignore[no-untyped-call]
            raise OSError
        return super()._load_data(name)  # type: ignore[no-untyped-call]


class CacheFile(_Files):
    """The files of one kernel, wherever they are."""

    allows_portable = True  # in this process

    def __init__(self, usual: IndexDataCacheFile, source: str, kernel: object) -> None:
        """Lie where numba would put the files of a kernel of the file ``source``."""
        index, room = Path(usual._index_path), Path(source).parent  # noqa: SLF001  it has no other name
        # In the name, not in the index: an index of other sources may name classes that are gone.
        mine = stamp(room)[:DIGITS]
        # Without the number of its line: a kernel that moves replaces its files.
        name = re.sub(r'-\d+(?=\.py\d+$)', '', index.stem)
        self._brought = room / 'portable'
        folder = index.parent
        if numba.config.CPU_NAME == PORTABLE:  # type: ignore[attr-defined]
            folder = self._brought
            folder.mkdir(exist_ok=True)
        super().__init__(str(folder), f'{name}.{mine}', mine)  # type: ignore[no-untyped-call]
        self._kernel, self._name, self._mine = kernel, f'{name}.', f'{name}.{mine}.'
        self._installed, self._portable = (
            _Files(str(one), f'{name}.{mine}', mine)  # type: ignore[no-untyped-call]
            for one in (room / '__pycache__', self._brought)
        )

    def load(self, key: Any) -> Any:
        """Read machine code, or that of the installation; None if neither exists."""
        found = super().load(key)  # type: ignore[no-untyped-call]
        if found is None:
            found = self._installed.load(key)  # type: ignore[no-untyped-call]
        if found is None and self.allows_portable:
            found = self._load_portable(*key)
            if found is None:
                found = super().load(_beside_portable(*key))  # type: ignore[no-untyped-call]
            if found is not None:
                portable.add(self._kernel)
        return found

    def _load_portable(self, signature: object, machine: tuple[str, str, str], code: object) -> Any:
        """Read what came with the package, where it is of these sources and for this processor."""
        triple, _, features = machine
        if not any(self._brought.glob(f'{self._name.partition(".py")[0]}.*')):
            return None
        if not set(features.split(',')) >= NEEDED:
            _complain(f'this processor is not {PORTABLE}: the kernels of the package are not used')
            return None
        if not (self._brought / self._index_name).exists():
            _complain('the kernels of the package are of other versions, and are not used')
        return self._portable.load((signature, (triple, PORTABLE, ''), code))  # type: ignore[no-untyped-call]

    def save(self, key: Any, data: Any) -> None:
        """Write machine code, and remove what was made from other sources."""
        if portable:
            portable.add(self._kernel)
            key = _beside_portable(*key)
        try:
            super().save(key, data)  # type: ignore[no-untyped-call]
        except OSError as err:
            _complain(f'compiled kernels are not kept: {self._cache_path}: {err.strerror}')
            return
        for path in Path(self._cache_path).glob(f'{self._name}*.nb[ic]'):
            if not path.name.startswith(self._mine):
                path.unlink(missing_ok=True)


def _beside_portable(signature: object, machine: tuple[str, str, str], code: object) -> Any:
    """Return the key of what a process compiles that runs portable code: it may contain that."""
    triple, name, features = machine
    return signature, (triple, name, f'{features},portable'), code


def _is_whole(path: str) -> bool:
    """Return whether a file is there, and ends with the digest of its content."""
    try:
        content = Path(path).read_bytes()
    except OSError:  # not a folder
        return False
    size = sha256().digest_size
    is_whole = sha256(content[:-size]).digest() == content[-size:]
    if not is_whole:
        _complain(f'{path} is damaged, and not read')
    return is_whole


def read_host() -> Callable[[], None]:
    """Read code of the host for the kernels that run portable code; return what replaces that.

    A kernel may be running meanwhile: the old code is kept. One that the host has not stays.
    """
    with global_compiler_lock:
        CacheFile.allows_portable = False
        found = {
            kernel: [
                kernel._cache.load_overload(types, kernel.targetctx)  # noqa: SLF001  as in kernels.py
                for types in kernel.overloads
            ]
            for kernel in portable
        }
        CacheFile.allows_portable = True

    def replace() -> None:
        with global_compiler_lock:
            for kernel, results in found.items():
                if None in results or kernel not in portable:
                    continue
                portable.remove(kernel)
                _replaced.append(dict(kernel.overloads))
                kernel._reset_overloads()  # noqa: SLF001
                for one in results:
                    kernel.targetctx.insert_user_function(
                        one.entry_point, one.fndesc, [one.library]
                    )
                    kernel.add_overload(one)

    return replace


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
    checks = numba.config.BOUNDSCHECK  # type: ignore[attr-defined]
    total = sha256(f'{numba.__version__} {checks}'.encode())
    for room in (*(CORE / name for name in SHARED), folder):
        for path in sorted(room.glob('*.py')):
            total.update(path.name.encode() + sha256(path.read_bytes()).digest())
    return total.hexdigest()
