# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Give outputs their names, whole and at the end, and replace only unchanged outputs of a run.

Outputs are built in a hidden folder; on S3 their parts are uploaded first. An intent, which is the
sidecar under a hidden name, is written before the first output gets its name, and removed after the
sidecar is there. So what a killed run named is known as an output of a run.
"""

from __future__ import annotations

import os
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.archive import sidecar
from lidar_outlier_filter.archive.fingerprints import agrees, content_hash, mark_of
from lidar_outlier_filter.archive.jobs import Task
from lidar_outlier_filter.archive.locations import METADATA, Location
from lidar_outlier_filter.archive.storage import (
    exists,
    file_state,
    files_below,
    foreign,
    read_all,
    remove,
    write,
)
from lidar_outlier_filter.disk.new_files import hidden_folder, publish_all, writable
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.recordings.remote_path import reached, written

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from lidar_outlier_filter.archive.sidecar import ArchiveRecord
    from lidar_outlier_filter.recordings.remote_path import RecordingPath, RemotePath

HIDDEN = '.unfinished'  # folder in that of the outputs
PART_BYTES = 32 * 2**20  # of an upload: S3 accepts 10 000 parts
_READ_BYTES = 2**23


@dataclass(frozen=True)
class FoundOutputs:
    """The outputs of a task that exist, all of them unchanged outputs of earlier runs.

    Attributes
    ----------
    noted, intended : the records of the sidecar and of the intent
    files : paths by name below the output folder

    """

    noted: ArchiveRecord | None
    intended: ArchiveRecord | None
    files: Mapping[str, RecordingPath]

    def done(self, goal: ArchiveRecord, task: Task) -> ArchiveRecord | None:
        """Return the record of complete outputs of the same input, parameters and code."""
        for record in (self.noted, self.intended):
            if record is None or record.outputs.keys() != self.files.keys():
                continue
            names = ('source', 'size', 'parameters', 'code')
            if not all(getattr(record, name) == getattr(goal, name) for name in names):
                continue
            is_same = record.source_state == goal.source_state  # or else its content decides
            if all(agrees(self.files[name], mark) for name, mark in record.outputs.items()) and (
                is_same or record.source_hash == content_hash(task.location)
            ):
                return record
        return None


def find_outputs(task: Task, *, read: bool = False) -> FoundOutputs:
    """Find the outputs of a task that exist; ``read`` does not trust equal states."""
    for _ in range(2):  # a run at the same time may have named one between the two lists
        # In this order: such a run writes the sidecar before it removes the intent.
        intended = sidecar.read(_intent(task))
        noted = sidecar.read(task.sidecar)
        records = [record.outputs for record in (noted, intended) if record is not None]
        listed: dict[str, RecordingPath] = {}
        for name, path in zip(task.names, task.outputs, strict=True):
            listed.update(_files_at(path, name))
        known = {
            name: path
            for name, path in listed.items()
            if any(name in of and agrees(path, of[name], read=read) for of in records)
        }
        # One that is gone was moved by a run at the same time.
        others = [path for name, path in listed.items() if name not in known and exists(path)]
        if not others:
            return FoundOutputs(noted, intended, known)
    raise foreign(others[0])


def _files_at(path: RecordingPath, name: str) -> dict[str, RecordingPath]:
    """List a file, or all files, links and empty folders below a folder."""
    if not isinstance(path, Path):
        return {name + str(one)[len(str(path)) :]: one for one in files_below(path)}
    if path.is_symlink() or not path.is_dir():
        return {name: path} if exists(path) else {}
    inside: dict[str, RecordingPath] = {}
    for folder, folders, names in os.walk(path):  # a run at the same time may move the folder
        here = Path(folder)
        links = [one for one in folders if (here / one).is_symlink()]
        is_empty = not folders and not names and here != path
        listed = [here] if is_empty else [here / one for one in (*names, *links)]
        inside.update({f'{name}/{one.relative_to(path)}': one for one in listed})
    return inside or {name: path}


def done_before(task: Task, goal: ArchiveRecord, found: FoundOutputs) -> ArchiveRecord | None:
    """Return the record of a task that is done; write the sidecar that a killed run did not."""
    record = found.done(goal, task)
    if record is None:
        return None
    if record is not found.noted:
        with suppress(FileNotFoundError), workshop(task.folder) as built:
            (text,) = read_all([_intent(task)])  # if not: the run lives, and has written it
            try:
                write(task.sidecar, text.decode(), built, is_new=found.noted is None)
            except FilterError:
                if sidecar.read(task.sidecar) is None:
                    raise
    if found.intended is not None:
        remove(_intent(task))
    return record


def _intent(task: Task) -> RecordingPath:
    name = sha256(task.names[0].encode(errors='surrogateescape')).hexdigest()[:16]
    return task.folder / HIDDEN / f'{name}{sidecar.SUFFIX}'


@contextmanager
def workshop(folder: RecordingPath) -> Iterator[Path]:
    """Give a hidden folder to build outputs in; remove it at the end, and those of killed runs.

    It lies in the folder of the outputs, or on this machine if they go to a store.
    """
    with ExitStack() as stack:
        if not isinstance(folder, Path):
            temporary = TemporaryDirectory(prefix='.lidar_outlier_filter-')
            yield Path(stack.enter_context(temporary))
            return
        with writable(folder):
            built = _hidden_in(folder, stack)
        yield built


def _hidden_in(folder: Path, stack: ExitStack) -> Path:
    """Make a hidden folder, again if another run that ends removes the one above it."""
    while True:
        (folder / HIDDEN).mkdir(parents=True, exist_ok=True)
        with suppress(FileNotFoundError):
            return stack.enter_context(hidden_folder(folder / HIDDEN / 'task'))


def check_reached(folder: RecordingPath) -> None:
    """Refuse outputs in a bucket that does not exist, or cannot be reached."""
    if not isinstance(folder, Path) and hasattr(folder.system, 'call_s3'):
        with reached(folder):
            folder.system.ls(folder.key.partition('/')[0])


def tidy(folder: RecordingPath) -> None:
    """Remove what killed runs, and workers that were ended, left hidden in a folder."""
    if isinstance(folder, Path) and (folder / HIDDEN).is_dir():
        with workshop(folder):
            pass
        with suppress(OSError):  # another run works
            (folder / HIDDEN).rmdir()


def publish(
    task: Task, built: Path, record: ArchiveRecord, log: Mapping[str, Any], before: FoundOutputs
) -> ArchiveRecord:
    """Give the outputs of a task their names, and write the sidecar.

    Parameters
    ----------
    task : whose outputs are in the folder ``built``; there are none if it has no clouds
    record : without fingerprints of the outputs
    log : what the sidecar contains beside the record
    before : what was there when the work began, which alone is replaced

    Returns
    -------
    ArchiveRecord
        That of the sidecar, which a run at the same time may have written.

    """
    files = _built(task, built)
    record = replace(record, outputs={name: mark_of(file) for name, file in files.items()})
    is_named = False
    try:
        with ExitStack() as undo:
            streams = [] if isinstance(task.folder, Path) else _send(task, files, undo)
            write(_intent(task), sidecar.as_text(record, log), built)
            now = _check(task, before)
            if isinstance(task.folder, Path):
                _rename(task, built, now)
            else:
                is_named = True  # in part, if it fails
                _complete(task, streams, now)
                states = {name: file_state(task.folder / name)[1] for name in files}
                marks = {k: mark._replace(state=states[k]) for k, mark in record.outputs.items()}
                record = replace(record, outputs=marks)
            is_named = True
            undo.pop_all()
        write(task.sidecar, sidecar.as_text(record, log), built, is_new=now.noted is None)
    except FilterError:
        with suppress(FilterError):  # the first one is raised
            found = find_outputs(task)
            if (other := found.done(record, task)) is not None:  # of a run that was faster
                if found.noted is not None:
                    remove(_intent(task))
                return other
        if not is_named:
            remove(_intent(task))
        raise
    remove(_intent(task))
    return record


@contextmanager
def new_bag(path: RecordingPath) -> Iterator[Path]:
    """Give a path of this machine to build a single bag at; upload it if it is for a store."""
    if isinstance(path, Path):
        yield path
        return
    if path.exists():
        raise foreign(path)
    task = Task(Location(path, 0, ''), '', path.parent, (path.name,))
    with workshop(path.parent) as built, ExitStack() as undo:
        yield built / path.name
        streams = _send(task, _built(task, built), undo)
        _complete(task, streams, FoundOutputs(None, None, {}))
        undo.pop_all()


def _built(task: Task, built: Path) -> dict[str, Path]:
    """List the files that were built, by name below the output folder; metadata come last."""
    files: dict[str, Path] = {}
    for name, path in zip(task.names, task.outputs, strict=True):
        one = built / path.name
        if one.is_dir():
            inside = sorted(one.iterdir(), key=lambda file: (file.name == METADATA, file.name))
            files.update({f'{name}/{file.name}': file for file in inside})
        elif one.is_file():
            files[name] = one
    return files


def _check(task: Task, before: FoundOutputs) -> FoundOutputs:
    """Refuse outputs that came or changed since the work began."""
    now = find_outputs(task, read=isinstance(task.folder, Path))  # a store marks the content
    if now.noted != before.noted:
        raise foreign(task.sidecar)
    for name, path in now.files.items():
        if name not in before.files:
            raise foreign(path)
    return now


def _rename(task: Task, built: Path, now: FoundOutputs) -> None:
    """Move old outputs into the hidden folder and new ones to their names, all or none."""
    states = {name: file_state(path) for name, path in now.files.items()}
    (built / 'older').mkdir()
    with ExitStack() as undo, writable(built):
        for name, path in zip(task.names, task.outputs, strict=True):
            older = built / 'older' / path.name
            was_there = any(f'{key}/'.startswith(f'{name}/') for key in now.files)
            if isinstance(path, Path) and was_there:
                path.rename(older)
                undo.callback(_put_back, older, path)
                moved = _files_at(older, name)
                if any(states.get(key) != file_state(file) for key, file in moved.items()):
                    raise foreign(path)  # it changed in this moment
        paths = [path for path in task.outputs if isinstance(path, Path)]
        new = [(built / path.name, path) for path in paths if (built / path.name).exists()]
        for _, path in new:
            path.parent.mkdir(parents=True, exist_ok=True)
        publish_all([hidden for hidden, _ in new], [path for _, path in new])
        undo.pop_all()


def _put_back(older: Path, path: Path) -> None:
    with suppress(FilterError):
        publish_all([older], [path])


def _send(task: Task, files: Mapping[str, Path], undo: ExitStack) -> list[Any]:
    """Send files to a store, in their order; on S3 their parts are no object yet."""
    streams = []
    with written(task.outputs[0]):
        for name, file in files.items():
            target: RemotePath = task.folder / name  # type: ignore[assignment]
            stream = target.system.open(target.key, 'wb', block_size=PART_BYTES, autocommit=False)
            undo.callback(_discard, stream)
            with file.open('rb') as source:
                while data := source.read(_READ_BYTES):
                    stream.write(data)
            stream.close()
            streams.append(stream)
    return streams


def _discard(stream: Any) -> None:
    with suppress(Exception):  # what remains of an upload is removed by a rule of the bucket
        stream.discard()
    stream.closed = True  # or it would try to write the rest when it is collected


def _complete(task: Task, streams: Sequence[Any], now: FoundOutputs) -> None:
    """Remove old objects, and give new ones their names, in their order."""
    for path in now.files.values():
        remove(path)
    with written(task.outputs[0]):
        for stream in streams:
            stream.commit()
