# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Small files, on this machine or on a store: listed, read, written in one step, removed."""

from __future__ import annotations

import os
from contextlib import suppress
from hashlib import file_digest
from pathlib import Path
from typing import TYPE_CHECKING

from lidar_outlier_filter.disk.new_files import publish, writable
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.recordings.remote_path import RemotePath, reached, written

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from lidar_outlier_filter.recordings.remote_path import RecordingPath

    State = tuple[int, str]  # bytes, and what changes with the content

_MARKS = ('ETag', 'etag', 'version_id', 'LastModified', 'mtime', 'created')


def foreign(path: RecordingPath) -> FilterError:
    """Return the error for a file, in the place of an output, that no run left so."""
    must_be = 'new, or an unchanged output of an earlier run'
    return FilterError('the output', must_be, f'{path}, which exists')


def exists(path: RecordingPath) -> bool:
    """Return whether a path is taken, as by a broken link."""
    return os.path.lexists(path) if isinstance(path, Path) else path.exists()


def file_state(path: RecordingPath) -> State:
    """Return the state of a file: ``mtime:`` and its time, or ``etag:`` and the mark of a store."""
    if isinstance(path, Path):
        stat = path.stat()
        return stat.st_size, f'mtime:{stat.st_mtime_ns}'
    with reached(path):
        return _state_of(path.system.info(path.key))


def files_below(path: RecordingPath) -> dict[RecordingPath, State]:
    """List the files of a folder, recursively, with their states; of a file, itself."""
    if isinstance(path, Path):
        inside = [path]
        if path.is_dir():
            inside = sorted(Path(here, name) for here, _, names in os.walk(path) for name in names)
        states: dict[RecordingPath, State] = {}
        for file in inside:
            with suppress(FileNotFoundError):  # removed by a run at the same time
                if file.is_file():
                    states[file] = file_state(file)
        return states
    with reached(path):
        found = path.system.find(path.key, detail=True)
    return {RemotePath(path.system, key): _state_of(info) for key, info in sorted(found.items())}


def _state_of(info: Mapping[str, object]) -> State:
    mark = next((str(info[name]).strip('"') for name in _MARKS if info.get(name)), '')
    return int(str(info['size'])), f'etag:{mark}'


def file_hash(path: RecordingPath) -> str:
    """Return the SHA-256 of a file."""
    with path.open('rb') as stream, reached(path):
        return file_digest(stream, 'sha256').hexdigest()  # type: ignore[arg-type]


def read_all(paths: Iterable[RecordingPath]) -> list[bytes]:
    """Read small files of one folder; a store is asked for all of them at once."""
    files = [*paths]
    local = [path.read_bytes() for path in files if isinstance(path, Path)]
    remote = [path for path in files if isinstance(path, RemotePath)]
    if not remote:
        return local
    with reached(remote[0]):
        texts = remote[0].system.cat([path.key for path in remote])
    return [texts[path.key] for path in remote] if isinstance(texts, dict) else [texts]


def write(path: RecordingPath, text: str, built: Path, *, is_new: bool = False) -> None:
    """Write a small file in one step, by way of the hidden folder ``built``.

    One that is new refuses to replace another.
    """
    if not isinstance(path, Path):
        with written(path):
            path.system.pipe_file(path.key, text.encode())
        return
    hidden = built / path.name
    with writable(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        with hidden.open('wb') as stream:
            stream.write(text.encode())
            stream.flush()
            os.fsync(stream.fileno())
        if is_new:
            publish(hidden, path)
        else:
            hidden.replace(path)


def remove(path: RecordingPath) -> None:
    """Remove a file, if it is there."""
    with written(path):
        if isinstance(path, Path):
            path.unlink(missing_ok=True)
        elif path.exists():
            path.system.rm_file(path.key)
