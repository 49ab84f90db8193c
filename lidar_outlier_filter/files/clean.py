# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A cloud that is a file: read, judged as a whole, copied with the verdict, and logged."""

from __future__ import annotations

import json
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import partial
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from lidar_outlier_filter.core.chain import uses_lines
from lidar_outlier_filter.core.detectors.registry import BITS
from lidar_outlier_filter.core.heights import is_high
from lidar_outlier_filter.core.tiled_chain import TiledChain
from lidar_outlier_filter.core.verdict import SECOND_PHASE, Verdict
from lidar_outlier_filter.core.whole_cloud import check_chain, judge_whole
from lidar_outlier_filter.errors import CloudError, said_by
from lidar_outlier_filter.files import classes, cloud_file, points
from lidar_outlier_filter.files.clean_log import (
    CLASS,
    MARK,
    REMOVE,
    SEPARATE,
    WITHHELD,
    CleanReport,
    Wanted,
    as_text,
    settings,
    versions,
)
from lidar_outlier_filter.files.cloud_file import Change, open_cloud
from lidar_outlier_filter.files.new_files import new_files
from lidar_outlier_filter.files.scratch import scratch
from lidar_outlier_filter.messages.cloud import DETECTORS, REASON, SCORE
from lidar_outlier_filter.parameters.filter import FilterParameters

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from lidar_outlier_filter.core.points import Points
    from lidar_outlier_filter.core.slow import SaySlow
    from lidar_outlier_filter.core.tiles import Allocate
    from lidar_outlier_filter.files.cloud_file import CloudFile

    Progress = Callable[[str, int, int], object]

OUTLIER, STRIP = 'outlier', 'point_source_id'


