# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The hidden folder in which an output is built, and those that runs left which were killed.

A run holds a lock on a file in its folder. The system lets go of it when the run ends, however it
does; so the next run for the same output knows which folders are nobody's, and removes them.
"""

from __future__ import annotations

import shutil
import sys
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from time import time
from typing import IO, TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

if sys.platform != 'win32':
    import fcntl

LOCK = '.lock-of-the-run'
YOUNG = 60.0  # seconds: a folder without a lock may get one


@contextmanager
def hidden_folder(path: Path, kind: str = 'partial') -> Iterator[Path]:
    """Give a hidden folder beside ``path``; remove it at the end, and at the start what was left.

    Raises
    ------
    OSError
        If it cannot be made.

    """
    for left in _folders(path, kind):
        _remove_if_left(left)
    prefix = f'.{path.name}.{kind}-'
    with (
        TemporaryDirectory(prefix=prefix, dir=path.parent, ignore_cleanup_errors=True) as name,
        Path(name, LOCK).open('wb') as lock,
    ):
        _take(lock)
        yield Path(name)


@contextmanager
def held_leftovers(path: Path, kind: str = 'partial') -> Iterator[list[Path]]:
    """Hold the folders that killed runs left beside ``path``, so that no other run removes them."""
    with ExitStack() as stack:
        held = []
        for left in sorted(_folders(path, kind)):
            if (left / LOCK).is_file():
                lock = stack.enter_context((left / LOCK).open('ab'))
                if _take(lock):
                    held.append(left)
        yield held


def _folders(path: Path, kind: str) -> list[Path]:
    """List the hidden folders beside ``path``."""
    prefix = f'.{path.name}.{kind}-'
    return [
        left
        for left in path.parent.iterdir()
        if left.name.startswith(prefix) and left.is_dir() and not left.is_symlink()
    ]


def _remove_if_left(folder: Path) -> None:
    """Remove a folder that no run holds."""
    with suppress(OSError):
        if not (folder / LOCK).is_file():
            if time() - folder.stat().st_mtime > YOUNG:
                shutil.rmtree(folder)
            return
        with (folder / LOCK).open('ab') as lock:
            if _take(lock):
                shutil.rmtree(folder)


def _take(lock: IO[bytes]) -> bool:
    """Take a lock; return whether it was free."""
    if sys.platform == 'win32':
        return False
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
