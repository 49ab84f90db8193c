# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Judge the points of a file as a whole, in tiles or by strips, and spare chosen classes."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import perf_counter

import numpy as np

from lidar_outlier_filter.core.annotations import Allocate, Bools, Bytes, Progress
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.detectors.registry import explanations
from lidar_outlier_filter.core.engine.chain import Chain, along_lines
from lidar_outlier_filter.core.engine.slow import SlowDetector
from lidar_outlier_filter.core.engine.whole_cloud import check_chain, judge_whole, with_rings
from lidar_outlier_filter.core.neighbours.floor import count_low, is_high
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.scan_pattern.recovered_rings import MAX_TURN_POINTS
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.errors import CloudError, ParameterError
from lidar_outlier_filter.files import cloud_file, points
from lidar_outlier_filter.files.beside import judge_with_buffer
from lidar_outlier_filter.files.cloud_file import LOW_NOISE, MAX_CLASS, CloudFile
from lidar_outlier_filter.files.points import Loaded
from lidar_outlier_filter.files.trajectory import with_trajectory
from lidar_outlier_filter.parameters.filter import FilterParameters

MARK, REMOVE, SEPARATE = 'mark', 'remove', 'separate'
CLASS, NOISE, WITHHELD, COLUMN = 'class', 'noise', 'withheld', 'column'  # marks of LAS points
UNITS = {'m': 1.0, 'cm': 0.01, 'mm': 0.001, 'ft': 0.3048, 'us-ft': 1200 / 3937}  # metres
STRIP = 'point_source_id'


@dataclass(frozen=True)
class CleanOptions:
    """Options of cleaning a file, beside the parameters of the filter.

    Attributes
    ----------
    rejected : 'mark': a copy that says which points are rejected; 'remove': a copy without them;
        'separate': the same, and a file with the rejected ones
    coordinates : two or three columns; empty: x, y and z
    table : the table of a database; None: the only one
    tile : 0: judged in memory; else in files, by ``quadric`` in tiles of this side, metres
    mark : 'class': rejected LAS points become class 7, or ``mark_class``; 'noise': 7 below, 18
        above the kept points around; 'withheld': they get this flag; 'column': ``outlier`` is added
    old_class : whether a column ``old_class`` is added to LAS, by which marks can be undone
    strips : whether the points of each ``point_source_id`` are judged separately
    only, keep : LAS classes; points of others than ``only``, and of ``keep``, stay as they are
    ignore : LAS classes; their points stay as they are, and are not neighbours of others
    dry : whether nothing is written
    unit : of the coordinates, one of ``UNITS``; None: as the file says
    accept_share : share of the points that may be rejected; None: what the default may reject
    buffer : width around the file, metres, from which points of the LAS files in its folder are
        seen, but not judged; 0: none are
    reasons : whether the verdict has reasons, even if no column is written for them
    trajectory : file that says where the scanner of a LAS file was when; None: not known

    """

    rejected: str = MARK
    coordinates: Sequence[str] = ()
    table: str | None = None
    tile: float = 0.0
    mark: str = CLASS
    mark_class: int = LOW_NOISE
    old_class: bool = False
    strips: bool = False
    only: Sequence[int] = ()
    keep: Sequence[int] = ()
    ignore: Sequence[int] = ()
    dry: bool = False
    unit: str | None = None
    accept_share: float | None = None
    buffer: float = 0.0
    reasons: bool = False
    trajectory: str | None = None


@dataclass(frozen=True)
class JudgedFile:
    """A file, the points read from it, and their verdict.

    Attributes
    ----------
    file, options, parameters : as they were given
    coordinates : the columns that were judged
    metres : metres per unit, for coordinates that are not in metres
    loaded : the points; points of ignored classes are not valid
    ignored : number of points of ignored classes
    everything : the verdict on all points
    verdict : the same, without points of classes that stay as they are
    by_class : points and rejected points of each class
    high : of each rejected point, whether it is above the kept points around it
    left_low : how many kept points look like low points; 0 unless it is a survey
    seconds : duration of reading and judging
    methods : how the default judged, by name; empty: other detectors did

    """

    file: CloudFile
    options: CleanOptions
    parameters: FilterParameters
    coordinates: tuple[str, ...]
    metres: Mapping[str, float]
    loaded: Loaded
    ignored: int
    everything: Verdict
    verdict: Verdict
    by_class: Mapping[int, tuple[int, int]]
    high: Bools
    left_low: int
    seconds: Mapping[str, float]
    methods: tuple[str, ...] = ()

    @property
    def units(self) -> list[float]:
        """Metres per unit of x, y and z in the file."""
        units = [self.metres.get(name, 1.0) for name in self.coordinates]
        return units + [1.0] * (3 - len(units))


