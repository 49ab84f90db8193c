# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A cloud that is a file: read, judged as a whole, copied with the verdict, and logged."""

from __future__ import annotations

import json
import platform
import sys
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from lidar_outlier_filter import __version__
from lidar_outlier_filter.core.chain import along_lines
from lidar_outlier_filter.core.detectors.registry import BITS
from lidar_outlier_filter.core.tiled_chain import TiledChain
from lidar_outlier_filter.core.verdict import SECOND_PHASE
from lidar_outlier_filter.core.whole_cloud import chain_without_lines, judge_whole
from lidar_outlier_filter.errors import CloudError, said_by
from lidar_outlier_filter.files import cloud_file, points
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
    from lidar_outlier_filter.core.verdict import Verdict
    from lidar_outlier_filter.files.cloud_file import CloudFile

    Progress = Callable[[str, int, int], object]

OUTLIER = 'outlier'
MARK, REMOVE, SEPARATE = 'mark', 'remove', 'separate'
IN_TILES = ('alpha_beta_gamma',)  # the chain where nobody asks for one, and there are tiles
_LIBRARIES = {
    **{name: name for name in ('numpy', 'scipy', 'numba', 'laspy', 'lazrs', 'pyarrow')},
    'python-neo-lzf': 'lzf',
}


@dataclass(frozen=True)
class Wanted:
    """What a user wants done with a file.

    Attributes
    ----------
    rejected : 'mark': a copy that says which points are rejected; 'remove': a copy without them;
        'separate': the same, and one of them alone
    coordinates : two or three columns; empty: x, y and z
    table : the table of a database; None: the only one
    tile : side of the square tiles that the cloud is judged in, metres; 0: in one piece
    parameters : of the filter, by flat name

    """

    rejected: str = MARK
    coordinates: Sequence[str] = ()
    table: str | None = None
    tile: float = 0.0
    parameters: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True)
class CleanReport:
    """What became of a file; its log.

    ``invalid`` points (NaN, Inf, all 0) are none, ``untested`` ones could be tested by no detector;
    both are kept. ``metres`` says of coordinates in other units how many metres one is, ``lines``
    what the scan lines were found by; ``coarse``, that coordinates are too far away for float32;
    ``lack`` what the file lacks, so that another chain than the default was taken;
    ``second_phase`` how many of the points that ``hierarchical`` rejected its second phase did.
    """

    input: str
    outputs: tuple[str, ...]
    started: str
    rejected_points: str
    coordinates: tuple[str, ...]
    tile: float
    metres: Mapping[str, float]
    lines: str
    lack: str
    coarse: str
    chain: tuple[str, ...]
    points: int
    invalid: int
    untested: int
    rejected: int
    rejected_by: Mapping[str, int]
    second_phase: int
    undecided_by: Mapping[str, int]
    seconds: Mapping[str, float]
    versions: Mapping[str, str]
    parameters: Mapping[str, Any]


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
    with (
        _enough_memory(file),
        new_files([*clouds, *logs]) as built,
        scratch(output, wanted.tile) as allocate,
    ):
        seconds: dict[str, float] = {}
        with _timed(seconds, 'read'):
            coordinates = points.choose_coordinates(file, wanted.coordinates)
            loaded, parameters = _load(file, coordinates, parameters, wanted, allocate, progress)
        with _timed(seconds, 'judge'):
            verdict = judge(loaded.points, parameters, wanted.tile, allocate, progress, slow)
        with _timed(seconds, 'write'):
            changes = _changes(file, verdict, wanted, parameters)
            for change, target in zip(changes, built, strict=False):
                for done in cloud_file.copy(file, target, change):
                    progress('writing', min(done, len(file)), len(file))
        report = CleanReport(
            input=str(path),
            outputs=tuple(str(cloud) for cloud in clouds),
            started=started.isoformat(timespec='seconds'),
            rejected_points=wanted.rejected,
            coordinates=coordinates,
            tile=wanted.tile,
            metres={one: file.metres[one] for one in coordinates if one in file.metres},
            lines=loaded.lines,
            lack=loaded.lack,
            coarse=points.say_coarse(file, coordinates, loaded.points),
            chain=parameters.chain,
            **_counts(verdict, loaded.points.valid, parameters.chain),
            seconds=seconds,
            versions=_versions(),
            parameters=parameters.flat(),
        )
        texts = (as_text(report), json.dumps(asdict(report), indent=2) + '\n')
        for text, target, log in zip(texts, built[-2:], logs, strict=True):
            try:
                target.write_text(text, encoding='utf-8', errors='surrogateescape')
            except OSError as err:
                must_be = 'written in full'
                raise CloudError(f'the output {log}', must_be, said_by(err)) from err
    return report


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


