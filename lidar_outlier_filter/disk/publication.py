# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How an output gets its name, which is never that of something else.

A check before the work is a courtesy: hours may lie between it and the end. ``rename`` itself
replaces a file, and an empty folder. So the system is asked for a rename that refuses.
"""

from __future__ import annotations

import ctypes
import errno
import os
import sys
from typing import TYPE_CHECKING

from lidar_outlier_filter.errors import FilterError, RecordingError

if TYPE_CHECKING:
    from pathlib import Path

FILE, FOLDER = 'a new file', 'a new folder'  # what an output must be

_HERE = -100  # AT_FDCWD: relative paths begin at the working folder
_NO_REPLACE = 1  # RENAME_NOREPLACE
_NOT_KNOWN = {errno.ENOSYS, errno.EINVAL, errno.ENOTSUP}  # to an old kernel, or to NFS


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
