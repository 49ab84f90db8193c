# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Jobs: read one recording or file, judge it, and build its outputs."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

from lidar_outlier_filter.archive.locations import Location, staged
from lidar_outlier_filter.archive.sidecar import (
    DONE,
    NO_CLOUDS,
    SUFFIX,
    ArchiveRecord,
    code_version,
    parameters_hash,
)
from lidar_outlier_filter.errors import NoCloudsError
from lidar_outlier_filter.files.clean import CleanReport, clean_file
from lidar_outlier_filter.files.judged_file import CleanOptions, JudgedFile
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.recordings.cloud_topic import TopicReport
from lidar_outlier_filter.recordings.remote_path import RecordingPath
from lidar_outlier_filter.recordings.replay import replay

Note = Callable[[float], object]  # the share that is done; may raise to stop
Inform = Callable[[str], object]

THIS_PROCESS = 'this process'  # the worker of a record
STEP_NAMES = ('reading', 'judging', 'writing')  # of a file
THE_FILE = 'the file'  # the one cloud of a file, where a recording has topics


@dataclass(frozen=True)
class Task:
    """A recording or a file, and its outputs.

    Attributes
    ----------
    location : the input
    source : its path below the folder that was searched
    folder : of all outputs
    names : paths of the outputs below it, the cleaned one first, a list of rejected points last

    """

    location: Location
    source: str
    folder: RecordingPath
    names: tuple[str, ...]

    @property
    def outputs(self) -> tuple[RecordingPath, ...]:
        """The paths of the outputs."""
        return tuple(self.folder / name for name in self.names)

    @property
    def sidecar(self) -> RecordingPath:
        """The path of the sidecar."""
        return self.folder / f'{self.names[0]}{SUFFIX}'


@dataclass(frozen=True)
class Result:
    """The result of a task.

    Attributes
    ----------
    record : of its sidecar
    log : further content of the sidecar
    report, found : of a file cleaned in this run, and the result of ``inspect``
    messages : sentences for the user

    """

    record: ArchiveRecord
    log: Mapping[str, Any] = field(default_factory=dict)
    report: CleanReport | None = None
    found: Any = None
    messages: Sequence[str] = ()


@dataclass(frozen=True)
class Job(ABC):
    """What is done with each task; it is sent to the workers.

    Attributes
    ----------
    what, done, failed : the words for an input and its states
    parameters : of the filter, by flat name
    options : other values that decide the bytes of an output: the arguments of :func:`replay`, or
        the fields of :class:`CleanOptions`
    inspect : called with each judged file

    """

    what: ClassVar[str]
    done: ClassVar[str]
    failed: ClassVar[str]

    parameters: Mapping[str, object]
    options: Mapping[str, Any]
    inspect: Callable[[JudgedFile], object] | None = None

    @property
    def dry(self) -> bool:
        """Whether nothing is written."""
        return bool(self.options.get('dry'))

    @property
    def filter(self) -> FilterParameters:
        """All parameters."""
        return FilterParameters().changed(self.parameters)

    @cached_property
    def fingerprint(self) -> str:
        """The hash of parameters and options."""
        return parameters_hash(self.filter, self.options)

    def goal(self, task: Task) -> ArchiveRecord:
        """Return the record that the outputs of a task must have to be done."""
        return ArchiveRecord(
            task.source,
            task.names[0],
            task.location.size,
            task.location.state,
            parameters=self.fingerprint,
            code=code_version(),
            worker=THIS_PROCESS,
        )

    @abstractmethod
    def make(
        self, task: Task, folder: Path, record: ArchiveRecord, note: Note, inform: Inform
    ) -> Result:
        """Build the outputs of a task in a folder."""


class ReplayJob(Job):
    """Replays recordings."""

    what, done, failed = 'recording', 'replayed', 'failed'

    def make(
        self, task: Task, folder: Path, record: ArchiveRecord, note: Note, inform: Inform
    ) -> Result:
        """Replay a recording."""
        try:
            with staged(task.location) as path:
                report = replay(
                    path,
                    folder / task.outputs[0].name,
                    parameters=self.parameters,
                    **self.options,
                    progress=lambda done, total: note(done / max(done, total, 1)),
                    inform=inform,
                )
        except NoCloudsError as err:
            return Result(replace(record, state=NO_CLOUDS, error=str(err)))
        counted = replace(
            record,
            state=DONE,
            topics={topic.topic: _counts(topic) for topic in report.topics},
            unread=report.unread,
            lost=report.lost.said(),
            duration=report.recorded,
        )
        return Result(counted)


def _counts(topic: TopicReport) -> dict[str, Any]:
    names = ('messages', 'points', 'rejected', 'untested', 'invalid', 'refused', 'gaps')
    return {
        **{name: getattr(topic, name) for name in (*names, 'untested_because')},
        'methods': list(topic.methods),
        'kept': topic.points - topic.rejected - topic.dropped,
        'rejected_by': dict(topic.rejected_by),
    }


class CleanJob(Job):
    """Cleans files."""

    what, done, failed = 'file', 'cleaned', 'refused'

    def make(
        self, task: Task, folder: Path, record: ArchiveRecord, note: Note, inform: Inform
    ) -> Result:
        """Clean a file."""
        path, found = Path(str(task.location.path)), list[object]()
        output, *others = (Path(str(one)) for one in task.outputs)
        listed = others.pop() if self.options['reasons'] else None

        @contextmanager
        def hidden(paths: Sequence[Path]) -> Iterator[list[Path]]:
            yield [folder / path.name for path in paths]

        def progress(done: int, total: int, step: str) -> None:
            note((STEP_NAMES.index(step) + done / max(total, 1)) / len(STEP_NAMES))

        def inspect(judged: JudgedFile) -> None:
            if self.inspect is not None:
                found.append(self.inspect(judged))

        report = clean_file(
            path,
            output,
            self.filter,
            CleanOptions(**self.options),
            outliers=next(iter(others), None),
            rejected=listed,
            progress=progress,
            slow=lambda detector: inform(f'{path}: {detector}'),
            inspect=inspect,
            make=hidden,
        )
        counted = replace(record, state=DONE, topics={THE_FILE: _count_file(report)})
        return Result(counted, asdict(report), report, next(iter(found), None))


def _count_file(report: CleanReport) -> dict[str, Any]:
    """Count a file as a recording with one cloud."""
    names = ('points', 'rejected', 'untested', 'invalid', 'ignored', 'spared')
    untested = f'{" and ".join(report.chain)} could test none' if report.is_untested else ''
    return {
        **{name: getattr(report, name) for name in names},
        'messages': 1,
        'kept': report.points - report.rejected,
        'refused': 0,
        'gaps': 0,
        'rejected_by': dict(report.rejected_by),
        'untested_because': untested,
    }
