# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""One recording of an archive, read, judged and written by one process, here or on a worker.

The output is not under its name then: it hides in a folder of its own, or on S3 in parts. Another
attempt at the same recording spoils nothing.
"""

from __future__ import annotations

import shutil
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from time import perf_counter
from typing import TYPE_CHECKING

from lidar_outlier_filter.archive.file_cleaners import HERE
from lidar_outlier_filter.archive.fingerprints import content_hash
from lidar_outlier_filter.archive.locations import location_of, staged
from lidar_outlier_filter.archive.uploads import Upload, finish, upload
from lidar_outlier_filter.archive.worker_start import name_of_worker
from lidar_outlier_filter.disk.new_files import publish, replaced
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.recordings.bags import writable
from lidar_outlier_filter.recordings.remote_path import written
from lidar_outlier_filter.recordings.replay import replay

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from lidar_outlier_filter.archive.order import Order
    from lidar_outlier_filter.archive.task import Task
    from lidar_outlier_filter.recordings.replay import ReplayReport


@dataclass(frozen=True)
class ReplayedRecording:
    """What was made of a recording.

    Attributes
    ----------
    report : what became of its clouds
    built : the output, which has no name yet: a folder of this machine, or what is on a store
    hash, output_hash : of recording and output; a store marks the output when it has its name
    seconds : that it took
    said : what is to be said of it
    worker, code : who replayed it, and by what, as :func:`.fingerprints.judging_code` says

    """

    report: ReplayReport
    built: Path | Sequence[Upload]
    hash: str
    output_hash: str
    seconds: float
    said: Sequence[str] = ()
    worker: str = HERE
    code: str = ''


def replay_recording(  # noqa: PLR0913  which, how, where to, and what is called meanwhile
    task: Task,
    order: Order,
    folder: Path | None,
    progress: Callable[[int, int], object],
    inform: Callable[[str], object],
    prefix: str = '',
) -> ReplayedRecording:
    """Replay a recording into a new folder within ``folder``; None: it goes to a store.

    The name of the new folder begins with ``prefix``.

    Raises
    ------
    RecordingError
        If it cannot be read, or has changed meanwhile, or the output cannot be written.

    """
    began = perf_counter()
    with ExitStack() as undo:
        own = _new_folder(folder, prefix, undo)
        known = content_hash(task.location)
        with staged(task.location) as path:
            report = replay(
                path,
                own / task.output.name,
                parameters=order.parameters,
                **order.options,
                progress=progress,
                inform=inform,
            )
        task.location.check_unchanged()
        built: Path | Sequence[Upload] = own / task.output.name
        made = content_hash(location_of(own / task.output.name))
        if not isinstance(task.output, Path):
            built, made = upload(own / task.output.name, task.output), ''
        if folder is not None:
            undo.pop_all()
    return ReplayedRecording(report, built, known, made, perf_counter() - began)


def _new_folder(folder: Path | None, prefix: str, undo: ExitStack) -> Path:
    """Make a folder that hides, for one attempt."""
    if folder is None:
        return Path(undo.enter_context(TemporaryDirectory(prefix='.lidar_outlier_filter-')))
    try:
        own = Path(mkdtemp(prefix=prefix, dir=folder))
    except OSError as err:
        must_be = f'a folder that {name_of_worker()} can write to'
        raise RecordingError(f'{folder}', must_be, f'"{err.strerror}"') from err
    undo.callback(shutil.rmtree, own, ignore_errors=True)
    return own


def give_name(task: Task, built: Path | Sequence[Upload], *, replaces: bool = False) -> None:
    """Put what was built under its name; whether it ``replaces`` an older output is known.

    Raises
    ------
    RecordingError
        If it cannot be written, or the name has been taken meanwhile.

    """
    if isinstance(built, Path) and isinstance(task.output, Path):
        with writable(task.output):
            task.output.parent.mkdir(parents=True, exist_ok=True)
            with replaced(task.output) as place:
                publish(built, place)
        shutil.rmtree(built.parent, ignore_errors=True)
    elif not isinstance(built, Path) and not isinstance(task.output, Path):
        with written(task.output):
            if replaces:
                task.output.system.rm(task.output.key, recursive=True)
        finish(task.output, built)
