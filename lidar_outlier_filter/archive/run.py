# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A run over an archive: what is done already is left, what fails costs itself only."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from time import perf_counter
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.archive.fingerprints import model_hash, parameters_hash, version
from lidar_outlier_filter.archive.locations import listed, location_of
from lidar_outlier_filter.archive.manifest import DONE, NO_CLOUDS, How, begun
from lidar_outlier_filter.archive.one_recording import give_name
from lidar_outlier_filter.archive.proof import is_proved
from lidar_outlier_filter.archive.step import Progress
from lidar_outlier_filter.archive.work import work_through
from lidar_outlier_filter.disk.new_files import FOLDER, taken
from lidar_outlier_filter.errors import (
    FilterError,
    NoCloudsError,
    RecordingError,
    SchedulerError,
    said_by,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from lidar_outlier_filter.archive.manifest import Entry, Manifest
    from lidar_outlier_filter.archive.one_recording import ReplayedRecording
    from lidar_outlier_filter.archive.order import Order
    from lidar_outlier_filter.archive.replayers import Replaying
    from lidar_outlier_filter.archive.task import Task
    from lidar_outlier_filter.recordings.cloud_topic import TopicReport
    from lidar_outlier_filter.recordings.replay import ReplayReport


def pending(tasks: Sequence[Task], order: Order, manifest: Manifest) -> list[Task]:
    """Choose the recordings whose outputs the manifest does not prove."""
    how, made = _how(order), listed(manifest.folder)
    return [
        task for task in tasks if not is_proved(task, how, manifest, made.get(str(task.output)))
    ]


def replay_all(
    tasks: Sequence[Task], order: Order, manifest: Manifest, by: Replaying
) -> list[Entry]:
    """Replay recordings, and write into the manifest what became of each.

    A recording that fails costs itself only.

    Raises
    ------
    SchedulerError
        If the scheduler goes away.

    """
    progress = Progress({task.source: task.location.size for task in tasks})
    run = _Run(_how(order), manifest, progress)
    tick = by.tick(progress)
    hands = by.hands(order, progress, tick)
    work_through(tasks, hands, run.begin, manifest.flush, run.end, tick)
    return [manifest.entries[task.source] for task in tasks]


def replay_alone(task: Task, order: Order, by: Replaying) -> ReplayReport:
    """Replay a single recording, without a manifest.

    Raises
    ------
    FilterError
        If it cannot be replayed, or something has the name of the output.

    """
    if task.output.exists():
        raise taken(task.output, FOLDER)
    progress = Progress({task.source: task.location.size})
    found: list[ReplayedRecording] = []

    def end(_task: Task, take: Callable[[], ReplayedRecording]) -> None:
        found.append(take())
        give_name(task, found[0].built)

    tick = by.tick(progress)
    hands = by.hands(order, progress, tick)
    work_through([task], hands, lambda _task: True, lambda: None, end, tick)
    return replace(found[0].report, output=task.output)


class _Run:
    """Notes of each recording that it is begun, and what became of it."""

    def __init__(self, how: How, manifest: Manifest, progress: Progress) -> None:
        self._how, self._manifest, self._progress = how, manifest, progress
        self._begun: dict[Task, tuple[Entry, float, bool]] = {}

    def begin(self, task: Task) -> bool:
        """Note that a recording is begun; return whether its output may have its name."""
        entry, began = begun(task, self._how), perf_counter()
        try:
            is_there = task.output.exists()
            if is_there and not self._manifest.has_written(task.made):
                raise taken(task.output, f'{FOLDER}, or one of the manifest')
        except FilterError as err:
            self._note(replace(entry, error=str(err)), began)
            return False
        self._manifest.add(entry)
        self._begun[task] = entry, began, is_there
        return True

    def end(self, task: Task, take: Callable[[], ReplayedRecording]) -> None:
        """Note what became of a recording, whose output gets its name."""
        entry, began, replaces = self._begun.pop(task)
        try:
            found = take()
            give_name(task, found.built, replaces=replaces)
            self._note(_done(entry, task, found), began)
        except SchedulerError:
            raise
        except NoCloudsError as err:
            self._note(replace(entry, state=NO_CLOUDS, error=str(err)), began)
        except FilterError as err:
            self._note(replace(entry, error=str(err)), began)
        except Exception as err:  # noqa: BLE001  whatever it is, the next recording is replayed
            wrong = RecordingError(f'the recording {task.location.path}', 'replayed', said_by(err))
            self._note(replace(entry, error=str(wrong)), began)

    def _note(self, entry: Entry, began: float) -> None:
        finished = datetime.now(UTC).isoformat(timespec='seconds')
        seconds = entry.seconds or round(perf_counter() - began, 3)
        entry = replace(entry, seconds=seconds, finished=finished)
        self._manifest.add(entry)
        self._progress.finish(entry.source)


def _done(entry: Entry, task: Task, found: ReplayedRecording) -> Entry:
    """Say in the entry of a recording what was made of it."""
    made = location_of(task.output)
    return replace(
        entry,
        **_counted(found.report),
        hash=found.hash,
        output_hash=found.output_hash or made.state,
        output_state=made.state,
        worker=found.worker,
        seconds=round(found.seconds, 3),
        state=DONE,
        error=None,
    )


def _how(order: Order) -> How:
    return How(parameters_hash(order.filter, **order.options), version(), model_hash())


def _counted(report: ReplayReport) -> dict[str, Any]:
    """Give the counts of a report as an entry has them."""
    return {
        'topics': {topic.topic: _counts(topic) for topic in report.topics},
        'unread': report.unread,
        'lost': report.lost.said(),
        'duration': report.recorded,
    }


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
