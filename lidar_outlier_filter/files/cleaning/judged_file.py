# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The points of a file, judged: as a whole, in tiles, or strip by strip; but for some classes."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.engine.chain import along_lines, uses_lines
from lidar_outlier_filter.core.engine.tiled_chain import TiledChain
from lidar_outlier_filter.core.engine.whole_cloud import check_chain, judge_whole
from lidar_outlier_filter.core.neighbours.floor import count_low
from lidar_outlier_filter.core.points.heights import is_high
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files import cloud_file
from lidar_outlier_filter.files.cleaning import points
from lidar_outlier_filter.files.cleaning.clean_log import UNITS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Allocate, Bools, Bytes, Progress
    from lidar_outlier_filter.core.engine.slow import SaySlow
    from lidar_outlier_filter.core.points.points import Points
    from lidar_outlier_filter.files.cleaning.clean_log import Wanted
    from lidar_outlier_filter.files.cloud_file import CloudFile
    from lidar_outlier_filter.parameters.filter import FilterParameters

STRIP = 'point_source_id'
CLASSIFICATION = 'classification'
MOST = 255  # the highest class


@dataclass(frozen=True)
class JudgedFile:
    """A file, what was read of it, and what becomes of its points.

    Attributes
    ----------
    file, wanted, parameters : what was judged, and how
    coordinates : the columns that were judged
    metres : of those in other units, the metres that one of them is
    loaded : what was read; points of classes that are ignored are not valid
    ignored : how many these are
    everything : the verdict on all points
    verdict : the same, without points of classes that stay as they are
    by_class : the points and the rejected ones of each class
    high : of each rejected point, whether it is above what is kept around it
    left_low : how many kept points look like low ones; 0 of what is no survey
    seconds : what reading and judging took

    """

    file: CloudFile
    wanted: Wanted
    parameters: FilterParameters
    coordinates: tuple[str, ...]
    metres: Mapping[str, float]
    loaded: points.Loaded
    ignored: int
    everything: Verdict
    verdict: Verdict
    by_class: Mapping[int, tuple[int, int]]
    high: NDArray[np.bool_]
    left_low: int
    seconds: Mapping[str, float]

    @property
    def units(self) -> list[float]:
        """The metres that one of x, y and z is in the file."""
        units = [self.metres.get(name, 1.0) for name in self.coordinates]
        return units + [1.0] * (3 - len(units))


def judge_file(  # noqa: PLR0913  what, where to, and two who want to know
    file: CloudFile,
    wanted: Wanted,
    parameters: FilterParameters,
    allocate: Allocate,
    progress: Progress,
    slow: SaySlow | None,
) -> JudgedFile:
    """Read the points of a file, and judge them.

    Raises
    ------
    CloudError
        If the file cannot be read, or what is wanted cannot be done with it.
    ParameterError
        If a detector needs scan lines, and the file has none.

    """
    seconds: dict[str, float] = {}
    with timed(seconds, 'read'):
        coordinates = points.choose_coordinates(file, wanted.coordinates)
        metres = _metres(file, coordinates, wanted.unit)
        loaded = _load(file, coordinates, metres, wanted, parameters, allocate, progress)
    with timed(seconds, 'judge'):
        codes = _codes(loaded) if file.classes else None
        loaded, ignored = _without(loaded, codes, wanted.ignore)
        loaded = points.recovered(file, loaded, parameters)
        judged = partial(
            judge,
            parameters=parameters,
            tile=wanted.tile,
            allocate=allocate,
            progress=progress,
            slow=slow,
        )
        everything = _judge_strips(loaded, judged, strips=wanted.strips)
        verdict, counted = everything, {}
        if codes is not None:
            if wanted.only or wanted.keep:
                verdict = spare(verdict, untouched(codes, wanted.only, wanted.keep))
            counted = by_class(codes, verdict.rejected)
        kept = loaded.points.valid & ~verdict.rejected
        high = is_high(loaded.points.xyz, kept, verdict.rejected)
        left_low = _count_low(file, loaded, kept, parameters.threads)
    return JudgedFile(
        file,
        wanted,
        parameters,
        coordinates,
        metres,
        loaded,
        ignored,
        everything,
        verdict,
        counted,
        high,
        left_low,
        seconds,
    )


def judge(  # noqa: PLR0913  where to, and two who want to know
    cloud: Points,
    parameters: FilterParameters,
    tile: float,
    allocate: Allocate,
    progress: Progress,
    slow: SaySlow | None,
) -> Verdict:
    """Judge the valid points of a cloud in one piece or in tiles; the others stay untested.

    One turn of a spinning sensor is small, and its rings do not lie in tiles: it is one piece.
    """
    if tile > 0 and cloud.ring is None:

        def show(done: int, total: int) -> None:
            progress(done, total, 'judging')

        return TiledChain(cloud, parameters, tile, allocate, show, slow).judge()
    progress(0, 0, 'judging')
    return judge_whole(cloud, parameters, slow=slow)


