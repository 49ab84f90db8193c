# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A cloud that is a file: read, judged, copied with the verdict, counted and logged."""

from __future__ import annotations

import json
import math
import os
from contextlib import contextmanager
from datetime import UTC, datetime
from itertools import count
from typing import TYPE_CHECKING, Any

import numpy as np

from lidar_outlier_filter.core.detectors import registry
from lidar_outlier_filter.disk.new_files import hidden_folder, new_files
from lidar_outlier_filter.errors import CloudError, ParameterError, said_by
from lidar_outlier_filter.files import cloud_file
from lidar_outlier_filter.files.cleaning.clean_log import (
    CLASS,
    MARK,
    SEPARATE,
    WITHHELD,
    CleanReport,
    as_text,
    as_values,
    settings,
    versions,
)
from lidar_outlier_filter.files.cleaning.judged_file import judge_file, timed
from lidar_outlier_filter.files.cleaning.points import say_coarse
from lidar_outlier_filter.files.cloud_file import Change, open_cloud
from lidar_outlier_filter.messages.cloud import DETECTORS, REASON, SCORE
from lidar_outlier_filter.parameters.filter import FilterParameters

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from contextlib import AbstractContextManager
    from pathlib import Path

    from lidar_outlier_filter.annotations import Progress
    from lidar_outlier_filter.core.engine.slow import SaySlow
    from lidar_outlier_filter.files.cleaning.clean_log import Wanted
    from lidar_outlier_filter.files.cleaning.judged_file import JudgedFile
    from lidar_outlier_filter.files.cloud_file import CloudFile

    MakeFiles = Callable[[Sequence[Path]], AbstractContextManager[list[Path]]]
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Allocate
    from lidar_outlier_filter.core.verdict import Verdict

OUTLIER = 'outlier'


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
    path : LAS, LAZ, PCD, PLY, PTX, E57, CSV, Parquet, or an SQLite database
    output : new file of the same format (LAS and LAZ are one; PLY of E57); the log goes beside
        it, under the same name with ``.log`` and ``.json``
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
    clouds = list_clouds(file, output, outliers, wanted)
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
    for change, target in zip(changes(judged), built, strict=True):
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


def list_clouds(file: CloudFile, output: Path, outliers: Path | None, wanted: Wanted) -> list[Path]:
    """List the clouds to be written.

    Raises
    ------
    CloudError
        If one cannot be, or what is wanted cannot be done with the file.

    """
    if wanted.rejected != MARK and file.whole:
        must_be = f'{MARK!r} for {file.path}: {file.whole}'
        raise CloudError('what becomes of rejected points', must_be, repr(wanted.rejected))
    if wanted.mark != CLASS and not (file.classes and wanted.rejected == MARK):
        must_be = f'{CLASS!r}, unless points of LAS and LAZ are marked'
        raise CloudError('how rejected points are marked', must_be, repr(wanted.mark))
    if wanted.rejected == SEPARATE and outliers is None:
        raise CloudError('the file for the outliers', 'given, to separate them', 'none')
    if wanted.rejected != SEPARATE and outliers is not None:
        must_be = f'{SEPARATE!r} where they have a file'
        raise CloudError('what becomes of rejected points', must_be, repr(wanted.rejected))
    clouds = [output] if outliers is None else [output, outliers]
    for cloud in clouds:
        if cloud.name.lower().endswith('.copc.laz'):
            must_be = 'LAZ without an octree, of which untwine or PDAL makes COPC'
            raise CloudError('the output', must_be, cloud)
        if not cloud_file.is_copy_format(file.path, cloud):
            name = file.path.with_suffix(cloud_file.copy_suffix(file.path)).name
            raise CloudError('the output', f'in the format of {name}', cloud)
    return clouds


def changes(judged: JudgedFile) -> list[Change]:
    """Say in what each of the clouds to be written differs from the file."""
    verdict, wanted = judged.verdict, judged.wanted
    scores: dict[str, NDArray[Any]] = {SCORE: verdict.score, DETECTORS: verdict.detectors}
    if judged.parameters.scores:
        scores[REASON] = verdict.reason
    added = scores if judged.parameters.scores else {}
    if wanted.rejected == MARK and not judged.file.gaps:
        if judged.file.classes:
            return [_marked(judged, added)]
        return [Change(added={OUTLIER: verdict.rejected.astype(np.uint8), **scores})]
    cleaned = Change(keep=~verdict.rejected, added=added)
    if wanted.rejected != SEPARATE:
        return [cleaned]
    return [cleaned, Change(keep=verdict.rejected, added=added)]


