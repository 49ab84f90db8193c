# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A cloud that is a file: read, judged as a whole, copied with the verdict, and logged."""

from __future__ import annotations

import json
from contextlib import contextmanager
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from lidar_outlier_filter.disk.new_files import new_files
from lidar_outlier_filter.disk.scratch import scratch
from lidar_outlier_filter.errors import CloudError, said_by
from lidar_outlier_filter.files import cloud_file
from lidar_outlier_filter.files.cleaning import clean_outputs
from lidar_outlier_filter.files.cleaning.clean_log import CleanReport, as_text, as_values
from lidar_outlier_filter.files.cleaning.clean_report import report_of
from lidar_outlier_filter.files.cleaning.judged_file import judge_file, timed
from lidar_outlier_filter.files.cloud_file import open_cloud
from lidar_outlier_filter.parameters.filter import FilterParameters

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from contextlib import AbstractContextManager
    from pathlib import Path

    from lidar_outlier_filter.annotations import Progress
    from lidar_outlier_filter.core.judging.slow import SaySlow
    from lidar_outlier_filter.files.cleaning.clean_log import Wanted
    from lidar_outlier_filter.files.cleaning.judged_file import JudgedFile
    from lidar_outlier_filter.files.cloud_file import CloudFile

    MakeFiles = Callable[[Sequence[Path]], AbstractContextManager[list[Path]]]


def clean(  # noqa: PLR0913  what is wanted, three callbacks, and who makes the files
    path: Path,
    output: Path,
    wanted: Wanted,
    outliers: Path | None = None,
    progress: Progress = lambda _done, _total, _what: None,
    slow: SaySlow | None = None,
    look: Callable[[JudgedFile], object] = bool,
    make: MakeFiles = new_files,
) -> CleanReport:
    """Judge the points of a file, and write a copy that says or shows which are rejected.

    Parameters
    ----------
    path : LAS, LAZ, PCD, PLY, CSV, Parquet, or an SQLite database
    output : new file of the same format (LAS and LAZ are one); the log goes beside it, under the
        same name with ``.log`` and ``.json``
    wanted : what to do
    outliers : new file for the rejected points, where they are separated
    progress : is called with how many of how many points, and what is done with them
    slow : is called while a detector takes more than 10 × ``max_delay``
    look : is called with what was found, before anything is written
    make : gives the paths that new files are written to

    Raises
    ------
    CloudError
        If the file cannot be read, or what is wanted cannot be done with it.
    ParameterError
        If a parameter makes no sense.

    """
    parameters = FilterParameters().changed(wanted.parameters)
    started = datetime.now(UTC)
    file = open_cloud(path, wanted.table)
    clouds = clean_outputs.list_clouds(file, output, outliers, wanted)
    logs = list_logs(output)
    if wanted.dry:
        clouds, logs = [], []
    with (
        _enough_memory(file),
        make([*clouds, *logs]) as built,
        scratch(built[0] if built else output, wanted.tile) as allocate,
    ):
        judged = judge_file(file, wanted, parameters, allocate, progress, slow)
        look(judged)
        seconds = dict(judged.seconds)
        with timed(seconds, 'write'):
            _write_clouds(judged, built[: len(clouds)], progress)
        report = report_of(judged, clouds, started, seconds)
        _write_logs(report, built[len(clouds) :], logs)
    return report


def list_logs(output: Path) -> list[Path]:
    """List the logs that are written beside an output: as text, and as JSON."""
    return [output.with_name(output.name + suffix) for suffix in ('.log', '.json')]


def _write_clouds(judged: JudgedFile, built: Sequence[Path], progress: Progress) -> None:
    """Write the clouds; none in a dry run."""
    if not built:
        return
    file = judged.file
    for change, target in zip(clean_outputs.changes(judged), built, strict=True):
        for done in cloud_file.copy(file, target, change):
            progress(min(done, len(file)), len(file), 'writing')


def _write_logs(report: CleanReport, built: Sequence[Path], logs: Sequence[Path]) -> None:
    """Write the report as text and as JSON; nowhere in a dry run."""
    texts = (as_text(report), json.dumps(as_values(report), indent=2) + '\n')
    for text, target, log in zip(texts, built, logs, strict=False):
        try:
            target.write_text(text, encoding='utf-8', errors='surrogateescape')
        except OSError as err:
            raise CloudError(f'the output {log}', 'written in full', said_by(err)) from err


@contextmanager
def _enough_memory(file: CloudFile) -> Iterator[None]:
    try:
        yield
    except MemoryError as err:
        must_be = 'small enough for the memory, or judged in tiles (--tile)'
        raise CloudError(f'the cloud {file.path}', must_be, f'{len(file)} points') from err