def _clouds(file: CloudFile, output: Path, outliers: Path | None, wanted: Wanted) -> list[Path]:
    """List the clouds to be written; refuse what cannot be."""
    if wanted.rejected != MARK and file.whole:
        must_be = f'{MARK!r} for {file.path}: {file.whole}'
        raise CloudError('what becomes of rejected points', must_be, repr(wanted.rejected))
    if wanted.rejected == SEPARATE and outliers is None:
        raise CloudError('the file for the outliers', 'given, to separate them', 'none')
    if wanted.rejected != SEPARATE and outliers is not None:
        must_be = f'{SEPARATE!r} where they have a file'
        raise CloudError('what becomes of rejected points', must_be, repr(wanted.rejected))
    clouds = [output] if outliers is None else [output, outliers]
    for cloud in clouds:
        if not cloud_file.is_same_format(file.path, cloud):
            raise CloudError('the output', f'in the format of {file.path.name}', cloud)
    return clouds


def _load(  # noqa: PLR0913  all that a run knows by then
    file: CloudFile,
    coordinates: Sequence[str],
    parameters: FilterParameters,
    wanted: Wanted,
    allocate: Allocate,
    progress: Progress,
) -> tuple[points.Loaded, FilterParameters]:
    """Read the points, and choose the chain: without scan lines, or in tiles, there is another."""
    chosen = 'chain' in wanted.parameters
    along = along_lines(parameters.chain)
    loaded = points.load(
        file,
        coordinates,
        parameters,
        timed=bool(along) or not chosen,
        allocate=allocate,
        progress=lambda done: progress('reading', done, len(file)),
    )
    if along and not loaded.lines:
        parameters = chain_without_lines(
            parameters, chosen=chosen, what=str(file.path), lack=loaded.lack
        )
    elif wanted.tile > 0 and not chosen:
        parameters = parameters.changed({'chain': IN_TILES})
    return loaded, parameters


def _changes(
    file: CloudFile, verdict: Verdict, wanted: Wanted, parameters: FilterParameters
) -> list[Change]:
    """Say in what each of the clouds to be written differs from the file."""
    scores: dict[str, NDArray[Any]] = {SCORE: verdict.score, DETECTORS: verdict.detectors}
    if parameters.scores:
        scores[REASON] = verdict.reason
    added = scores if parameters.scores else {}
    if wanted.rejected == MARK:
        if file.classes:
            return [Change(noise=verdict.rejected, added=added)]
        return [Change(added={OUTLIER: verdict.rejected.astype(np.uint8), **scores})]
    cleaned = Change(keep=~verdict.rejected, added=added)
    if wanted.rejected == REMOVE:
        return [cleaned]
    return [cleaned, Change(keep=verdict.rejected, added=added)]


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


def _versions() -> dict[str, str]:
    """List the versions of this and of the libraries that had a part in it."""
    names = [name for name, module in _LIBRARIES.items() if module in sys.modules]
    return {
        'lidar_outlier_filter': __version__,
        'python': platform.python_version(),
        **{name: version(name) for name in names},
    }


def as_text(report: CleanReport) -> str:
    """Write a report as text, a line for each thing."""
    lines = []
    for name, value in asdict(report).items():
        if isinstance(value, dict):
            lines.append(f'{name}:')
            lines += [f'  {key}: {_plain(entry)}' for key, entry in value.items()]
        else:
            lines.append(f'{name}: {_plain(value)}')
    return '\n'.join(lines) + '\n'


def _plain(value: object) -> str:
    return ', '.join(map(str, value)) if isinstance(value, tuple) else str(value)
