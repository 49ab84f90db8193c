# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Give outputs their names, whole and at the end, and replace only unchanged outputs of a run.

One run at a time works in an output folder. It builds outputs in a hidden folder; on S3 it uploads
their parts first. Then older outputs lose their names, the sidecar is replaced, and the new outputs
get theirs. So whatever a killed run leaves under a name is whole, and listed in a sidecar.
"""

import os
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event, Thread
from time import sleep
from typing import Any
from uuid import uuid4

from lidar_outlier_filter.archive import sidecar
from lidar_outlier_filter.archive.jobs import Task
from lidar_outlier_filter.archive.locations import (
    METADATA,
    exists,
    file_state,
    files_below,
    foreign,
    read_all,
)
from lidar_outlier_filter.archive.sidecar import ArchiveRecord, agrees, content_hash, mark_of
from lidar_outlier_filter.disk import new_files
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.recordings.remote_path import RecordingPath, RemotePath, reached, written

HIDDEN = '.unfinished'  # folder in that of the outputs
PART_BYTES = 32 * 2**20  # of an upload: S3 accepts 10 000 parts
RENEWAL_S = 10.0  # between two writes of the lock on a store
PATIENCE_S = 3 * RENEWAL_S  # a lock that stays the same for so long is that of a killed run
_READ_BYTES = 2**23


@contextmanager
def locked(folder: RecordingPath) -> Iterator[None]:
    """Keep a folder of outputs for this run; remove what killed runs left hidden in it.

    A worker of a killed run that still works then cannot publish: what it built is gone.
    """
    with ExitStack() as stack:
        if not isinstance(folder, Path):
            stack.enter_context(_lease(folder))
        else:
            with new_files.writable(folder):
                if not folder.exists():
                    stack.callback(_remove_empty, folder)  # of a run that is refused
                folder.mkdir(parents=True, exist_ok=True)
                try:
                    stack.enter_context(new_files.only_run(folder))
                except BlockingIOError as err:
                    raise _taken(folder) from err
                new_files.remove_hidden(folder / HIDDEN)
                stack.callback(new_files.remove_hidden, folder / HIDDEN)
                (folder / HIDDEN).mkdir()
        yield


def _remove_empty(folder: Path) -> None:
    with suppress(OSError):  # it is not empty
        folder.rmdir()


def _taken(folder: RecordingPath) -> FilterError:
    got = f'{folder}, where another run works'
    return FilterError('the output folder', 'that of one run at a time', got)


@contextmanager
def _lease(folder: RemotePath) -> Iterator[None]:
    """Hold the lock of a folder on a store: an object, renewed while the run works."""
    path, name, ended = folder / new_files.LOCK, uuid4().hex, Event()
    if hasattr(folder.system, 'call_s3'):
        with reached(folder):  # a bucket that does not exist has no objects
            folder.system.ls(folder.key.partition('/')[0])
    if path.exists():
        before = read_all([path])
        sleep(PATIENCE_S)
        if path.exists() and read_all([path]) != before:
            raise _taken(folder)
    path.write_text(name)

    def renew() -> None:
        for number in count():
            if ended.wait(RENEWAL_S):
                return
            with suppress(FilterError):  # the next one may be written
                path.write_text(f'{name} {number}')

    thread = Thread(target=renew, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        path.unlink()


def workshop(folder: RecordingPath) -> TemporaryDirectory[str]:
    """Give a hidden folder to build outputs in; on this machine if they go to a store."""
    hidden = folder / HIDDEN if isinstance(folder, Path) else None
    return TemporaryDirectory(
        prefix='.lidar_outlier_filter-', dir=hidden, ignore_cleanup_errors=True
    )


def done_before(task: Task, goal: ArchiveRecord) -> ArchiveRecord | None:
    """Return the record of complete outputs of the same input, parameters and code."""
    record, files = find_outputs(task)
    names = ('source', 'size', 'parameters', 'code')
    if record is None or any(getattr(record, name) != getattr(goal, name) for name in names):
        return None
    if record.outputs.keys() != files.keys():
        return None
    is_same = record.source_state == goal.source_state  # or else its content decides
    return record if is_same or record.source_hash == content_hash(task.location) else None


def find_outputs(
    task: Task, *, read: bool = False
) -> tuple[ArchiveRecord | None, dict[str, RecordingPath]]:
    """Return the sidecar of a task, and its outputs that exist, by name below the output folder.

    Whatever is not an unchanged output is refused; ``read`` does not trust equal states. Those of
    options that are no longer given are among them.
    """
    noted = sidecar.read(task.sidecar)
    marks = {} if noted is None else noted.outputs
    found: dict[str, RecordingPath] = {}
    for name, path in zip(task.names, task.outputs, strict=True):
        found.update({name + str(one)[len(str(path)) :]: one for one in _listed(path)})
    for name, path in found.items():
        if name not in marks or not agrees(path, marks[name], read=read):
            raise foreign(path)
    for name, mark in marks.items():  # of options that are no longer given, such as --list
        path = task.folder / name
        if name not in found and exists(path) and agrees(path, mark, read=read):
            found[name] = path
    return noted, found


def _listed(path: RecordingPath) -> list[RecordingPath]:
    """List a file or a link, all of them below a folder, or an empty folder."""
    if not isinstance(path, Path):
        return [*files_below(path)]
    inside: list[RecordingPath] = []
    if not path.is_symlink():
        inside = [one for one in path.rglob('*') if one.is_symlink() or not one.is_dir()]
    return inside or [path] * exists(path)


def publish(task: Task, built: Path, record: ArchiveRecord, log: Mapping[str, Any]) -> None:
    """Write the sidecar of a task, and give its outputs their names.

    Parameters
    ----------
    task : whose outputs are in the folder ``built``; no outputs if it has no clouds
    built : the folder
    record : without fingerprints of the outputs
    log : what the sidecar contains beside the record

    """
    files = _built(task.names, built)
    record = replace(record, outputs={name: mark_of(file) for name, file in files.items()})
    if isinstance(task.folder, Path):
        with new_files.writable(task.folder), workshop(task.folder) as older:
            _rename(task, built, Path(older), sidecar.as_text(record, log))
        return
    with _sent(task.folder, files):
        for path in find_outputs(task)[1].values():  # a store marks content
            path.unlink()
        task.sidecar.write_text(sidecar.as_text(record, log))
    states = {name: file_state(task.folder / name)[1] for name in files}
    marks = {name: mark._replace(state=states[name]) for name, mark in record.outputs.items()}
    task.sidecar.write_text(sidecar.as_text(replace(record, outputs=marks), log))


def _rename(task: Task, built: Path, older: Path, text: str) -> None:
    """Move older outputs away, replace the sidecar, and give new outputs their names."""
    paths, own = [Path(str(path)) for path in task.outputs], Path(str(task.sidecar))
    with (built / own.name).open('w') as stream:  # a full disk refuses it before anything is moved
        stream.write(text)
        stream.flush()
        os.fsync(stream.fileno())  # not empty after a loss of power, either
    _, found = find_outputs(task, read=True)
    for path in paths:
        if exists(path):
            path.rename(older / path.name)
    for number, left in enumerate(Path(str(path)) for path in found.values() if exists(path)):
        left.rename(older / f'{number}')
        _remove_empty(left.parent)
    own.parent.mkdir(parents=True, exist_ok=True)
    (built / own.name).replace(own)
    for path in paths:
        if (built / path.name).exists():
            new_files.publish(built / path.name, path)


@contextmanager
def new_bag(path: RecordingPath) -> Iterator[Path]:
    """Give a path of this machine to build a single bag at; upload it if it is for a store."""
    if isinstance(path, Path):
        yield path
        return
    if path.exists():
        raise foreign(path)
    with workshop(path.parent) as built:
        yield Path(built) / path.name
        with _sent(path.parent, _built((path.name,), Path(built))):
            pass


def _built(names: Iterable[str], built: Path) -> dict[str, Path]:
    """List the files that were built, by name below the output folder; metadata come last."""
    files: dict[str, Path] = {}
    for name in names:
        one = built / Path(name).name
        if one.is_dir():
            inside = sorted(one.iterdir(), key=lambda file: (file.name == METADATA, file.name))
            files.update({f'{name}/{file.name}': file for file in inside})
        elif one.is_file():
            files[name] = one
    return files


@contextmanager
def _sent(folder: RemotePath, files: Mapping[str, Path]) -> Iterator[None]:
    """Send files to a store; at the end they get their names, in their order.

    Until then S3 holds parts of uploads, and no object.
    """
    streams: list[Any] = []
    with written(folder), ExitStack() as undo:
        for name, file in files.items():
            key = (folder / name).key
            stream = folder.system.open(key, 'wb', block_size=PART_BYTES, autocommit=False)
            undo.callback(_discard, stream)
            with file.open('rb') as source:
                shutil.copyfileobj(source, stream, _READ_BYTES)
            stream.close()
            streams.append(stream)
        yield
        for stream in streams:
            stream.commit()
        undo.pop_all()


def _discard(stream: Any) -> None:
    with suppress(Exception):  # what remains of an upload is removed by a rule of the bucket
        stream.discard()
    stream.closed = True  # or it would try to write the rest when it is collected
