# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Clean one file: read, judge, copy with the verdict, and write the log."""

import json
import math
import os
import platform
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from lidar_outlier_filter import __version__
from lidar_outlier_filter.core.annotations import Allocate, Progress
from lidar_outlier_filter.core.detectors import registry
from lidar_outlier_filter.core.detectors.plausible import check_share
from lidar_outlier_filter.core.engine.slow import SlowDetector
from lidar_outlier_filter.core.verdict import DETECTORS, EXTRA, OUTLIER, REASON, SCORE
from lidar_outlier_filter.disk.new_files import new_files, writable
from lidar_outlier_filter.errors import CloudError, ParameterError, refusing
from lidar_outlier_filter.files import cloud_file
from lidar_outlier_filter.files.cloud_file import (
    FORMATS,
    LOW_NOISE,
    Change,
    CloudFile,
    open_cloud,
)
from lidar_outlier_filter.files.judged_file import (
    CLASS,
    COLUMN,
    MARK,
    SEPARATE,
    WITHHELD,
    CleanOptions,
    JudgedFile,
    judge_file,
    timed,
)
from lidar_outlier_filter.files.points import CLASSIFICATION, say_coarse
from lidar_outlier_filter.files.rejected_list import write_rejected
from lidar_outlier_filter.parameters.filter import FilterParameters

MakeFiles = Callable[[Sequence[Path]], AbstractContextManager[list[Path]]]

OLD_CLASS = 'old_class'  # a column
_LIBRARIES = ('numpy', 'scipy', 'laspy', 'lazrs', 'pyarrow', 'python-neo-lzf')


@dataclass(frozen=True)
class CleanReport:
    """The result of cleaning a file; its log has the same fields.

    Attributes
    ----------
    options : options of the run, beside the parameters
    crs, metres : the coordinate system, if the file names one, and metres per unit of coordinates
        in other units
    lines, lack : how scan lines were found, or why not
    note : what is unusual about the columns of times and lines
    rings : number of rings recovered from elevations
    coarse : a warning that float32 coordinates are too far from the origin
    invalid : missing returns (NaN, Inf, all 0)
    ignored : points of ignored classes
    masked : points on the own vehicle
    untested : points that no detector could test
    second_phase : points that the second phase of a detector marks
    spared : points of protected classes that would be rejected otherwise
    by_class : points and rejected points of each class
    low, high : rejected points below and above the kept points around them
    left_low : kept points that look like low points

    """

    input: str
    outputs: tuple[str, ...]
    started: str
    options: Mapping[str, Any]
    coordinates: tuple[str, ...]
    crs: str
    metres: Mapping[str, float]
    lines: str
    lack: str
    note: str
    rings: int
    coarse: str
    chain: tuple[str, ...]
    points: int
    invalid: int
    ignored: int
    masked: int
    untested: int
    rejected: int
    rejected_by: Mapping[str, int]
    second_phase: int
    spared: int
    by_class: Mapping[int, tuple[int, int]]
    low: int
    high: int
    left_low: int
    undecided_by: Mapping[str, int]
    seconds: Mapping[str, float]
    versions: Mapping[str, str]
    parameters: Mapping[str, Any]

    @property
    def is_untested(self) -> bool:
        """Whether no point could be tested."""
        return self.points == self.untested + self.invalid + self.ignored + self.masked


