# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A run over an archive: what is done already is left, what fails costs itself only."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.archive.fingerprints import (
    content_hash,
    model_hash,
    parameters_hash,
    version,
)
from lidar_outlier_filter.archive.locations import location_of, published
from lidar_outlier_filter.archive.manifest import DONE, FAILED, NO_CLOUDS, How, begun, is_proved
from lidar_outlier_filter.archive.task import Step
from lidar_outlier_filter.disk.new_files import FOLDER, replaced, taken
from lidar_outlier_filter.errors import (
    FilterError,
    NoCloudsError,
    RecordingError,
    SchedulerError,
    said_by,
)
from lidar_outlier_filter.recordings.message_times import count_times

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from lidar_outlier_filter.archive.engine import Engine
    from lidar_outlier_filter.archive.manifest import Entry, Manifest
    from lidar_outlier_filter.archive.order import Order
    from lidar_outlier_filter.archive.task import Task
    from lidar_outlier_filter.recordings.bags import Topic
    from lidar_outlier_filter.recordings.cloud_topic import TopicReport
    from lidar_outlier_filter.recordings.remote_path import RecordingPath
    from lidar_outlier_filter.recordings.replay import ReplayReport


def pending(tasks: Sequence[Task], order: Order, manifest: Manifest) -> list[Task]:
    """Choose the recordings whose outputs the manifest does not prove."""
    how = _how(order)
    return [task for task in tasks if not is_proved(task, how, manifest)]


def replay_all(
    tasks: Sequence[Task],
    engine: Engine,
    order: Order,
    manifest: Manifest,
    show: Callable[[Step], object],
) -> list[Entry]:
    """Replay recordings, and write into the manifest what became of each.

    A recording that fails costs itself only.

    Raises
    ------
    SchedulerError
        If the scheduler goes away.

    """
    entries, how = [], _how(order)
    total, before = sum(task.location.size for task in tasks), 0
    for number, task in enumerate(tasks, 1):

        def progress(done: int, messages: int, task: Task = task, number: int = number) -> None:
            share = done / max(messages, done, 1)
            at = before + share * task.location.size  # noqa: B023  called within this turn only
            name = task.output.name
            show(Step(name, number, len(tasks), done, messages, at, total))

        progress(0, 0)
        entries.append(_replay_one(task, engine, how, manifest, progress))
        before += task.location.size
    return entries


def _replay_one(
    task: Task,
    engine: Engine,
    how: How,
    manifest: Manifest,
    progress: Callable[[int, int], object],
) -> Entry:
    began = perf_counter()
    known = manifest.has_written(task.made)
    entry = begun(task, how)
    try:
        _refuse_unknown(task.output, known=known)
        manifest.add(entry)
        entry = replace(entry, hash=content_hash(task.location))
        times = _Times()
        with _built(task.output) as output:
            report, worker = engine.replay(task, output, progress, times.note)
        entry = replace(entry, **_counted(report, times), worker=worker, state=DONE, error=None)
        made = location_of(task.output)
        entry = replace(entry, output_hash=content_hash(made), output_state=made.state)
    except SchedulerError:
        raise
    except NoCloudsError as err:
        entry = replace(entry, state=NO_CLOUDS, error=str(err))
    except FilterError as err:
        entry = replace(entry, state=FAILED, error=str(err))
    except Exception as err:  # noqa: BLE001  whatever it is, the next recording is replayed
        wrong = RecordingError(f'the recording {task.location.path}', 'replayed', said_by(err))
        entry = replace(entry, state=FAILED, error=str(wrong))
    finished = datetime.now(UTC).isoformat(timespec='seconds')
    entry = replace(entry, seconds=round(perf_counter() - began, 3), finished=finished)
    manifest.add(entry)
    return entry


def _refuse_unknown(output: RecordingPath, *, known: bool) -> None:
    """Refuse to write over what no run has written."""
    if not known and output.exists():
        raise taken(output, f'{FOLDER}, or one of the manifest')


@contextmanager
def _built(output: RecordingPath) -> Iterator[Path]:
    """Give a path to build an output at; it takes the place of an older one at the end."""
    if not isinstance(output, Path):
        if output.exists():
            output.system.rm(output.key, recursive=True)
        with published(output) as path:
            yield path
        return
    output.parent.mkdir(parents=True, exist_ok=True)
    with replaced(output) as built:
        yield built


def _how(order: Order) -> How:
    return How(parameters_hash(order.filter, **order.options), version(), model_hash())


class _Times:
    """The bag times of the clouds of each topic."""

    def __init__(self) -> None:
        self._times: dict[str, list[int]] = {}

    def note(self, topic: Topic | None, time: int) -> None:
        """Note the time of a message, ns."""
        if topic is not None:
            self._times.setdefault(topic.name, []).append(time)

    def gaps(self, topic: str) -> int:
        """Count where clouds are missing; pieces of a recording come in any order."""
        return count_times(sorted(self._times.get(topic, []))).gaps


def _counted(report: ReplayReport, times: _Times) -> dict[str, Any]:
    """Give the counts of a report as an entry has them."""
    topics = {topic.topic: _counts(topic, times.gaps(topic.topic)) for topic in report.topics}
    return {
        'topics': topics,
        'unread': report.unread,
        'lost': report.lost.said(),
        'duration': report.recorded,
    }


def _counts(topic: TopicReport, gaps: int) -> dict[str, Any]:
    return {
        'messages': topic.messages,
        'points': topic.points,
        'kept': topic.points - topic.rejected - topic.dropped,
        'rejected': topic.rejected,
        'untested': topic.untested,
        'untested_because': topic.untested_because,
        'refused': topic.refused,
        'rejected_by': dict(topic.rejected_by),
        'gaps': gaps,
    }
