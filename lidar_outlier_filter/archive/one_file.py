# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""One point cloud of many that are files, cleaned by one process, here or on a worker.

The outputs hide in a folder of their own then. Another attempt at the same file spoils nothing.
"""

from __future__ import annotations

import shutil
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.archive.fingerprints import content_hash
from lidar_outlier_filter.archive.locations import location_of
from lidar_outlier_filter.archive.manifest import BROKEN_OFF
from lidar_outlier_filter.archive.order import Made, Order, new_folder
from lidar_outlier_filter.archive.task import Task
from lidar_outlier_filter.disk.new_files import FILE, new_files, publish_all
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.clean import clean_file, log_of
from lidar_outlier_filter.parameters.filter import FilterParameters

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from typing import Self

    from lidar_outlier_filter.annotations import Progress
    from lidar_outlier_filter.archive.locations import Location
    from lidar_outlier_filter.archive.manifest import Manifest
    from lidar_outlier_filter.archive.order import NoteDone
    from lidar_outlier_filter.core.engine.slow import SlowDetector
    from lidar_outlier_filter.files.clean import CleanReport
    from lidar_outlier_filter.files.judged_file import CleanOptions, JudgedFile
    from lidar_outlier_filter.recordings.remote_path import RecordingPath

PARTS = ('reading', 'judging', 'writing')  # of the work on a file
WHOLE = 'the file'  # what a manifest calls the one cloud of a file


@dataclass(frozen=True)
class FileTask(Task):
    """A file, and the clouds that are made of it; ``outliers`` is that of the rejected points."""

    outliers: Path | None = None

    @property
    def path(self) -> Path:
        """The file."""
        return Path(str(self.location.path))

    @property
    def cleaned(self) -> Path:
        """The cloud that is always made."""
        return Path(str(self.output))

    @property
    def outputs(self) -> Sequence[Path]:
        """See :class:`Task`."""
        clouds = [self.cleaned] if self.outliers is None else [self.cleaned, self.outliers]
        return [*clouds, log_of(self.cleaned)]

    @property
    def label(self) -> str:
        """See :class:`Task`."""
        is_beside = self.path.parent == self.cleaned.parent
        return self.path.name if is_beside else self.source

    def absolute(self) -> Self:
        """See :class:`Task`."""
        outliers = None if self.outliers is None else self.outliers.absolute()
        return replace(super().absolute(), outliers=outliers)


@dataclass(frozen=True)
class CleanOrder(Order[FileTask]):
    """What is wanted of each file; ``look`` is called before anything is written of it."""

    what, verb, failed, unit = 'file', 'cleaned', 'refused', 'points'
    new, error = FILE, CloudError
    judge = 'lidar_outlier_filter.files.clean'
    waits = True

    parameters: Mapping[str, object]
    wanted: CleanOptions
    look: Callable[[JudgedFile], object] = bool

    @property
    def values(self) -> Mapping[str, object]:
        """See :class:`Order`."""
        return self.parameters

    @property
    def options(self) -> dict[str, Any]:
        """See :class:`Order`."""
        return asdict(self.wanted)

    def on_one_thread(self) -> Self:
        """See :class:`Order`."""
        return replace(self, parameters={**self.parameters, 'threads': 1})

    def make(
        self,
        task: FileTask,
        folder: Path | None,
        note: NoteDone,
        inform: Callable[[str], object],
        prefix: str = '',
    ) -> Made:
        """See :class:`Order`; without a folder, all is under its name at once, as is nothing."""
        began = perf_counter()
        found: list[object] = []

        def slow(detector: SlowDetector) -> None:
            inform(f'{task.path}: {detector}')

        def look(judged: JudgedFile) -> None:
            found.append(self.look(judged))

        def cleaned(make: Callable[..., Any] = new_files) -> CleanReport:
            return clean_file(
                task.path,
                task.cleaned,
                FilterParameters().changed(self.parameters),
                self.wanted,
                outliers=task.outliers,
                progress=_shared(note),
                slow=slow,
                inspect=look,
                make=make,
            )

        if folder is None:
            return Made(cleaned(), [], found=found[0], seconds=perf_counter() - began)
        with ExitStack() as undo:
            own = new_folder(folder, prefix, undo, CloudError)

            @contextmanager
            def within(paths: Sequence[Path]) -> Iterator[list[Path]]:
                yield [own / path.name for path in paths]

            report = cleaned(within)  # whoever opens a file that is not there says so
            known = content_hash(task.location)
            task.location.check_unchanged(self.what)
            built = [own / path.name for path in task.outputs]
            output = content_hash(location_of(built[0]))
            undo.pop_all()
        return Made(report, built, known, output, perf_counter() - began, found[0])

    def give_names(self, task: FileTask, built: Sequence[Path], *, replaces: bool = False) -> None:
        """See :class:`Order`."""
        if not built:
            return
        task.cleaned.parent.mkdir(parents=True, exist_ok=True)
        for path in task.outputs if replaces else ():
            path.unlink(missing_ok=True)
        publish_all(built, task.outputs)
        shutil.rmtree(built[0].parent, ignore_errors=True)

    def counted(self, report: CleanReport) -> dict[str, Any]:
        """See :class:`Order`: as those of a topic with one cloud."""
        untested = f'{" and ".join(report.chain)} could test none' if report.is_untested else ''
        names = ('points', 'rejected', 'untested', 'invalid', 'ignored', 'spared')
        counts = {
            'messages': 1,
            'kept': report.points - report.rejected,
            'refused': 0,
            'gaps': 0,
            'rejected_by': dict(report.rejected_by),
            'untested_because': untested,
        }
        return {'topics': {WHOLE: counts | {name: getattr(report, name) for name in names}}}

    def made(self, tasks: Sequence[FileTask], _folder: RecordingPath) -> Mapping[str, Location]:
        """See :class:`Order`; an output is there with all that belongs to it."""
        whole = (task for task in tasks if all(path.is_file() for path in task.outputs))
        return {str(task.output): location_of(task.output) for task in whole}

    def is_ours(self, task: FileTask, manifest: Manifest) -> bool:
        """See :class:`Order`; what was changed by hand is no longer."""
        known = manifest.writer(task.made)
        if known is None or known.error == BROKEN_OFF or not task.cleaned.exists():
            return known is not None
        return content_hash(location_of(task.output)) == known.output_hash


def _shared(note: NoteDone) -> Progress:
    """Give what notes the share of a part of the work in the whole."""

    def progress(done: int, total: int, part: str) -> None:
        # In one piece nobody knows how far the judging is.
        note(done, total, (PARTS.index(part) + done / max(total, 1)) / len(PARTS))

    return progress
