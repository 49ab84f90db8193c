# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""New files and folders that appear whole, together, or not at all, and never over another.

An output is built in a hidden folder. A run holds a lock on a file in that folder. The system
releases the lock when the run ends, however it ends; so the next run for the same output recognises
folders of killed runs, and removes them.

The check before the work only saves time: hours may pass until the end. ``rename`` itself replaces
files and empty folders. So the system is asked for a rename that refuses.
"""

import ctypes
import errno
import fcntl
import json
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from pathlib import Path
from tempfile import mkdtemp
from typing import IO

from lidar_outlier_filter.errors import FilterError, refusing

FILE, FOLDER = 'a new file', 'a new folder'  # what an output must be
LOCK = '.lock-of-the-run'
NAMES_FILE = '.names-of-the-run'  # lists what a run that gives several names was about to do
_GONE = '-gone'  # ends the name of a folder that is being removed
_HERE = -100  # AT_FDCWD: relative paths begin at the working folder
_NO_REPLACE = 1  # RENAME_NOREPLACE
_UNSUPPORTED = {errno.ENOSYS, errno.EINVAL, errno.ENOTSUP}  # by an old kernel, or by NFS


@contextmanager
def only_run(folder: Path) -> Iterator[None]:
    """Lock a folder until this run ends, however it ends.

    Raises
    ------
    BlockingIOError
        If another run holds the lock.

    """
    is_held = False
    while not is_held:  # again if a run that ends removed the file before it was locked
        with _lock_in(folder) as lock:
            is_held = os.fstat(lock.fileno()).st_nlink > 0
            if is_held:
                try:
                    yield
                finally:
                    (folder / LOCK).unlink(missing_ok=True)


@contextmanager
def hidden_folder(path: Path) -> Iterator[Path]:
    """Give a hidden folder beside ``path``; remove it at the end, and those of killed runs before.

    Raises
    ------
    OSError
        If it cannot be made.

    """
    for one in _hidden_beside(path):
        _remove_if_left(one)
    folder, lock = _made_and_locked(_prefix(path), path.parent)
    try:
        with lock:
            yield folder
    finally:
        remove_hidden(folder)


def _prefix(path: Path) -> str:
    return f'.{path.name}.partial-'


def _hidden_beside(path: Path) -> list[Path]:
    with os.scandir(path.parent) as found:
        folders = [one for one in found if one.is_dir(follow_symlinks=False)]
    return [Path(one.path) for one in folders if one.name.startswith(_prefix(path))]


def _made_and_locked(prefix: str, parent: Path) -> tuple[Path, IO[bytes]]:
    """Make a folder with a lock in it; try again if another run removed it before it was locked."""
    while True:
        folder = Path(mkdtemp(prefix=prefix, dir=parent))
        try:
            lock = _lock_in(folder)
        except (FileNotFoundError, BlockingIOError):
            continue
        except BaseException:
            remove_hidden(folder)
            raise
        if os.fstat(lock.fileno()).st_nlink:
            return folder, lock
        lock.close()


def _lock_in(folder: Path) -> IO[bytes]:
    """Take the lock in a new folder; raise BlockingIOError where another run holds it."""
    lock = (folder / LOCK).open('wb')
    try:
        _take(lock)
    except BlockingIOError:
        lock.close()
        raise
    except OSError:  # a file system without locks, on which no folder is removed
        pass
    return lock


def _take(lock: IO[bytes]) -> None:
    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _remove_if_left(folder: Path) -> None:
    """Remove a folder whose lock a killed run left, or an empty one; others stay."""
    with suppress(OSError):
        folder.rmdir()  # a live run that has not made its lock yet makes another folder
    with suppress(OSError), (folder / LOCK).open('r+b') as lock:
        _take(lock)
        remove_hidden(folder)


def remove_hidden(folder: Path) -> None:
    """Remove a folder into which a worker may still write.

    It is renamed first, so that the worker no longer finds it. The lock goes last: if this run is
    killed meanwhile, the next one recognises the folder by it.
    """
    gone = folder if folder.name.endswith(_GONE) else folder.with_name(f'{folder.name}{_GONE}')
    with suppress(OSError):
        folder.rename(gone)
    for name in (gone, folder):
        with suppress(OSError):
            for one in sorted(name.iterdir(), key=lambda path: path.name == LOCK):
                if one.is_dir() and not one.is_symlink():
                    shutil.rmtree(one, ignore_errors=True)
                else:
                    one.unlink(missing_ok=True)
        shutil.rmtree(name, ignore_errors=True)


def writable(path: object) -> AbstractContextManager[None]:
    """Refuse, in one sentence, an output that cannot be written, as on a full disk."""
    return refusing(FilterError, f'the output {path}', 'written in full', OSError)


@contextmanager
def new_files(paths: Sequence[Path], must_be: str = FILE) -> Iterator[list[Path]]:
    """Give, for each new file, a path to write it at; move all to their names at the end.

    Until then they are, under their own names, in hidden folders beside them; no error, no Ctrl-C
    and no full disk leaves anything behind; the next run removes what a killed run leaves.

    Parameters
    ----------
    paths : of the outputs
    must_be : ``FILE`` or ``FOLDER``

    Raises
    ------
    FilterError
        If two paths are the same, or one exists, at the start or at the end, or
        cannot be written.

    """
    if len({path.resolve() for path in paths}) < len(paths):
        raise FilterError('the outputs', 'different files', ', '.join(map(str, paths)))
    for path in paths:
        with suppress(OSError):  # of a folder that does not exist
            _finish_killed(path)
        check_new(path, must_be)
    with writable(next(iter(paths), 'of a dry run')), ExitStack() as stack:
        hidden = [stack.enter_context(hidden_folder(path)) / path.name for path in paths]
        yield hidden
        if len(paths) > 1:
            pairs = [
                [str(one.absolute()) for one in pair] for pair in zip(hidden, paths, strict=True)
            ]
            for one in hidden:
                (one.parent / NAMES_FILE).write_text(json.dumps(pairs), encoding='utf-8')
        with ExitStack() as undo:  # where one is refused, those before it lose their names
            for built, path in zip(hidden, paths, strict=True):
                with writable(path):
                    publish(built, path)
                undo.callback(path.rename, built)
            undo.pop_all()


def _finish_killed(path: Path) -> None:
    """Give the rest of the outputs their names, where a run was killed while it did so."""
    for folder in _hidden_beside(path):
        with suppress(OSError, ValueError), (folder / LOCK).open('r+b') as lock:
            _take(lock)
            pairs = [[*map(Path, pair)] for pair in json.loads((folder / NAMES_FILE).read_bytes())]
            # Where somebody removed an output, the others are old.
            if all(os.path.lexists(built) or os.path.lexists(path) for built, path in pairs):
                for built, named in pairs:
                    with suppress(FilterError, OSError):
                        publish(built, named)


@contextmanager
def new_output(path: Path, must_be: str = FILE) -> Iterator[Path]:
    """Give a path to write a new file at, or an empty new folder; see :func:`new_files`."""
    with new_files([path], must_be) as (built,):
        if must_be == FOLDER:
            built.mkdir()
        yield built


@contextmanager
def replaced(path: Path) -> Iterator[Path]:
    """Give a path to write a file or a folder at; at the end it replaces an older one.

    Until then, and after an error, the older one stays; see :func:`new_output`.

    Raises
    ------
    FilterError
        If there was no older one, and the name has been taken meanwhile.
    OSError
        If it cannot be written.

    """
    is_first = not os.path.lexists(path)
    with hidden_folder(path) as folder, ExitStack() as undo:
        built = folder / path.name
        yield built
        if is_first or built.is_dir():
            if not is_first:
                undo.callback(path.rename(folder / 'older').rename, path)
            publish(built, path)
            undo.pop_all()
        else:
            built.replace(path)


def check_new(path: Path, must_be: str = FILE, what: str = 'the output') -> None:
    """Refuse an output whose name is taken, or whose folder is missing, before the work begins."""
    if os.path.lexists(path):
        raise _taken(path, must_be, what)
    if not path.parent.is_dir():
        raise FilterError(what, 'in a folder that exists', path)


def _taken(path: Path, must_be: str, what: str = 'the output') -> FilterError:
    return FilterError(what, must_be, f'{path}, which exists; remove it, or name another')


def publish(built: Path, path: Path) -> None:
    """Give a file or a folder that is whole its name, on the same file system.

    Raises
    ------
    FilterError
        If the name has been taken meanwhile; that output stays as it is.
    OSError
        If the system refuses.

    """
    must_be = FOLDER if built.is_dir() else FILE
    try:
        if not _rename_in_one_step(built, path):
            _rename_in_two_steps(built, path)
    except FileExistsError as err:
        raise _taken(path, must_be) from err


def _rename_in_one_step(built: Path, path: Path) -> bool:
    """Rename, or raise FileExistsError; return whether the system can do it at once."""
    rename = getattr(ctypes.CDLL(None, use_errno=True), 'renameat2', None)
    if rename is None:
        return False
    if not rename(_HERE, os.fsencode(built), _HERE, os.fsencode(path), _NO_REPLACE):
        return True
    number = ctypes.get_errno()
    if number in _UNSUPPORTED:
        return False
    raise OSError(number, os.strerror(number), str(path))


def _rename_in_two_steps(built: Path, path: Path) -> None:
    """Rename, or raise FileExistsError: take the name, which only one run can, and then fill it."""
    if built.is_dir():
        path.mkdir()
    else:
        try:
            os.link(built, path)
        except FileExistsError:
            raise
        except OSError:  # FAT has one name for a file
            path.touch(exist_ok=False)
        else:
            built.unlink()
            return
    try:
        built.rename(path)  # over the empty one
    except BaseException:
        path.rmdir() if path.is_dir() else path.unlink()
        raise
