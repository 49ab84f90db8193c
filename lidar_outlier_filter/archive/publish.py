# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Give outputs their names, whole and at the end, and replace only unchanged outputs of a run.

Outputs are built in a hidden folder; on S3 their parts are uploaded first. Then older outputs lose
their names, the sidecar gets its own, and the new outputs get theirs. So the sidecar lists what a
killed run gave names to.
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from lidar_outlier_filter.archive import sidecar
from lidar_outlier_filter.archive.jobs import Task
from lidar_outlier_filter.archive.locations import (
    METADATA,
    Location,
    exists,
    file_state,
    files_below,
    foreign,
    remove,
    write,
)
from lidar_outlier_filter.archive.sidecar import ArchiveRecord, agrees, content_hash, mark_of
from lidar_outlier_filter.disk.new_files import hidden_folder, publish_all, writable
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.recordings.remote_path import RecordingPath, RemotePath, reached, written

HIDDEN = '.unfinished'  # folder in that of the outputs
PART_BYTES = 32 * 2**20  # of an upload: S3 accepts 10 000 parts
_READ_BYTES = 2**23


@dataclass(frozen=True)
class FoundOutputs:
    """The outputs of a task that exist, all of them unchanged outputs of earlier runs.

    Attributes
    ----------
    noted : the record of the sidecar
    files : paths by name below the output folder

    """

    noted: ArchiveRecord | None
    files: Mapping[str, RecordingPath]

    def done(self, goal: ArchiveRecord, task: Task) -> ArchiveRecord | None:
        """Return the record of complete outputs of the same input, parameters and code."""
        record, names = self.noted, self.files.keys()
        if record is None or not _is_alike(record, goal) or record.outputs.keys() != names:
            return None
        is_same = record.source_state == goal.source_state  # or else its content decides
        return record if is_same or record.source_hash == content_hash(task.location) else None


def find_outputs(task: Task, *, read: bool = False) -> FoundOutputs:
    """Find the outputs of a task that exist; ``read`` does not trust equal states."""
    for _ in range(2):  # a run at the same time may have named one between the two lists
        noted = sidecar.read(task.sidecar)
        marks = {} if noted is None else noted.outputs
        listed: dict[str, RecordingPath] = {}
        for name, path in zip(task.names, task.outputs, strict=True):
            listed.update(_files_at(path, name))
        known = {
            name: path
            for name, path in listed.items()
            if name in marks and agrees(path, marks[name], read=read)
        }
        # One that is gone was moved by a run at the same time.
        others = [path for name, path in listed.items() if name not in known and exists(path)]
        if not others:
            return FoundOutputs(noted, known)
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
            built: Path | None = None
            while built is None:  # again if another run that ends removes the folder above it
                (folder / HIDDEN).mkdir(parents=True, exist_ok=True)
                with suppress(FileNotFoundError):
                    built = stack.enter_context(hidden_folder(folder / HIDDEN / 'task'))
        yield built


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
    """Write the sidecar of a task, and give its outputs their names.

    Parameters
    ----------
    task : whose outputs are in the folder ``built``; no outputs if it has no clouds
    record : without fingerprints of the outputs
    log : what the sidecar contains beside the record
    before : outputs found before the work; only these are replaced

    Returns
    -------
    ArchiveRecord
        The sidecar's record; a concurrent run may have written it.

    """
    files = _built(task, built)
    record = replace(record, outputs={name: mark_of(file) for name, file in files.items()})
    try:
        with ExitStack() as undo:
            streams = [] if isinstance(task.folder, Path) else _send(task, files, undo)
            now = find_outputs(task, read=isinstance(task.folder, Path))  # a store marks content
            if not _is_begun(now.noted, record):
                if now.noted != before.noted:
                    raise foreign(task.sidecar)
                _replace_older(task, built, now, sidecar.as_text(record, log))
            if isinstance(task.folder, Path):
                _rename(task, built, undo)
            else:
                _complete(task, streams)
                states = {name: file_state(task.folder / name)[1] for name in files}
                marks = {k: mark._replace(state=states[k]) for k, mark in record.outputs.items()}
                write(task.sidecar, sidecar.as_text(replace(record, outputs=marks), log), built)
            noted = _noted(task, record)
            undo.pop_all()
    except FilterError:
        with suppress(FilterError), ExitStack() as undo:  # the first one is raised
            if isinstance(task.folder, Path) and _is_begun(sidecar.read(task.sidecar), record):
                _rename(task, built, undo)  # a faster run has named its sidecar, perhaps not all
            noted = _noted(task, record)
            undo.pop_all()
            return noted
        raise
    return noted


