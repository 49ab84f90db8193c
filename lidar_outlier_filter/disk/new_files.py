# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""New files and folders that appear whole, together, or not at all, and never over another.

An output is built in a hidden folder. A run holds a lock on a file in it. The system lets go of it
when the run ends, however it does; so the next run for the same output knows which folders are
nobody's, and removes them.

A check before the work is a courtesy: hours may lie between it and the end. ``rename`` itself
replaces a file, and an empty folder. So the system is asked for a rename that refuses.
"""

from __future__ import annotations

import ctypes
import errno
import os
import shutil
import sys
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from tempfile import mkdtemp
from time import time
from typing import IO, TYPE_CHECKING

from lidar_outlier_filter.errors import CloudError, FilterError, RecordingError, said_by

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

FILE, FOLDER = 'a new file', 'a new folder'  # what an output must be
_HERE = -100  # AT_FDCWD: relative paths begin at the working folder
_NO_REPLACE = 1  # RENAME_NOREPLACE
_NOT_KNOWN = {errno.ENOSYS, errno.EINVAL, errno.ENOTSUP}  # to an old kernel, or to NFS


if sys.platform != 'win32':
    import fcntl
LOCK = '.lock-of-the-run'
_TO_BE = f'{LOCK}-to-be'  # its name until it is locked
_GONE = '-gone'  # ends the name of a folder that is being removed
YOUNG = 60.0  # seconds: a folder with files and without a lock may be of a system that has none


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
    folder, lock = _made_and_locked(f'.{path.name}.{kind}-', path.parent)
    try:
        with lock:
            yield folder
    finally:
        _remove(folder)


def _made_and_locked(prefix: str, parent: Path) -> tuple[Path, IO[bytes]]:
    """Make a folder with a lock in it; again, where another run removed it before it had one."""
    while True:
        folder = Path(mkdtemp(prefix=prefix, dir=parent))
        try:
            return folder, _lock_in(folder)
        except FileNotFoundError:
            continue
        except BaseException:
            _remove(folder)
            raise


def _lock_in(folder: Path) -> IO[bytes]:
    """Take the lock in a new folder.

    The file has its name from when it is locked: another run could take it before, and remove all.
    """
    if sys.platform == 'win32':  # where no run takes a lock, and no open file has its name changed
        return (folder / LOCK).open('wb')
    with ExitStack() as stack:
        lock = stack.enter_context((folder / _TO_BE).open('wb'))
        _take(lock)
        (folder / _TO_BE).rename(folder / LOCK)
        stack.pop_all()
        return lock


def _remove(folder: Path) -> None:
    """Remove a folder into which a worker may write still.

    It gets another name first: who writes into it by its name finds it gone. And where this run is
    killed, the next one knows by the name that nobody needs what is in it.
    """
    gone = folder.with_name(f'{folder.name}{_GONE}')
    with suppress(OSError):
        folder.rename(gone)
    for name in (gone, folder):
        shutil.rmtree(name, ignore_errors=True)


def _folders(path: Path, kind: str) -> list[Path]:
    """List the hidden folders beside ``path``."""
    prefix = f'.{path.name}.{kind}-'
    with os.scandir(path.parent) as found:
        return [
            Path(left.path)
            for left in found
            if left.name.startswith(prefix) and left.is_dir(follow_symlinks=False)
        ]


def _remove_if_left(folder: Path) -> None:
    """Remove a folder that no run holds."""
    if folder.name.endswith(_GONE):
        shutil.rmtree(folder, ignore_errors=True)
        return
    with suppress(OSError):
        if not (folder / LOCK).is_file():
            _remove_without_lock(folder)
            return
        with (folder / LOCK).open('ab') as lock:
            if _take(lock):
                _remove(folder)


def _remove_without_lock(folder: Path) -> None:
    """Remove a folder in which nothing stands but a lock to be; a run that lives makes another."""
    (folder / _TO_BE).unlink(missing_ok=True)
    try:
        folder.rmdir()  # refuses where the lock got its name meanwhile
    except OSError:
        if time() - folder.stat().st_mtime > YOUNG and not (folder / LOCK).exists():
            _remove(folder)


def _take(lock: IO[bytes]) -> bool:
    """Take a lock; return whether it was free."""
    if sys.platform == 'win32':
        return False
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


@contextmanager
def new_files(paths: Sequence[Path]) -> Iterator[list[Path]]:
    """Give, for each new file, a path to write it at; move all to their names at the end.

    Until then they are, under their own names, in hidden folders beside them; no error, no Ctrl-C
    and no full disk leaves anything behind; what a killed run leaves, the next one removes.

    Raises
    ------
    CloudError
        If a path is that of another or exists, at the start or at the end, or cannot be written.

    """
    if len({path.resolve() for path in paths}) < len(paths):
        names = ', '.join(str(path) for path in paths)
        raise CloudError('the outputs', 'different files', names)
    for path in paths:
        check_new(path, FILE, CloudError)
    with ExitStack() as stack:
        hidden = [stack.enter_context(_hidden(path)) / path.name for path in paths]
        yield hidden
        publish_all(hidden, paths)


def publish_all(hidden: Sequence[Path], paths: Sequence[Path]) -> None:
    """Give all files their names, or none: where one is refused, those before it lose theirs.

    Raises
    ------
    CloudError
        If a name has been taken meanwhile, or the system refuses.

    """
    with ExitStack() as undo:
        for built, path in zip(hidden, paths, strict=True):
            try:
                publish(built, path, CloudError)
            except OSError as err:
                raise CloudError(f'the output {path}', 'written', f'"{err.strerror}"') from err
            undo.callback(path.rename, built)
        undo.pop_all()


@contextmanager
def _hidden(path: Path) -> Iterator[Path]:
    with ExitStack() as stack:
        try:
            folder = stack.enter_context(hidden_folder(path))
        except OSError as err:
            raise CloudError(f'the output {path}', 'written', f'"{err.strerror}"') from err
        yield folder


@contextmanager
def new_output(
    path: Path, must_be: str = FILE, error: type[FilterError] = RecordingError
) -> Iterator[Path]:
    """Give a path to write a new file at, or an empty new folder; move it to its name at the end.

    Until then it is, under its own name, in a hidden folder beside it, as :func:`new_files`.

    Parameters
    ----------
    path : of the output
    must_be : ``FILE`` or ``FOLDER``
    error : what is raised

    Raises
    ------
    FilterError
        The ``error``, if the path exists, at the start or at the end, or cannot be written.

    """
    check_new(path, must_be, error)
    try:
        with hidden_folder(path) as folder:
            built = folder / path.name
            if must_be == FOLDER:
                built.mkdir()
            yield built
            publish(built, path, error)
    except OSError as err:
        raise error(f'the output {path}', 'written in full', said_by(err)) from err


@contextmanager
def replaced(path: Path) -> Iterator[Path]:
    """Give a path to write a file or a folder at; at the end it takes the place of an older one.

    Until then, and after an error, the older one stays; see :func:`new_output`.

    Raises
    ------
    RecordingError
        If there was no older one, and the name has been taken meanwhile.
    OSError
        If it cannot be written.

    """
    older = os.path.lexists(path)
    with hidden_folder(path) as folder:
        built = folder / path.name
        yield built
        if not older:
            publish(built, path)
        elif built.is_dir():
            publish_instead(built, path, folder / 'older')
        else:
            built.replace(path)


def publish_instead(built: Path, path: Path, older: Path) -> None:
    """Give a folder that is whole its name, and the one that has it the name ``older``.

    Raises
    ------
    FilterError, OSError
        See :func:`publish`; then the older one has its name again.

    """
    with ExitStack() as undo:
        undo.callback(path.rename(older).rename, path)
        publish(built, path)
        undo.pop_all()


def taken(
    path: object,
    must_be: str = FILE,
    error: type[FilterError] = RecordingError,
    what: str = 'the output',
) -> FilterError:
    """Make the refusal of an output whose name something else has."""
    return error(what, must_be, f'{path}, which exists')


def check_new(
    path: Path,
    must_be: str = FILE,
    error: type[FilterError] = RecordingError,
    what: str = 'the output',
) -> None:
    """Refuse an output whose name is taken, before the work begins."""
    if os.path.lexists(path):
        raise taken(path, must_be, error, what)


def publish(built: Path, path: Path, error: type[FilterError] = RecordingError) -> None:
    """Give a file or a folder that is whole its name, on the same file system.

    Raises
    ------
    FilterError
        The ``error``, if the name has been taken meanwhile. What has it stays as it is.
    OSError
        If the system refuses.

    """
    must_be = FOLDER if built.is_dir() else FILE
    try:
        if not _rename_in_one_step(built, path):
            _rename_in_two_steps(built, path)
    except FileExistsError as err:
        raise taken(path, must_be, error) from err


def _rename_in_one_step(built: Path, path: Path) -> bool:
    """Rename, or raise FileExistsError; return whether the system can do it at once."""
    if sys.platform == 'win32':
        built.rename(path)  # there, it refuses
        return True
    rename = getattr(ctypes.CDLL(None, use_errno=True), 'renameat2', None)
    if rename is None:
        return False
    if not rename(_HERE, os.fsencode(built), _HERE, os.fsencode(path), _NO_REPLACE):
        return True
    number = ctypes.get_errno()
    if number in _NOT_KNOWN:
        return False
    raise OSError(number, os.strerror(number), str(path))


def _rename_in_two_steps(built: Path, path: Path) -> None:
    """Rename, or raise FileExistsError: take the name, which only one can, and then fill it."""
    if built.is_dir():
        path.mkdir()
        remove = path.rmdir
    else:
        try:
            os.link(built, path)
        except FileExistsError:
            raise
        except OSError:  # FAT has one name for a file
            path.touch(exist_ok=False)
            remove = path.unlink
        else:
            built.unlink()
            return
    try:
        built.rename(path)  # over the empty one
    except BaseException:
        remove()
        raise