def clean_file(  # noqa: PLR0913  many callbacks
    path: Path,
    output: Path,
    parameters: FilterParameters,
    options: CleanOptions = CleanOptions(),  # noqa: B008  frozen
    *,
    outliers: Path | None = None,
    rejected: Path | None = None,
    progress: Progress = lambda _done, _total, _what: None,
    slow: Callable[[SlowDetector], object] | None = None,
    inspect: Callable[[JudgedFile], object] | None = None,
    make: MakeFiles = new_files,
) -> CleanReport:
    """Judge the points of a file, and write a copy that marks or leaves out rejected points.

    Files are written under hidden names, and get their own at the end, all or none.

    Parameters
    ----------
    path : LAS, LAZ, PCD, PLY, PTX, E57, text table, Parquet, or an SQLite database
    output : new file of the same format (LAS and LAZ are one; PLY for E57); the log is written
        beside it, see :func:`log_of`
    parameters : of the filter
    options : of the run
    outliers : new file for the rejected points, where they are separated
    rejected : new CSV or GeoPackage that lists them, in a dry run, too
    progress : called with the number of points done, of all points, and the step
    slow : called while a detector takes more than 10 × ``max_delay``
    inspect : called with the judged file before anything is written
    make : gives the paths that new files are written to

    """
    started = datetime.now(UTC)
    file = open_cloud(path, options.table)
    clouds = list_clouds(file, output, outliers, options)
    if options.dry:
        clouds = []
    lists = [] if rejected is None else [rejected]
    outputs = [*clouds, *lists, *(() if options.dry else [log_of(output)])]
    with _enough_memory(file), make(outputs) as built:
        allocate = _allocator(built[0] if built else output, options.tile)
        judged = judge_file(file, options, parameters, allocate, progress, slow)
        if inspect is not None:
            inspect(judged)
        if not options.dry:
            check_share(
                str(path),
                int(np.count_nonzero(judged.verdict.rejected)),
                int(np.count_nonzero(~np.isnan(judged.verdict.score))),
                judged.methods,
                options.accept_share,
                helps='; boosted_trees.sensor=survey may judge better, and --dry-run shows where',
            )
        seconds = dict(judged.seconds)
        with timed(seconds, 'write'):
            for change, cloud, target in zip(_changes(judged), clouds, built, strict=False):
                with writable(cloud):
                    for done in cloud_file.copy(file, target, change):
                        progress(min(done, len(file)), len(file), 'writing')
            if rejected is not None:
                write_rejected(judged, rejected, built[len(clouds)])
        report = _report(judged, [*clouds, *lists], started, seconds)
        if not options.dry:
            with writable(outputs[-1]):
                built[-1].write_text(json.dumps(asdict(report), indent=2) + '\n', encoding='utf-8')
    return report


def log_of(output: Path) -> Path:
    """Name the log that is written beside an output."""
    return output.with_name(f'{output.name}.json')


@contextmanager
def _enough_memory(file: CloudFile) -> Iterator[None]:
    try:
        yield
    except MemoryError as err:
        must_be = 'small enough for the memory, or judged in files (--tile)'
        raise CloudError(f'the cloud {file.path}', must_be, f'{len(file)} points') from err


def list_clouds(
    file: CloudFile, output: Path, outliers: Path | None, options: CleanOptions
) -> list[Path]:
    """List the clouds to be written."""
    if options.rejected != MARK and file.whole:
        must_be = f'{MARK!r} for {file.path}: {file.whole}'
        raise CloudError('the treatment of rejected points', must_be, repr(options.rejected))
    _check_marks(file, options)
    if options.rejected == SEPARATE and outliers is None:
        raise CloudError('the file for the outliers', 'given, to separate them', 'none')
    if options.rejected != SEPARATE and outliers is not None:
        must_be = f'{SEPARATE!r} where they have a file'
        raise CloudError('the treatment of rejected points', must_be, repr(options.rejected))
    clouds = [output] if outliers is None else [output, outliers]
    for cloud in clouds:
        with cloud_file.readable(file.path):
            if cloud_file.is_copc(cloud) and file.octree is None:
                must_be = 'LAZ without an octree, as the file, of which untwine or PDAL makes COPC'
                raise CloudError('the output', must_be, cloud)
        suffix = cloud_file.copy_suffix(file.path)
        if FORMATS.get(cloud.suffix.lower()) != FORMATS.get(suffix.lower()):
            must_be = f'in the format of {file.path.with_suffix(suffix).name}'
            raise CloudError('the output', must_be, cloud)
    return clouds


def _check_marks(file: CloudFile, options: CleanOptions) -> None:
    """Refuse marks that the format or the other options do not have."""
    is_marked = file.classes and options.rejected == MARK
    if options.mark != CLASS and not is_marked:
        must_be = f'{CLASS!r}, unless points of LAS and LAZ are marked'
        raise CloudError('how rejected points are marked', must_be, repr(options.mark))
    if options.old_class and not is_marked:
        must_be = 'left out, unless points of LAS and LAZ are marked'
        raise CloudError('the column of old classes', must_be, 'it')
    if options.mark_class != LOW_NOISE and not (is_marked and options.mark == CLASS):
        must_be = f'{LOW_NOISE}, unless points of LAS and LAZ are marked by their class alone'
        raise CloudError('the class of rejected points', must_be, options.mark_class)
    if not 0 <= options.mark_class <= file.max_class:
        must_be = f'from 0 to {file.max_class} in {file.path}'
        raise CloudError('the class of rejected points', must_be, options.mark_class)


