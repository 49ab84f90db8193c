# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""One recording of an archive, read, judged and written by one process, here or on a worker.

The output is not under its name then: it hides in a folder of its own, or on S3 in parts. Another
attempt at the same recording spoils nothing.
"""

from __future__ import annotations

import shutil
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.archive.fingerprints import content_hash
from lidar_outlier_filter.archive.locations import listed, location_of, staged
from lidar_outlier_filter.archive.order import Made, Order, new_folder
from lidar_outlier_filter.archive.task import Task
from lidar_outlier_filter.archive.uploads import Upload, finish, upload
from lidar_outlier_filter.disk.new_files import FOLDER, publish, publish_instead
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.recordings.bags import LARGEST, writable
from lidar_outlier_filter.recordings.remote_path import written
from lidar_outlier_filter.recordings.replay import replay

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from typing import Self

    from lidar_outlier_filter.archive.locations import Location
    from lidar_outlier_filter.archive.order import NoteDone
    from lidar_outlier_filter.recordings.cloud_topic import TopicReport
    from lidar_outlier_filter.recordings.remote_path import RecordingPath
    from lidar_outlier_filter.recordings.replay import ReplayReport


@dataclass(frozen=True)
class ReplayOrder(Order[Task]):
    """What is to be done with each recording, as :func:`replay` takes it."""

    what, verb, failed, unit = 'recording', 'replayed', 'failed', 'messages'
    new, error = FOLDER, RecordingError
    judge = 'lidar_outlier_filter.recordings.replay'
    waits = False  # few shall be blamed for the death of a worker

    topics: tuple[str, ...] = ()
    parameters: Mapping[str, object] = field(default_factory=dict)
    drop_input: bool = False
    salvage: bool = False
    largest: int = LARGEST

    @property
    def values(self) -> Mapping[str, object]:
        """See :class:`Order`."""
        return self.parameters

    @property
    def options(self) -> dict[str, Any]:
        """See :class:`Order`."""
        names = ('topics', 'drop_input', 'salvage', 'largest')
        return {name: getattr(self, name) for name in names}

    def on_one_thread(self) -> Self:
        """See :class:`Order`."""
        return replace(self, parameters={**self.parameters, 'threads': 1})

    def make(
        self,
        task: Task,
        folder: Path | None,
        note: NoteDone,
        inform: Callable[[str], object],
        prefix: str = '',
    ) -> Made:
        """See :class:`Order`; without a folder, the output goes to a store."""
        began = perf_counter()
        with ExitStack() as undo:
            if folder is None:
                hidden = TemporaryDirectory(prefix='.lidar_outlier_filter-')
                built = Path(undo.enter_context(hidden), task.output.name)
            else:
                built = new_folder(folder, prefix, undo, RecordingError) / task.output.name
            known = content_hash(task.location)
            with staged(task.location) as path:
                report = replay(
                    path,
                    built,
                    parameters=self.parameters,
                    **self.options,
                    progress=lambda done, total: note(done, total, None),
                    inform=inform,
                )
            task.location.check_unchanged()
            if isinstance(task.output, Path):
                made = Made(report, built, known, content_hash(location_of(built)))
                undo.pop_all()
            else:
                made = Made(report, upload(built, task.output), known)
        return replace(made, seconds=perf_counter() - began)

    def give_names(
        self, task: Task, built: Path | Sequence[Upload], *, replaces: bool = False
    ) -> None:
        """See :class:`Order`."""
        if isinstance(built, Path) and isinstance(task.output, Path):
            with writable(task.output):
                task.output.parent.mkdir(parents=True, exist_ok=True)
                if replaces:
                    publish_instead(built, task.output, built.parent / 'older')
                else:
                    publish(built, task.output)
            shutil.rmtree(built.parent, ignore_errors=True)
        elif not isinstance(built, Path) and not isinstance(task.output, Path):
            with written(task.output):
                if replaces:
                    task.output.system.rm(task.output.key, recursive=True)
            finish(task.output, built)

    def counted(self, report: ReplayReport) -> dict[str, Any]:
        """See :class:`Order`."""
        return {
            'topics': {topic.topic: _counts(topic) for topic in report.topics},
            'unread': report.unread,
            'lost': report.lost.said(),
            'duration': report.recorded,
        }

    def made(self, _tasks: Sequence[Task], folder: RecordingPath) -> Mapping[str, Location]:
        """See :class:`Order`; a store lists all by a few requests."""
        return listed(folder)


def _counts(topic: TopicReport) -> dict[str, Any]:
    return {
        'messages': topic.messages,
        'points': topic.points,
        'kept': topic.points - topic.rejected - topic.dropped,
        'rejected': topic.rejected,
        'untested': topic.untested,
        'untested_because': topic.untested_because,
        'refused': topic.refused,
        'rejected_by': dict(topic.rejected_by),
        'gaps': topic.gaps,
    }