def clean(  # noqa: PLR0913  what a user may want, and two who want to know
    path: Path,
    output: Path,
    wanted: Wanted,
    outliers: Path | None = None,
    progress: Progress = lambda _what, _done, _total: None,
    slow: SaySlow | None = None,
) -> CleanReport:
    """Judge the points of a file, and write a copy that says or shows which are rejected.

    Parameters
    ----------
    path : LAS, LAZ, PCD, PLY, CSV, Parquet, or an SQLite database
    output : new file of the same format (LAS and LAZ are one); the log goes beside it, under the
        same name with ``.log`` and ``.json``
    wanted : what to do
    outliers : new file for the rejected points, where they are separated
    progress : is called with what is being done, and with how many of how many points
    slow : is called while a detector takes more than 10 × ``max_delay``

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
    clouds = _clouds(file, output, outliers, wanted)
    logs = [output.with_name(output.name + suffix) for suffix in ('.log', '.json')]
    if wanted.dry:
        clouds, logs = [], []
    with (
        _enough_memory(file),
        new_files([*clouds, *logs]) as built,
        scratch(output, wanted.tile) as allocate,
    ):
        seconds: dict[str, float] = {}
        with _timed(seconds, 'read'):
            coordinates = points.choose_coordinates(file, wanted.coordinates)
            loaded = _load(file, coordinates, parameters, allocate, progress)
        with _timed(seconds, 'judge'):
            judged = partial(judge, allocate=allocate, progress=progress, slow=slow)
            verdict = _judge_strips(file, loaded.points, parameters, wanted, judged)
            found = _find(file, loaded.points, verdict, wanted)
        with _timed(seconds, 'write'):
            changes = [] if wanted.dry else _changes(file, found, wanted, parameters)
            for change, target in zip(changes, built, strict=False):
                for done in cloud_file.copy(file, target, change):
                    progress('writing', min(done, len(file)), len(file))
        report = CleanReport(
            input=str(path),
            outputs=tuple(str(cloud) for cloud in clouds),
            started=started.isoformat(timespec='seconds'),
            settings=settings(path, wanted)['settings'],
            rejected_points=wanted.rejected,
            coordinates=coordinates,
            tile=wanted.tile,
            metres={one: file.metres[one] for one in coordinates if one in file.metres},
            lines=loaded.lines,
            lack=loaded.lack,
            coarse=points.say_coarse(file, coordinates, loaded.points),
            chain=parameters.chain,
            **_counts(found.verdict, loaded.points.valid, parameters.chain),
            spared=int(np.count_nonzero(verdict.rejected & ~found.verdict.rejected)),
            by_class=found.by_class,
            low=int(np.count_nonzero(~found.high)),
            high=int(np.count_nonzero(found.high)),
            seconds=seconds,
            versions=versions(),
            parameters=parameters.flat(),
        )
        texts = (as_text(report), json.dumps(asdict(report), indent=2) + '\n')
        for text, target, log in zip(texts, built[len(clouds) :], logs, strict=False):
            try:
                target.write_text(text, encoding='utf-8', errors='surrogateescape')
            except OSError as err:
                must_be = 'written in full'
                raise CloudError(f'the output {log}', must_be, said_by(err)) from err
    return report


@dataclass(frozen=True)
class _Gone:
    """What becomes of the points of a file.

    ``high`` says of each rejected point whether it is above what is kept around.
    """

    verdict: Verdict
    by_class: Mapping[int, tuple[int, int]]
    high: NDArray[np.bool_]


def _find(file: CloudFile, cloud: Points, verdict: Verdict, wanted: Wanted) -> _Gone:
    """Leave the classes alone that are to stay, and count what goes."""
    counted: dict[int, tuple[int, int]] = {}
    if file.classes or wanted.only or wanted.keep:
        codes = classes.read_classes(file)
        if wanted.only or wanted.keep:
            kept = classes.untouched(codes, wanted.only, wanted.keep)
            verdict = classes.spare(verdict, kept)
        counted = classes.by_class(codes, verdict.rejected)
    kept = cloud.valid & ~verdict.rejected
    return _Gone(verdict, counted, is_high(cloud.xyz, kept, verdict.rejected))


def judge(  # noqa: PLR0913  where to, and two who want to know
    cloud: Points,
    parameters: FilterParameters,
    tile: float = 0.0,
    allocate: Allocate = np.empty,
    progress: Progress = lambda _what, _done, _total: None,
    slow: SaySlow | None = None,
) -> Verdict:
    """Judge the valid points of a cloud in one piece or in tiles; the others stay untested."""
    if tile > 0:
        show = partial(progress, 'judging')
        return TiledChain(cloud, parameters, tile, allocate, show, slow).judge()
    progress('judging', 0, 0)
    return judge_whole(cloud, parameters, slow=slow)


def _judge_strips(
    file: CloudFile,
    cloud: Points,
    parameters: FilterParameters,
    wanted: Wanted,
    judged: Callable[[Points, FilterParameters, float], Verdict],
) -> Verdict:
    """Judge a cloud, or each of its strips, which flights over the same ground measured."""
    if not wanted.strips:
        return judged(cloud, parameters, wanted.tile)
    parts = [cloud_file.filled(chunk[0]) for chunk in cloud_file.read_exact(file, [STRIP])]
    strip = np.concatenate(parts)
    verdict = Verdict.untested(len(cloud))
    for number in np.unique(strip):
        where = np.flatnonzero(strip == number)
        verdict.put(where, judged(cloud.take(where), parameters, wanted.tile))
    return verdict


def _clouds(file: CloudFile, output: Path, outliers: Path | None, wanted: Wanted) -> list[Path]:
    """List the clouds to be written; refuse what cannot be."""
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
            must_be = 'LAZ in the order of the file: no COPC is written'
            raise CloudError('the output', must_be, cloud)
        if not cloud_file.is_same_format(file.path, cloud):
            raise CloudError('the output', f'in the format of {file.path.name}', cloud)
    return clouds


def _load(
    file: CloudFile,
    coordinates: Sequence[str],
    parameters: FilterParameters,
    allocate: Allocate,
    progress: Progress,
) -> points.Loaded:
    """Read the points; refuse a chain that needs scan lines where there are none."""
    loaded = points.load(
        file,
        coordinates,
        parameters,
        timed=uses_lines(parameters.chain),
        allocate=allocate,
        progress=lambda done: progress('reading', done, len(file)),
    )
    if loaded.lack:
        check_chain(parameters.chain, str(file.path), loaded.lack)
    return loaded


def _changes(
    file: CloudFile, found: _Gone, wanted: Wanted, parameters: FilterParameters
) -> list[Change]:
    """Say in what each of the clouds to be written differs from the file."""
    verdict = found.verdict
    scores: dict[str, NDArray[Any]] = {SCORE: verdict.score, DETECTORS: verdict.detectors}
    if parameters.scores:
        scores[REASON] = verdict.reason
    added = scores if parameters.scores else {}
    if wanted.rejected == MARK:
        if file.classes:
            return [_marked(found, wanted.mark, added)]
        return [Change(added={OUTLIER: verdict.rejected.astype(np.uint8), **scores})]
    cleaned = Change(keep=~verdict.rejected, added=added)
    if wanted.rejected == REMOVE:
        return [cleaned]
    return [cleaned, Change(keep=verdict.rejected, added=added)]


def _marked(found: _Gone, mark: str, added: Mapping[str, NDArray[Any]]) -> Change:
    """Say how the rejected points of a LAS file are marked."""
    rejected = found.verdict.rejected
    if mark == WITHHELD:
        return Change(withheld=rejected, added=added)
    if mark == CLASS:
        return Change(noise=rejected, added=added)
    high = np.zeros(len(rejected), np.bool_)
    high[rejected] = found.high
    return Change(noise=rejected & ~high, high=high, added=added)


def _counts(verdict: Verdict, valid: NDArray[np.bool_], chain: Sequence[str]) -> dict[str, Any]:
    """Count the points, all and by detector."""

    def by_detector(bits: NDArray[np.uint16]) -> dict[str, int]:
        return {name: int(np.count_nonzero(bits & BITS[name])) for name in chain}

    return {
        'points': len(valid),
        'invalid': int(np.count_nonzero(~valid)),
        'untested': int(np.count_nonzero(np.isnan(verdict.score[valid]))),
        'rejected': int(np.count_nonzero(verdict.rejected)),
        'rejected_by': by_detector(verdict.detectors),
        'second_phase': int(np.count_nonzero(verdict.detectors & SECOND_PHASE)),
        'undecided_by': by_detector(verdict.undecided),
    }


@contextmanager
def _enough_memory(file: CloudFile) -> Iterator[None]:
    try:
        yield
    except MemoryError as err:
        must_be = 'small enough for the memory, or judged in tiles (--tile)'
        raise CloudError(f'the cloud {file.path}', must_be, f'{len(file)} points') from err


@contextmanager
def _timed(seconds: dict[str, float], name: str) -> Iterator[None]:
    """Note how long it takes, in seconds."""
    begin = perf_counter()
    yield
    seconds[name] = round(perf_counter() - begin, 3)