def _marked(judged: JudgedFile, added: Mapping[str, NDArray[Any]]) -> Change:
    """Say how the rejected points of a LAS file are marked."""
    rejected = judged.verdict.rejected
    if judged.wanted.mark == WITHHELD:
        return Change(withheld=rejected, added=added)
    if judged.wanted.mark == CLASS:
        return Change(noise=rejected, added=added)
    high = np.zeros(len(rejected), np.bool_)
    high[rejected] = judged.high
    return Change(noise=rejected & ~high, high=high, added=added)


def report_of(
    judged: JudgedFile, clouds: Sequence[Path], started: datetime, seconds: Mapping[str, float]
) -> CleanReport:
    """Say what became of a judged file, of which these clouds were written."""
    file, wanted, loaded = judged.file, judged.wanted, judged.loaded
    return CleanReport(
        input=str(file.path),
        outputs=tuple(str(cloud) for cloud in clouds),
        started=started.isoformat(timespec='seconds'),
        settings=settings(file.path, wanted)['settings'],
        rejected_points=wanted.rejected,
        coordinates=judged.coordinates,
        tile=wanted.tile,
        metres=judged.metres,
        lines=loaded.lines,
        lack=loaded.lack,
        rings=loaded.rings,
        coarse=say_coarse(file, judged.coordinates, loaded.points, judged.metres),
        chain=judged.parameters.chain,
        **_counts(judged.verdict, loaded.points.valid, judged.ignored, judged.parameters),
        spared=int(np.count_nonzero(judged.everything.rejected & ~judged.verdict.rejected)),
        by_class=judged.by_class,
        low=int(np.count_nonzero(~judged.high)),
        high=int(np.count_nonzero(judged.high)),
        left_low=judged.left_low,
        seconds=seconds,
        versions=versions(),
        parameters=judged.parameters.flat(),
    )


def _counts(
    verdict: Verdict, valid: NDArray[np.bool_], ignored: int, parameters: FilterParameters
) -> dict[str, Any]:
    """Count the points, all and by detector."""

    def by_name(bits: NDArray[np.uint16], names: Sequence[str]) -> dict[str, int]:
        return {name: int(np.count_nonzero(bits & registry.bits()[name])) for name in names}

    return {
        'points': len(valid),
        'invalid': int(np.count_nonzero(~valid & ~verdict.masked)) - ignored,
        'ignored': ignored,
        'untested': int(np.count_nonzero(np.isnan(verdict.score[valid]))),
        'rejected': int(np.count_nonzero(verdict.rejected)),
        'rejected_by': by_name(verdict.detectors, registry.rejecting(parameters)),
        'extra': {
            name: int(np.count_nonzero(verdict.detectors & bit))
            for one in registry.DETECTORS.values()
            for bit, name in one.extra.items()
        },
        'undecided_by': by_name(verdict.undecided, parameters.chain),
    }


@contextmanager
def scratch(output: Path, tile: float) -> Iterator[Allocate]:
    """Give what makes arrays: in memory or, for tiles, in files beside the output."""
    if not 0 <= tile < np.inf:
        raise ParameterError('--tile', 'at least 0 and finite', tile)
    if tile == 0:
        yield np.empty
        return
    with hidden_folder(output, 'points') as folder:
        numbers = count()

        def allocate(shape: tuple[int, ...]) -> NDArray[np.float64]:
            path = folder / str(next(numbers))
            _reserve(path, 8 * math.prod(shape))
            return np.asarray(np.memmap(path, np.float64, 'r+', shape=shape))

        yield allocate


def _reserve(path: Path, size: int) -> None:
    """Make a file of so many bytes; a full disk says so here."""
    try:
        with path.open('wb') as stream:
            if size and hasattr(os, 'posix_fallocate'):
                os.posix_fallocate(stream.fileno(), 0, size)
            stream.truncate(max(1, size))
    except OSError as err:
        must_be = f'able to hold {size} bytes beside the output, for the tiles'
        raise CloudError('the disk', must_be, f'"{err.strerror}"') from err