def _noted(task: Task, record: ArchiveRecord) -> ArchiveRecord:
    """Return the sidecar of complete outputs, which a run at the same time may have written."""
    found = find_outputs(task)
    if found.noted is None or not _is_begun(found.noted, record):
        raise foreign(task.sidecar)
    if found.files.keys() != record.outputs.keys():
        raise foreign(task.outputs[0])
    return found.noted


def _is_alike(one: ArchiveRecord, other: ArchiveRecord) -> bool:
    """Compare input, parameters and code."""
    names = ('source', 'size', 'parameters', 'code')
    return all(getattr(one, name) == getattr(other, name) for name in names)


def _is_begun(noted: ArchiveRecord | None, record: ArchiveRecord) -> bool:
    """Return whether a sidecar lists these very files, even if some have no name yet."""
    if noted is None or not _is_alike(noted, record):
        return False
    one, other = ({k: mark.sha256 for k, mark in r.outputs.items()} for r in (noted, record))
    return one == other


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
        _complete(task, streams)
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


def _replace_older(task: Task, built: Path, now: FoundOutputs, text: str) -> None:
    """Replace older outputs by a sidecar. If that fails, all are put back.

    A store cannot put them back: they are gone, and the next run makes them anew.

    Their own sidecar goes last: it knows those that a kill leaves.
    """
    if not isinstance(task.folder, Path):
        for path in now.files.values():
            remove(path)
        write(task.sidecar, text, built)
        return
    new, marks = Path(str(task.sidecar)), now.noted.outputs if now.noted else {}
    write(built / new.name, text, built)  # a full disk refuses it before anything is moved
    with writable(built), ExitStack() as undo:
        (built / 'older').mkdir()
        for name, path in zip(task.names, task.outputs, strict=True):
            if any(f'{known}/'.startswith(f'{name}/') for known in now.files):
                moved = _files_at(_hide(path, built, undo), name)
                if not all(key in marks and agrees(moved[key], marks[key]) for key in moved):
                    raise foreign(path)  # it changed in this moment
        if now.noted and sidecar.read(_hide(new, built, undo)) != now.noted:
            raise foreign(new)
        new.parent.mkdir(parents=True, exist_ok=True)
        publish_all([built / new.name], [new])
        undo.pop_all()


def _hide(path: RecordingPath, built: Path, undo: ExitStack) -> Path:
    hidden = Path(str(path)).rename(built / 'older' / path.name)
    undo.callback(_put_back, hidden, Path(str(path)))
    return hidden


def _rename(task: Task, built: Path, undo: ExitStack) -> None:
    """Give outputs their names, but for those that another run gave to an equal output."""
    with writable(built):
        for path in task.outputs:
            hidden = built / path.name
            if isinstance(path, Path) and hidden.exists() and not exists(path):
                path.parent.mkdir(parents=True, exist_ok=True)
                publish_all([hidden], [path])
                undo.callback(_put_back, path, hidden)


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


def _complete(task: Task, streams: Sequence[Any]) -> None:
    """Give new objects their names, in their order."""
    with written(task.outputs[0]):
        for stream in streams:
            stream.commit()
