# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Where the lines of a manifest lie: in a file of this machine, or in objects of a store.

A store has no file that grows. So each write is a small object of its own, whose number is one more
than that of the last. It is written only where there is none: of two runs one is refused. At the
end one object has all lines, and of the others only the last is left, whose number is taken.
"""

from __future__ import annotations

import os
import sys
from contextlib import contextmanager
from typing import IO, TYPE_CHECKING, Protocol

from lidar_outlier_filter.archive.locations import location_of
from lidar_outlier_filter.disk.new_files import replaced
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.recordings.remote_path import reached, written

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from lidar_outlier_filter.recordings.remote_path import RemotePath

if sys.platform != 'win32':
    import fcntl

LINES = '.manifest'  # folder beside the manifest of a store, with the objects of a run


class Log(Protocol):
    """Lines that are written one after the other, and read again."""

    def lines(self) -> Iterable[bytes]:
        """Give what is there."""

    def keep(self, size: int, /) -> None:
        """Leave out what is behind so many bytes."""

    def append(self, line: bytes, /) -> None:
        """Add a line."""

    def flush(self) -> None:
        """Have all lines there for good."""

    def replace(self, lines: bytes, /) -> None:
        """Leave these lines alone, at the end of a run."""


class NoLog:
    """What is added is nowhere."""

    def lines(self) -> Iterable[bytes]:
        """See :class:`Log`."""
        return ()

    def keep(self, size: int) -> None:
        """See :class:`Log`."""

    def append(self, line: bytes) -> None:
        """See :class:`Log`."""

    def flush(self) -> None:
        """See :class:`Log`."""

    def replace(self, lines: bytes) -> None:
        """See :class:`Log`."""


class FileLog:
    """A file of this machine; a line is there when it is added, also for who kills this process."""

    def __init__(self, path: Path, stream: IO[bytes]) -> None:
        """Take a file, and a stream for reading and appending."""
        self._path, self._stream, self._is_synced = path, stream, True

    def lines(self) -> Iterable[bytes]:
        """See :class:`Log`."""
        self._stream.seek(0)
        return self._stream

    def keep(self, size: int) -> None:
        """See :class:`Log`."""
        self._stream.truncate(size)

    def append(self, line: bytes) -> None:
        """See :class:`Log`."""
        self._stream.write(line)
        self._stream.flush()
        self._is_synced = False

    def flush(self) -> None:
        """See :class:`Log`; one wait for the disk serves all lines."""
        if not self._is_synced:
            os.fsync(self._stream.fileno())
            self._is_synced = True

    def replace(self, lines: bytes) -> None:
        """See :class:`Log`."""
        with replaced(self._path) as built, built.open('wb') as stream:
            stream.write(lines)
            stream.flush()
            os.fsync(stream.fileno())
        _sync_folder(self._path.parent)


class StoreLog:
    """Objects of a store: one with all lines of earlier runs, and one for each write since."""

    def __init__(self, path: RemotePath) -> None:
        """Look what is there."""
        self._path, self._folder = path, path.parent / LINES
        with reached(path):
            found = path.system.find(self._folder.key)
        self._names = sorted(name for name in found if name.rpartition('/')[2].isdecimal())
        self._next = 1 + max((int(name.rpartition('/')[2]) for name in self._names), default=0)
        self._state, self._unwritten, self._whole = '', b'', b''

    def lines(self) -> Iterable[bytes]:
        """See :class:`Log`."""
        system = self._path.system
        with reached(self._path):
            try:
                since = system.cat(self._names) if self._names else {}
            except FileNotFoundError as err:  # another run has ended meanwhile
                raise self._two_runs() from err
            if self._path.exists():
                self._whole = bytes(system.cat_file(self._path.key))
                self._state = location_of(self._path).state
        parts = (self._whole, *(since[name] for name in self._names))
        return b''.join(parts).splitlines(keepends=True)

    def keep(self, size: int) -> None:
        """See :class:`Log`; an object is whole or not there."""

    def append(self, line: bytes) -> None:
        """See :class:`Log`."""
        self._unwritten += line

    def flush(self) -> None:
        """Write what was added as one object, where there is none of its number."""
        if not self._unwritten:
            return
        target = self._folder / f'{self._next:09}'
        with written(target):
            try:
                target.system.pipe_file(target.key, self._unwritten, mode='create')
            except FileExistsError as err:
                # The answer to the first attempt may have been lost: then it is ours.
                if target.system.cat_file(target.key) != self._unwritten:
                    raise self._two_runs() from err
        self._names.append(target.key)
        self._next += 1
        self._unwritten = b''

    def replace(self, lines: bytes) -> None:
        """See :class:`Log`."""
        self.flush()
        if lines != self._whole:
            if self._path.exists() and location_of(self._path).state != self._state:
                raise self._two_runs()
            with written(self._path):
                self._path.system.pipe_file(self._path.key, lines)
        if self._names[:-1]:
            with written(self._folder):
                self._path.system.rm(self._names[:-1])

    def _two_runs(self) -> RecordingError:
        must_be = 'written by one run at a time'
        return RecordingError(f'the manifest {self._path}', must_be, 'two that write')


@contextmanager
def opened_file(path: Path) -> Iterator[FileLog]:
    """Open a log of this machine, which is made where there is none; one run at a time.

    Raises
    ------
    RecordingError
        If another run uses it, or it cannot be written.

    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        stream = path.open('ab+')
    except OSError as err:
        raise RecordingError(f'the manifest {path}', 'writable', err.strerror) from err
    with stream:
        _lock(path, stream)
        yield FileLog(path, stream)


def _lock(path: Path, stream: IO[bytes]) -> None:
    """Refuse a second run; the system lets go of the lock however this one ends."""
    if sys.platform == 'win32':
        return
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as err:
        raise _two_runs(path) from err
    if not path.exists() or not os.path.samestat(path.stat(), os.fstat(stream.fileno())):
        raise _two_runs(path)  # the other one has ended meanwhile, and put a new file there


def _two_runs(path: Path) -> RecordingError:
    return RecordingError(f'the manifest {path}', 'used by one run at a time', 'two')


def _sync_folder(folder: Path) -> None:
    """Have the names in a folder on the disk."""
    if sys.platform == 'win32':
        return
    number = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(number)
    finally:
        os.close(number)