def judge_file(  # noqa: PLR0913  options and callbacks
    file: CloudFile,
    options: CleanOptions,
    parameters: FilterParameters,
    allocate: Allocate = np.empty,
    progress: Progress = lambda _done, _total, _what: None,
    slow: Callable[[SlowDetector], object] | None = None,
) -> JudgedFile:
    """Read the points of a file, and judge them.

    Parameters
    ----------
    file, options, parameters : the file, and how to judge it
    allocate : returns an array of a shape, in memory or in a file
    progress : called with the points done, all points, and the step
    slow : called while a detector takes more than 10 × ``max_delay``

    """
    seconds: dict[str, float] = {}
    with timed(seconds, 'read'):
        coordinates, metres, loaded = _load(file, options, parameters, allocate, progress)
        axes = {name: metres.get(name, 1.0) for name in coordinates}
    with timed(seconds, 'judge'):
        progress(0, 0, 'judging')
        classes = loaded.more.get(points.CLASSIFICATION) if file.classes else None
        codes = None if classes is None else cloud_file.filled(classes).astype(np.uint8)
        loaded, ignored = _without(loaded, codes, options.ignore)
        cloud = loaded.points if options.buffer else with_rings(loaded.points, parameters)
        if cloud.ring is not None:
            loaded = points.recovered(file, loaded, cloud)
            cloud = loaded.points
        tile = options.tile if cloud.ring is None else 0.0  # a turn of rings is small
        how = parameters.changed({'scores': True}) if options.reasons else parameters
        chain = Chain(how)
        judge = partial(
            judge_whole, parameters=how, chain=chain, slow=slow, tile=tile, allocate=allocate
        )
        loaded = replace(loaded, points=cloud)
        if options.strips:
            everything = _judge_strips(loaded, judge, progress)
        elif options.buffer:
            seen = options.buffer, options.ignore
            loaded, everything = judge_with_buffer(file, axes, loaded, judge, seen)
        else:
            everything = judge(cloud)
        verdict = everything
        if codes is not None and (options.only or options.keep):
            verdict = spare(everything, untouched(codes, options.only, options.keep))
        kept = cloud.valid & ~verdict.rejected
        high = is_high(cloud.xyz, kept, verdict.rejected)
        # A scan from the ground (scan lines, no classes) has real low points at long range.
        is_survey = cloud.ring is None and (file.classes or not loaded.lines)
        left = np.flatnonzero(kept)
        left_low = count_low(cloud.xyz, left, parameters.threads) if is_survey else 0
    return JudgedFile(
        file,
        options,
        parameters,
        coordinates,
        metres,
        loaded,
        ignored,
        everything,
        verdict,
        by_class={} if codes is None else _by_class(codes, verdict.rejected),
        high=high,
        left_low=left_low,
        seconds=seconds,
        methods=tuple(chain.methods),
    )


def _judge_strips(
    loaded: Loaded, judge: Callable[[Points], Verdict], progress: Progress
) -> Verdict:
    """Judge each strip separately: flights over the same ground."""
    cloud, strip = loaded.points, cloud_file.filled(loaded.more[STRIP])
    verdict = Verdict.untested(len(cloud))
    for number in np.unique(strip):
        progress(0, 0, 'judging')
        where = np.flatnonzero(strip == number)
        verdict.put(where, judge(cloud.take(where)))
    return verdict


def _load(
    file: CloudFile,
    options: CleanOptions,
    parameters: FilterParameters,
    allocate: Allocate,
    progress: Progress,
) -> tuple[tuple[str, ...], dict[str, float], Loaded]:
    """Read the points; return the columns of their coordinates, and metres per other unit, too."""
    named = (*options.only, *options.keep, *options.ignore)
    if named and not file.classes:
        raise CloudError(f'the classes of {file.path}', 'in the file (LAS, LAZ)', 'none')
    for one in named:
        if not 0 <= one <= MAX_CLASS:
            raise CloudError('a class', f'from 0 to {MAX_CLASS}', one)
    if options.buffer:
        lack = 'no scan lines that go on in other files (--buffer)'
        check_chain(parameters.chain, str(file.path), lack)
        if options.strips:
            raise ParameterError('--buffer', 'given without --strips', options.buffer)
    if options.trajectory is not None and (options.buffer or not file.classes):
        must_be = 'given for LAS and LAZ, and without --buffer'
        raise ParameterError('--trajectory', must_be, options.trajectory)
    coordinates = points.choose_coordinates(file, options.coordinates)
    unit = options.unit
    known = file.metres if unit is None else dict.fromkeys(coordinates, UNITS[unit])
    metres = {name: known[name] for name in coordinates if known.get(name, 1.0) != 1.0}
    more = [points.CLASSIFICATION] * file.classes + [STRIP] * options.strips
    loaded = points.load(
        file,
        coordinates,
        parameters,
        # In tiles, detectors that can do without scan lines do.
        timed=bool(along_lines(parameters.chain)) if options.tile or options.buffer else None,
        in_one_piece=not (options.tile or options.strips or options.ignore),
        metres=metres,
        more=more + [points.GPS_TIME] * (options.trajectory is not None),
        allocate=allocate,
        progress=lambda done: progress(done, len(file), 'reading'),
    )
    if options.trajectory is not None:
        axes = {name: metres.get(name, 1.0) for name in coordinates}
        path = Path(options.trajectory)
        loaded = with_trajectory(file, axes, loaded, path, parameters, allocate)
    return coordinates, metres, loaded