def _changes(judged: JudgedFile) -> list[Change]:
    """Describe how each output cloud differs from the file."""
    verdict, options, file = judged.verdict, judged.options, judged.file
    scores: dict[str, NDArray[Any]] = {SCORE: verdict.score, DETECTORS: verdict.detectors}
    if judged.parameters.scores:
        scores[REASON] = verdict.reason
    added = scores if judged.parameters.scores else {}
    if options.rejected == MARK and file.classes:
        return [_marked(judged, added)]
    if options.rejected == MARK and not file.gaps:
        return [Change(added={OUTLIER: verdict.rejected.astype(np.uint8), **scores})]
    cleaned = Change(keep=~verdict.rejected, added=added)
    outliers = Change(keep=verdict.rejected, added=added)
    return [cleaned, outliers] if options.rejected == SEPARATE else [cleaned]


def _marked(judged: JudgedFile, added: Mapping[str, NDArray[Any]]) -> Change:
    """Describe how the rejected points of a LAS file are marked."""
    rejected, options = judged.verdict.rejected, judged.options
    if options.old_class:
        classes = cloud_file.filled(judged.loaded.more[CLASSIFICATION]).astype(np.uint8)
        added = {OLD_CLASS: classes, **added}
    if options.mark == COLUMN:
        return Change(added={OUTLIER: rejected.astype(np.uint8), **added})
    if options.mark == WITHHELD:
        return Change(withheld=rejected, added=added)
    if options.mark == CLASS:
        return Change(noise=rejected, code=options.mark_class, added=added)
    high = np.zeros(len(rejected), np.bool_)
    high[rejected] = judged.high
    return Change(noise=rejected & ~high, high=high, added=added)


def _report(
    judged: JudgedFile, clouds: Sequence[Path], started: datetime, seconds: Mapping[str, float]
) -> CleanReport:
    """Describe a judged file, of which these clouds were written."""
    file, loaded, parameters = judged.file, judged.loaded, judged.parameters
    verdict, every, valid = judged.verdict, judged.everything, loaded.points.valid
    coarse = say_coarse(file, judged.coordinates, loaded.points, judged.metres)
    rejecting, bits, masked = registry.rejecting(parameters), registry.bits(), every.masked

    def count(mask: NDArray[Any]) -> int:
        return int(np.count_nonzero(mask))

    def by_name(found: NDArray[np.uint16], names: Sequence[str]) -> dict[str, int]:
        return {name: count(found & bits[name]) for name in names}

    return CleanReport(
        input=str(file.path),
        outputs=tuple(str(cloud) for cloud in clouds),
        started=started.isoformat(timespec='seconds'),
        options=asdict(judged.options),
        coordinates=judged.coordinates,
        crs=file.crs,
        metres=judged.metres,
        lines=loaded.lines,
        lack=loaded.lack,
        note=loaded.note,
        rings=loaded.rings,
        coarse=coarse,
        chain=parameters.chain,
        points=len(valid),
        invalid=count(~valid & ~masked) - judged.ignored,
        ignored=judged.ignored,
        masked=count(masked & ~valid),
        untested=count(np.isnan(verdict.score[valid])),
        rejected=count(verdict.rejected),
        rejected_by=by_name(verdict.detectors, rejecting),
        second_phase=count(verdict.detectors & EXTRA),
        spared=count(every.rejected & ~verdict.rejected),
        by_class=judged.by_class,
        low=count(~judged.high),
        high=count(judged.high),
        left_low=judged.left_low,
        undecided_by=by_name(verdict.undecided, parameters.chain),
        seconds=seconds,
        versions=_versions(),
        parameters=parameters.flat(),
    )


def _versions() -> dict[str, str]:
    names = [name for name in _LIBRARIES if name.removeprefix('python-neo-') in sys.modules]
    return {
        'lidar_outlier_filter': __version__,
        'python': platform.python_version(),
        **{name: version(name) for name in names},
    }


def _allocator(output: Path, tile: float) -> Allocate:
    """Return the allocator of large arrays: in memory or, for --tile, in files beside the output.

    The files have no name: disk space is freed as soon as an array is no longer used.
    """
    if not 0 <= tile < np.inf:
        raise ParameterError('--tile', 'at least 0 and finite', tile)
    if tile == 0:
        return np.empty

    def allocate(shape: tuple[int, ...], dtype: DTypeLike = np.float64) -> NDArray[Any]:
        size = np.dtype(dtype).itemsize * math.prod(shape)
        must_be = f'able to hold {size} bytes beside the output, for --tile'
        with (
            refusing(CloudError, 'the disk', must_be, OSError),
            TemporaryFile(dir=output.parent) as stream,
        ):
            # Where the disk is full, an access to the array would end the process.
            if size:
                os.posix_fallocate(stream.fileno(), 0, size)
            stream.truncate(max(1, size))
            return np.asarray(np.memmap(stream, dtype, 'r+', shape=shape))

    return allocate
