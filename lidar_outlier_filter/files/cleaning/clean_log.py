# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What a user wants done with a cloud that is a file, and the log of what became of it."""

from __future__ import annotations

import json
import platform
import sys
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter import __version__
from lidar_outlier_filter.parameters.filter import FilterParameters

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

MARK, REMOVE, SEPARATE = 'mark', 'remove', 'separate'
CLASS, NOISE, WITHHELD = 'class', 'noise', 'withheld'  # how LAS points are marked
UNITS = {'m': 1.0, 'cm': 0.01, 'mm': 0.001, 'ft': 0.3048, 'us-ft': 1200 / 3937}  # metres
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
    mark : 'class': rejected LAS points become class 7; 'noise': 7 or 18, as they are lower or
        higher than what is kept around; 'withheld': they gain this flag
    strips : whether the points of each ``point_source_id`` are judged alone
    only, keep : classes of LAS; points of others than ``only``, and of ``keep``, stay as they are
    ignore : classes of LAS; their points stay as they are, and are nobody's neighbours
    dry : whether nothing is written
    unit : of the coordinates, one of ``UNITS``; None: as the file says
    parameters : of the filter, by flat name

    """

    rejected: str = MARK
    coordinates: Sequence[str] = ()
    table: str | None = None
    tile: float = 0.0
    mark: str = CLASS
    strips: bool = False
    only: Sequence[int] = ()
    keep: Sequence[int] = ()
    ignore: Sequence[int] = ()
    dry: bool = False
    unit: str | None = None
    parameters: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True)
class CleanReport:
    """What became of a file; its log.

    ``invalid`` points (NaN, Inf, all 0) are none, ``ignored`` ones are of classes that are, and
    ``untested`` ones could be tested by no detector; all are kept. ``metres`` says of coordinates
    in other units how many metres one is, ``lines`` what the scan lines were found by; ``coarse``,
    that coordinates are too far away for float32; ``lack`` what the file lacks to have some,
    ``rings`` how many were recovered from elevations; ``extra`` of how many rejected points
    detectors say more, by what they say; ``spared`` how many would be rejected, but are of classes
    that stay as they are; ``by_class`` the points and the rejected ones of each class; ``low`` and
    ``high`` how many rejected ones are below and above what is kept around them; ``left_low`` how
    many of those that are kept look like low points.
    """

    input: str
    outputs: tuple[str, ...]
    started: str
    settings: Mapping[str, Any]
    rejected_points: str
    coordinates: tuple[str, ...]
    tile: float
    metres: Mapping[str, float]
    lines: str
    lack: str
    rings: int
    coarse: str
    chain: tuple[str, ...]
    points: int
    invalid: int
    ignored: int
    untested: int
    rejected: int
    rejected_by: Mapping[str, int]
    extra: Mapping[str, int]
    spared: int
    by_class: Mapping[int, tuple[int, int]]
    low: int
    high: int
    left_low: int
    undecided_by: Mapping[str, int]
    seconds: Mapping[str, float]
    versions: Mapping[str, str]
    parameters: Mapping[str, Any]


def settings(path: Path, wanted: Wanted) -> dict[str, Any]:
    """Say what an output depends on: the file, and what is wanted; as a log has it."""
    said = asdict(wanted)
    said['parameters'] = FilterParameters().changed(wanted.parameters).flat()
    state = path.stat()
    said |= {'bytes': state.st_size, 'changed': state.st_mtime_ns}
    plain: dict[str, Any] = json.loads(json.dumps({'input': str(path), 'settings': said}))
    return plain


def versions() -> dict[str, str]:
    """List the versions of this and of the libraries that had a part in it."""
    names = [name for name, module in _LIBRARIES.items() if module in sys.modules]
    return {
        'lidar_outlier_filter': __version__,
        'python': platform.python_version(),
        **{name: version(name) for name in names},
    }


def as_values(report: CleanReport) -> dict[str, Any]:
    """List what a report says, by name; what detectors say more stands among the others."""
    values: dict[str, Any] = {}
    for name, value in asdict(report).items():
        values |= value if name == 'extra' else {name: value}
    return values


def as_text(report: CleanReport) -> str:
    """Write a report as text, a line for each thing."""
    lines = []
    for name, value in as_values(report).items():
        if isinstance(value, dict):
            lines.append(f'{name}:')
            lines += [f'  {key}: {_plain(entry)}' for key, entry in value.items()]
        else:
            lines.append(f'{name}: {_plain(value)}')
    return '\n'.join(lines) + '\n'


def _plain(value: object) -> str:
    return ', '.join(map(str, value)) if isinstance(value, tuple) else str(value)
