# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Replays in pieces by several processes, against the bytes of the replay in one process."""

# ruff: noqa: INP001  a module of scripts, in no package

from __future__ import annotations

import shutil
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING

from helpers.drives import hashes
from repeated_drives import Sweeps, sweeps_of, write_repeated

from lidar_outlier_filter.archive import pieces
from lidar_outlier_filter.archive.engine import Engine
from lidar_outlier_filter.archive.locations import location_of
from lidar_outlier_filter.archive.order import Order
from lidar_outlier_filter.archive.task import Task
from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.parameters.yaml_files import read_yaml
from lidar_outlier_filter.recordings.replay import replay

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from lidar_outlier_filter.archive.workers import Workers

JOBS = (1, 2, 3)
WHOLE = 1e6  # seconds
LENGTHS = (1.0, 3.0, WHOLE)  # of pieces, seconds
SHORTEST = 0.1  # seconds of a piece with one cloud
SECTOR = 45.0  # degrees of each sweep that repeated drives keep
SECONDS = 5.0  # of a repeated drive
# One recording of each sensor.
SENSORS = (
    'vlp16_mrpt_mcap',
    'hdl32_mrpt_mcap',
    'vlp32_nebula_db3',
    'os1_128_db3',
    'os0_32.bag',
    'hesai_xt32_nebula_mcap',
    'cloudini_lidar_link_mcap',
)


@dataclass(frozen=True)
class Case:
    """How drives are filtered: a name, parameters, and whether by two sensors at once."""

    name: str
    parameters: Mapping[str, object]
    is_for_two: bool = False


@dataclass
class Matrix:
    """What was seen of the replays of some drives."""

    title: str
    pairs: int = 0
    runs: int = 0
    blocks: int = 0
    blocks_here: int = 0
    refused: int = 0  # pairs of which no cloud had an answer
    different: list[str] = field(default_factory=list)

    def row(self) -> str:
        """Give a row of the table."""
        counts = (self.pairs, self.runs, self.blocks, self.blocks_here, self.refused)
        numbers = ' | '.join(f'{count:,}' for count in counts)
        return f'| {self.title} | {numbers} | {len(self.different)} |'


def cases(config: Path) -> list[Case]:
    """List chains of every kind, and every file of parameters."""
    kinds: dict[str, Mapping[str, object]] = {
        'default': {},
        **{name: {'chain': [name]} for name in DETECTORS},
        'vote of two': {'chain': ['alpha_beta_gamma', 'sor'], 'vote': 2},
        'with scores': {'scores': True},
        'by message': {'blocks': 'message'},
        'auto': {'blocks': 'auto'},
        'moving': {'motion.source': 'odometry'},
        'moving, by message': {'motion.source': 'odometry', 'blocks': 'message'},
    }
    files = [*sorted(config.glob('*.yaml')), *sorted((config / 'papers').glob('*.yaml'))]
    presets = [file for file in files if file.stem != 'defaults']
    return [
        *(Case(name, given) for name, given in kinds.items()),
        Case('two topics', {}, is_for_two=True),
        *(Case(file.stem, read_yaml(file)) for file in presets),
    ]


def as_recorded(
    data: Path, pools: Mapping[int, Workers], config: Path, folder: Path, share: slice
) -> Matrix:
    """Replay all real recordings, with a piece for each cloud and whole.

    Pair number n of recording and case is replayed with combination n of jobs and pieces, counted
    around: all combinations meet all recordings and cases. ``share`` says which pairs are taken.
    """
    seen = Matrix(f'as recorded, {SHORTEST:g} s and whole')
    found = sorted(path for path in (data / 'bags').iterdir())
    combinations = [*product(JOBS, (SHORTEST, WHOLE))]
    given = [case for case in cases(config) if not case.is_for_two and not _moves(case)]
    before, pieces.LEAST = pieces.LEAST, 1  # or recordings of half a second would be one piece
    for number, (drive, case) in enumerate([*product(found, given)][share]):
        chosen = [combinations[number % len(combinations)]]
        _compare(seen, drive, case, chosen, pools, folder)
    pieces.LEAST = before
    return seen


def repeated(
    data: Path, pools: Mapping[int, Workers], config: Path, folder: Path, share: slice
) -> Iterable[Matrix]:
    """Replay sectors of the sweeps of each sensor, repeated, in pieces of 1 s, 3 s and whole.

    The first sensor is replayed with every combination of jobs and pieces. Each of the others is
    replayed with every second case, and one combination as in :func:`as_recorded`. ``share``
    says which cases are taken.
    """
    combinations = [*product(JOBS, LENGTHS)]
    sensors = [sweeps_of(data / 'bags' / name).sector(0, SECTOR) for name in SENSORS]
    lengths = ', '.join('whole' if length == WHOLE else f'{length:g} s' for length in LENGTHS)
    full = Matrix(f'VLP-16, {SECONDS:g} s, {lengths}: every combination')
    some = Matrix(f'six other sensors, {SECONDS:g} s, {lengths}: one combination each')
    chosen = cases(config)[share]
    one, two = _drives(folder, 0, sensors)
    for case in chosen:
        drive = two if case.is_for_two else one
        _compare(full, drive, case, combinations, pools, folder)
    yield full
    for index in range(1, len(sensors)):
        one, two = _drives(folder, index, sensors)
        for case in chosen[index % 2 :: 2]:
            drive = two if case.is_for_two else one
            combination = combinations[some.pairs % len(combinations)]
            _compare(some, drive, case, [combination], pools, folder)
    yield some


def _drives(folder: Path, index: int, sensors: Sequence[Sweeps]) -> tuple[Path, Path]:
    """Write a drive of one sensor, and one of it together with the first or second."""
    other = sensors[0 if index else 1]
    one = write_repeated(folder / f'one{index}', [sensors[index]], SECONDS)
    two = write_repeated(folder / f'two{index}', [sensors[index], other], SECONDS)
    return one, two


def _moves(case: Case) -> bool:
    return case.parameters.get('motion.source', 'none') != 'none'


def _compare(  # noqa: PLR0913  what is compared, and by what
    seen: Matrix,
    drive: Path,
    case: Case,
    combinations: Sequence[tuple[int, float]],
    pools: Mapping[int, Workers],
    folder: Path,
) -> None:
    """Replay a drive in one process, then by others, and compare all files."""
    given = {**case.parameters, 'threads': 1}
    output = folder / 'out'  # one name, which is in the file metadata.yaml
    report = replay(drive, output, parameters=given)
    expected = hashes(output)
    shutil.rmtree(output)
    seen.pairs += 1
    seen.refused += all(topic.refused == topic.messages for topic in report.topics)
    for jobs, length in combinations:
        task = Task(location_of(drive), output)
        engine = Engine([task], Order(parameters=given, length=length), pools[jobs])
        engine.replay(task, output, lambda _done, _all: None)
        seen.runs += 1
        seen.blocks += engine.judged
        seen.blocks_here += engine.judged_here
        if hashes(output) != expected:
            seen.different.append(f'{drive.name}, {case.name}, {jobs} jobs, {length:g} s')
        shutil.rmtree(output)
