# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Many files cleaned by one call, several at once: what is done is left, each fails for itself.

The manifest is that of an archive.
"""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.archive.file_cleaners import JUDGE
from lidar_outlier_filter.archive.fingerprints import (
    content_hash,
    model_hash,
    parameters_hash,
    version,
)
from lidar_outlier_filter.archive.locations import location_of
from lidar_outlier_filter.archive.manifest import BROKEN_OFF, DONE, FAILED, How, begun
from lidar_outlier_filter.archive.proof import is_proved
from lidar_outlier_filter.archive.task import Task
from lidar_outlier_filter.archive.work import work_through
from lidar_outlier_filter.disk.new_files import FILE, taken
from lidar_outlier_filter.errors import CloudError, FilterError, SchedulerError, said_by
from lidar_outlier_filter.files.cleaning.clean import list_logs
from lidar_outlier_filter.parameters.filter import FilterParameters

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from lidar_outlier_filter.archive.file_cleaners import CleanedFile, Job
    from lidar_outlier_filter.archive.manifest import Entry, Manifest
    from lidar_outlier_filter.archive.work import Hands
    from lidar_outlier_filter.files.cleaning.clean_log import CleanReport, Wanted

LEFT = 'done before'


@dataclass(frozen=True)
class Result:
    """What became of a file: its report and what was found where it was cleaned now; why not."""

    job: Job
    state: str
    report: CleanReport | None = None
    error: str = ''
    found: Any = None


class ManyFiles:
    """Files that are cleaned in the same way."""

    def __init__(
        self,
        wanted: Wanted,
        manifest: Manifest | None = None,
        *,
        resume: bool = False,
    ) -> None:
        """Note how to clean.

        With a manifest, what becomes of each file is written there. With ``resume``, what it proves
        to be done is left, and what a killed run has left of an output is replaced.
        """
        self._manifest, self._resume = manifest, resume
        self.results: dict[Path, Result] = {}  # so far
        values = FilterParameters().changed(wanted.parameters)
        options = {k: v for k, v in asdict(wanted).items() if k != 'parameters'}
        self._how = How(parameters_hash(values, **options), version(JUDGE), model_hash())

    def run(
        self,
        jobs: Sequence[Job],
        cleaners: Hands[Job],
        tick: Callable[[], object],
        finished: Callable[[Job], object],
    ) -> list[Result]:
        """Clean files; the results are in their order.

        ``tick`` is called now and then, and may leave by an exception.

        Raises
        ------
        SchedulerError
            If the scheduler goes away.

        """
        _check_outputs(jobs)
        results = self.results = {}
        entries: dict[Path, Entry | None] = {}

        def begin(job: Job) -> bool:
            noted = self._begin(job)
            if not isinstance(noted, Result):
                entries[job.path] = noted
                return True
            results[job.path] = noted
            finished(job)
            return False

        def end(job: Job, take: Callable[[], CleanedFile]) -> None:
            results[job.path] = self._end(job, entries.pop(job.path), take)
            finished(job)

        work_through(jobs, cleaners, begin, lambda: None, end, tick)
        return [results[job.path] for job in jobs]

    def _begin(self, job: Job) -> Entry | Result | None:
        """Note that a file is begun; None: there is no manifest. A result: it need not be."""
        if self._manifest is None:
            return None
        try:
            task = Task(location_of(job.path.absolute()), job.output)
        except (FilterError, OSError):
            return None  # whoever opens it says what is wrong
        if self._resume and self._is_done(task, job):
            return Result(job, LEFT, error=f'is done already: {job.output}')
        known = self._manifest.entries.get(task.source)
        ours = known is not None and (known.error, known.output) == (BROKEN_OFF, task.made)
        for path in job.outputs:
            if not os.path.lexists(path):
                continue
            if not (self._resume and ours):
                return Result(job, FAILED, error=str(self._exists(path)))
            path.unlink()
        entry = begun(task, self._how)
        self._manifest.add(entry)
        return entry

    def _exists(self, path: Path) -> FilterError:
        must_be = FILE
        if self._resume:
            must_be += ', or one of this version, made of the same file with the same options'
        return taken(path, must_be, CloudError)

    def _is_done(self, task: Task, job: Job) -> bool:
        """Return whether the manifest proves a file to be cleaned in this way."""
        if self._manifest is None:
            return False
        others = [] if job.outliers is None else [job.outliers]
        made = (job.output, *others, *list_logs(job.output))
        return all(path.is_file() for path in made) and is_proved(
            task, self._how, self._manifest, location_of(job.output)
        )

    def _end(self, job: Job, entry: Entry | None, take: Callable[[], CleanedFile]) -> Result:
        """Note what became of a file."""
        cleaned = None
        try:
            cleaned = take()
            result = Result(job, DONE, cleaned.report, found=cleaned.found)
        except SchedulerError:
            raise
        except FilterError as err:
            result = Result(job, FAILED, error=str(err))
        except Exception as err:  # noqa: BLE001  whatever it is, the next file is cleaned
            wrong = CloudError(f'the file {job.path}', 'cleaned', said_by(err))
            result = Result(job, FAILED, error=str(wrong))
        if entry is None or self._manifest is None:
            return result
        finished = datetime.now(UTC).isoformat(timespec='seconds')
        entry = replace(entry, state=result.state, error=result.error or None, finished=finished)
        if cleaned is not None:
            entry = _proved(entry, cleaned, job)
        self._manifest.add(entry)
        return result


def _proved(entry: Entry, cleaned: CleanedFile, job: Job) -> Entry:
    """Add to the entry of a file what it holds, and what was made of it."""
    report = cleaned.report
    if not report.outputs:
        return entry
    source, made = location_of(job.path.resolve()), location_of(job.output.resolve())
    changed = (source.size, source.state) != (entry.size, entry.source_state)
    return replace(
        entry,
        hash='' if changed else content_hash(source),  # no output is proved to be of such a file
        topics={'points': _counted(report)},
        seconds=round(sum(report.seconds.values()), 3),
        output_hash=content_hash(made),
        output_state=made.state,
        worker=cleaned.worker,
    )


def _counted(report: CleanReport) -> dict[str, Any]:
    """Give the counts of a report as those of a topic with one cloud."""
    return {
        'messages': 1,
        'points': report.points,
        'kept': report.points - report.rejected,
        'rejected': report.rejected,
        'untested': report.untested,
        'refused': 0,
        'rejected_by': dict(report.rejected_by),
        'gaps': 0,
    }


def _check_outputs(jobs: Sequence[Job]) -> None:
    """Refuse two files with one output."""
    known: dict[Path, Path] = {}
    for job in jobs:
        if job.output in known:
            got = f'{known[job.output]} and {job.path}'
            raise CloudError(f'the output {job.output}', 'that of one file', got)
        known[job.output] = job.path