def _without(loaded: Loaded, codes: Bytes | None, ignore: Sequence[int]) -> tuple[Loaded, int]:
    """Hide points of some classes from detectors and from the mask; count them."""
    if codes is None or not ignore:
        return loaded, 0
    cloud, hidden = loaded.points, np.isin(codes, ignore)
    present = cloud.valid if cloud.masked is None else cloud.valid | cloud.masked
    masked = None if cloud.masked is None else cloud.masked & ~hidden
    rest = replace(cloud, valid=cloud.valid & ~hidden, masked=masked)
    return replace(loaded, points=rest), int(np.count_nonzero(present & hidden))


@contextmanager
def timed(seconds: dict[str, float], name: str) -> Iterator[None]:
    """Note the duration, in seconds."""
    begin = perf_counter()
    yield
    seconds[name] = round(perf_counter() - begin, 3)


def untouched(classes: Bytes, only: Sequence[int], keep: Sequence[int]) -> Bools:
    """Return which points stay as they are: of classes other than ``only``, or of ``keep``."""
    kept = np.isin(classes, keep)
    if only:
        kept |= ~np.isin(classes, only)
    return kept


def spare(verdict: Verdict, kept: Bools) -> Verdict:
    """Return a verdict without rejections of the ``kept`` points: they count as untested."""
    spared = deepcopy(verdict)
    where = np.flatnonzero(kept & verdict.rejected)
    spared.put(where, Verdict.untested(len(where)))
    return spared


def _by_class(classes: Bytes, rejected: Bools) -> dict[int, tuple[int, int]]:
    """Count the points, and the rejected points, of each class."""
    every = np.bincount(classes, minlength=MAX_CLASS + 1)
    gone = np.bincount(classes[rejected], minlength=MAX_CLASS + 1)
    return {int(one): (int(every[one]), int(gone[one])) for one in np.flatnonzero(every)}


@dataclass(frozen=True)
class FileInfo:
    """A summary of a file of points.

    Attributes
    ----------
    points : number of points
    columns : types by name
    extent : least and largest number of each column, in the units of the file
    about : properties of the format, the coordinate system, and the unit
    rings : number of rings that ``clean`` would recover
    method : how the default judges the file; empty: unknown

    """

    points: int
    columns: Mapping[str, str]
    extent: Mapping[str, tuple[float, float]]
    about: Mapping[str, str]
    rings: int = 0
    method: str = ''


def describe_file(path: Path) -> FileInfo:
    """Read a file once, chunk by chunk, and summarise it."""
    file = cloud_file.open_cloud(path)
    names = [name for name, kind in file.columns.items() if kind.kind in 'iuf']
    extent: dict[str, tuple[float, float]] = {}
    for chunk in cloud_file.read(file, names, exact=True):
        for name, values in zip(names, chunk, strict=True):
            known = np.ma.compressed(values)
            known = known[np.isfinite(known)]
            if len(known):
                low, high = extent.get(name, (np.inf, -np.inf))
                extent[name] = min(low, float(known.min())), max(high, float(known.max()))
    types = {name: str(kind) for name, kind in file.columns.items()}
    about = dict(file.about)
    if file.classes:
        try:
            unit = unit_text(file.metres)
        except CloudError as err:
            unit = str(err)
        about |= {'CRS': file.crs or 'none', 'unit': unit}
    return FileInfo(len(file), types, extent, about, *_method(file))


def unit_text(metres: Mapping[str, float]) -> str:
    """Name the units of coordinates, from metres per unit of those not in metres."""
    axes: dict[float, list[str]] = {}
    for axis, size in metres.items():
        axes.setdefault(size, []).append(axis)
    said = {}
    for size in axes:
        names = (name for name, known in UNITS.items() if np.isclose(size, known, 1e-9))
        said[size] = f'{next(names, "units")} ({size:.10g} m)'
    if [*map(len, axes.values())] == [3]:
        return said.popitem()[1]
    groups = [f'{said[size]} for {" and ".join(those)}' for size, those in axes.items()]
    return ', '.join(groups) or 'm'


def _method(file: CloudFile) -> tuple[int, str]:
    """Return the rings that ``clean`` would recover, and how it would judge the file."""
    if len(file) > MAX_TURN_POINTS:
        return 0, ''
    parameters = FilterParameters()
    try:
        loaded = points.load(file, points.choose_coordinates(file, ()), parameters, timed=True)
    except CloudError:  # reported by `clean`
        return 0, ''
    if loaded.lack:
        loaded = points.recovered(file, loaded, with_rings(loaded.points, parameters))
    seen = DetectorInput(loaded.points.take(loaded.points.valid), parameters, whole=True)
    known = (explanations()[name] for name in parameters.chain if name in explanations())
    return loaded.rings, '; '.join(one.name_method(seen, parameters) for one in known)