def _count_low(file: CloudFile, loaded: points.Loaded, kept: Bools, threads: int) -> int:
    """Count the kept points that look like low ones, in what may be a survey.

    A scan from the ground, with lines and without classes, has its lowest points where it sees far.
    """
    cloud = loaded.points
    if cloud.ring is not None or (loaded.lines and not file.classes):
        return 0
    return count_low(cloud.xyz, np.flatnonzero(kept), threads)


def _metres(file: CloudFile, coordinates: Sequence[str], unit: str | None) -> dict[str, float]:
    """Say how many metres one of each coordinate is, where it is not one."""
    known = file.metres if unit is None else dict.fromkeys(coordinates, UNITS[unit])
    return {name: known[name] for name in coordinates if known.get(name, 1.0) != 1.0}


def _load(  # noqa: PLR0913  of what, which points, and where to
    file: CloudFile,
    coordinates: tuple[str, ...],
    metres: Mapping[str, float],
    wanted: Wanted,
    parameters: FilterParameters,
    allocate: Allocate,
    progress: Progress,
) -> points.Loaded:
    """Read the points; refuse a chain that needs scan lines where there are none."""
    check(file, (*wanted.only, *wanted.keep, *wanted.ignore))
    # In tiles, those that can do without scan lines do.
    timed = bool(along_lines(parameters.chain)) if wanted.tile else uses_lines(parameters.chain)
    loaded = points.load(
        file,
        coordinates,
        parameters,
        timed=timed,
        metres=metres,
        more=[CLASSIFICATION] * file.classes + [STRIP] * wanted.strips,
        allocate=allocate,
        progress=lambda done: progress(done, len(file), 'reading'),
    )
    if loaded.lack:
        check_chain(parameters.chain, str(file.path), loaded.lack)
    return loaded


def _codes(loaded: points.Loaded) -> Bytes:
    """Return the classes that points have in the file."""
    return cloud_file.filled(loaded.more[CLASSIFICATION]).astype(np.uint8)


def _without(
    loaded: points.Loaded, codes: Bytes | None, ignore: Sequence[int]
) -> tuple[points.Loaded, int]:
    """Make points of some classes invalid, so that nobody sees them; count those that were not."""
    if codes is None or not ignore:
        return loaded, 0
    valid = loaded.points.valid
    ignored = valid & np.isin(codes, ignore)
    rest = replace(loaded.points, valid=valid & ~ignored)
    return replace(loaded, points=rest), int(np.count_nonzero(ignored))


def _judge_strips(
    loaded: points.Loaded, judged: Callable[[Points], Verdict], *, strips: bool
) -> Verdict:
    """Judge a cloud, or each of its strips, which flights over the same ground measured."""
    cloud = loaded.points
    if not strips:
        return judged(cloud)
    strip = cloud_file.filled(loaded.more[STRIP])
    verdict = Verdict.untested(len(cloud))
    for number in np.unique(strip):
        where = np.flatnonzero(strip == number)
        verdict.put(where, judged(cloud.take(where)))
    return verdict


@contextmanager
def timed(seconds: dict[str, float], name: str) -> Iterator[None]:
    """Note how long it takes, in seconds."""
    begin = perf_counter()
    yield
    seconds[name] = round(perf_counter() - begin, 3)


def check(file: CloudFile, named: Sequence[int]) -> None:
    """Refuse classes that no file, or this one, can have.

    Raises
    ------
    CloudError
        If its format has none, or there is no class of such a number.

    """
    if named and not file.classes:
        raise CloudError(f'the classes of {file.path}', 'in the file (LAS, LAZ)', 'none')
    for one in named:
        if not 0 <= one <= MOST:
            raise CloudError('a class', f'from 0 to {MOST}', one)


def untouched(classes: Bytes, only: Sequence[int], keep: Sequence[int]) -> Bools:
    """Return which points stay as they are: of other classes than ``only``, or of ``keep``."""
    kept = np.isin(classes, keep)
    if only:
        kept |= ~np.isin(classes, only)
    return kept


def spare(verdict: Verdict, kept: Bools) -> Verdict:
    """Return a verdict that rejects none of some points: they count as never tested."""
    result = verdict.take(np.s_[:])
    spared = Verdict(*(values.copy() for values in vars(result).values()))
    where = np.flatnonzero(kept & verdict.rejected)
    spared.put(where, Verdict.untested(len(where)))
    return spared


def by_class(classes: Bytes, rejected: Bools) -> dict[int, tuple[int, int]]:
    """Count the points of each class, and those of them that are rejected."""
    points = np.bincount(classes, minlength=MOST + 1)
    gone = np.bincount(classes[rejected], minlength=MOST + 1)
    return {int(one): (int(points[one]), int(gone[one])) for one in np.flatnonzero(points)}
