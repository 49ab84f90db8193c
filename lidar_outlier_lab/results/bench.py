# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How fast the filter is, and how fast a peer on the same cloud in the same run.

Answers are compared first: what is fast and wrong has no speed.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from statistics import median
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from lidar_outlier_filter.core.detectors import sor
from lidar_outlier_filter.core.detectors.alpha_beta_gamma import detector as alpha_beta_gamma
from lidar_outlier_filter.core.detectors.builtin import AlphaBetaGamma, Sor
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.core.points import scan_lines
from lidar_outlier_filter.core.points.points import Points, is_return
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.messages.cloud import structured
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.pipeline import Pipeline
from lidar_outlier_lab.results import peers
from lidar_outlier_lab.simulation.scenes.demo_street import SENSOR, demo_drive, demo_sweeps
from lidar_outlier_lab.simulation.world.recording import clouds, to_message
from lidar_outlier_lab.simulation.world.sensors import ProfileScanner

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

LINES, SHOTS = 300, 1000
BLOCK = 20  # lines that the stream hands over at once: 0.1 s at 200 lines/s
NEIGHBOURS, MULTIPLIER = 20, 2.0  # of the peers' statistical outlier removal
ROUNDS = 5
SIDES = ('both', 'either')
FORM = 'alpha_beta_gamma.sides'
SPATIAL = ('quadric', 'lof', 'sor')
CHAINS = (('boosted_trees',), ('alpha_beta_gamma',), ('alpha_beta_gamma', 'quadric', 'lof'))
SWEEPS = ((128, 1024), (64, 2048))  # rings and columns of spinning sensors, 10 Hz
TURNS = 8
SLOWER = 160.0  # scan lines a second of another profile scanner; 150 have no whole nanoseconds
SECONDS = 4.0  # of the demo's drive
SHARES = (16, 8, 4, 2, 1)  # of the cloud, to see how the time grows
SLOW = 8  # part of the cloud that slow peers get
FLOOR = 48  # bytes of a point that are read and written at least


@dataclass
class Work:
    """Something to time, on a number of points."""

    name: str
    points: int
    call: Callable[[], object]
    seconds: list[float] = field(default_factory=list)  # of each round

    @property
    def nanoseconds(self) -> float:
        """Nanoseconds a point, in the median round."""
        return median(self.seconds) / self.points * 1e9

    @property
    def speed(self) -> float:
        """Million points per second, in the median round."""
        return self.points / median(self.seconds) / 1e6

    def times(self, other: Work) -> float:
        """Say how many times faster than another, in the median round.

        Both ran in each round, so that what slows the machine down for a while slows both.
        """
        return median(
            (self.points / mine) / (other.points / its)
            for mine, its in zip(self.seconds, other.seconds, strict=True)
        )


def measure(works: Sequence[Work]) -> None:
    """Time all works in turn, in rounds, after one that does not count."""
    for number in range(ROUNDS + 1):
        for work in works:
            begin = perf_counter()
            work.call()
            if number:
                work.seconds.append(perf_counter() - begin)


def compare_engines() -> None:
    """Refuse to time kernels whose answer is not that of the Kalman filter (if installed)."""
    if find_spec('filterpy') is None:
        return
    points = profile_lines(2)
    answers = []
    for engine in ('kernel', 'filterpy'):
        parameters = FilterParameters().changed({'alpha_beta_gamma.engine': engine})
        answers.append(_smooth(points, parameters))
    if not np.array_equal(answers[0], answers[1]):
        differing = int(np.count_nonzero(answers[0] != answers[1]))
        raise FilterError("the kernel's answer", "the Kalman filter's", f'{differing} others')


def profile_lines(count: int, seed: int = 1) -> Points:
    """Make scan lines of a profile scanner over a flat road: 8 mm noise, 1 % outliers above."""
    rng = np.random.default_rng(seed)
    across = np.tile(2.5 * np.tan(np.linspace(-1.2, 1.2, SHOTS)), count)
    along = np.repeat(0.05 * np.arange(count), SHOTS)
    xyz = np.stack([along, across, np.zeros(count * SHOTS)], axis=1)
    xyz += rng.normal(0.0, 0.008, xyz.shape)
    stray = rng.random(len(xyz)) < 0.01  # noqa: PLR2004  the share of outliers
    xyz[stray, 2] += rng.uniform(0.2, 2.0, np.count_nonzero(stray))
    t = 5000 * np.arange(count * SHOTS)
    line = np.repeat(np.arange(count), SHOTS)
    return Points(xyz, t, line, np.ones(len(xyz), np.bool_))


def compare_sor(xyz: NDArray[np.float64]) -> None:
    """Refuse to time a SOR whose selection is not that of the method, computed with scipy."""
    score = sor.detect(Neighbourhood(xyz, NEIGHBOURS), Sor(k=NEIGHBOURS, multiplier=MULTIPLIER))
    differing = int(np.count_nonzero((score > 1) != peers.sor(xyz, NEIGHBOURS + 1, MULTIPLIER)))
    if differing:
        raise FilterError('the selection of SOR', "that of scipy's neighbours", differing)


def smoother_work(sides: str) -> Work:
    """Smooth lines block by block: lines, segments, predictions, tests, all passes."""
    points = profile_lines(LINES)
    size = BLOCK * SHOTS
    blocks = [points.take(slice(i, i + size)) for i in range(0, len(points), size)]
    parameters = FilterParameters().changed({FORM: sides})
    name = f'smoother on lines of {SHOTS} points, sides: {sides}'
    return Work(name, len(points), lambda: [_smooth(block, parameters) for block in blocks])


def _smooth(points: Points, parameters: FilterParameters) -> NDArray[np.bool_]:
    lines = scan_lines.find_lines(points, parameters.gap_factor)
    return alpha_beta_gamma.detect(points, lines, parameters.of(AlphaBetaGamma)).score > 1


def spatial_work(xyz: NDArray[np.float64], detector: str) -> Work:
    """Run one spatial detector on the whole cloud at once, its neighbourhood included."""
    parameters = FilterParameters().changed({'chain': [detector]})
    whole = np.zeros(len(xyz), np.int64)
    points = Points(xyz, whole, whole, np.ones(len(xyz), np.bool_))
    chain = Chain(parameters)
    return Work(detector, len(xyz), lambda: chain.judge(points))


def spinning_messages(rings: int, columns: int) -> list[Any]:
    """Turn once in the demo's street in dry air, and take the sweep several times, at 10 Hz."""
    drive = demo_sweeps(rings, columns)
    ((stamp, points),) = clouds(drive, 1)
    turn = drive.shots * drive.sensor.interval
    return [to_message(stamp + number * turn, points) for number in range(TURNS)]


def profile_messages(lines: float) -> list[Any]:
    """Drive through the demo's street for its four seconds, with so many scan lines a second."""
    drive = demo_drive()
    slower = replace(
        drive,
        sensor=ProfileScanner(lines_per_second=lines, shots_per_line=SHOTS),
        lines=round(lines * SECONDS),
    )
    return [to_message(stamp, points) for stamp, points in clouds(slower)]


def stream_work(
    messages: list[Any], chain: Sequence[str], form: Mapping[str, object] = SENSOR
) -> Work:
    """Go the whole way of a drive: decode, verdict, split. ``form`` is how its clouds are read."""
    parameters = FilterParameters().changed({**form, 'chain': chain})

    def stream() -> None:
        cloud_filter = Pipeline(parameters)
        answers = sum(len(cloud_filter.process(msg)) for msg in messages)
        answers += len(cloud_filter.flush())
        if answers != len(messages):
            raise FilterError('the answers', f'{len(messages)}', answers)

    points = sum(msg.width * msg.height for msg in messages)
    return Work(f'decode → {", ".join(chain)} → split', points, stream)


def peer_works(xyz: NDArray[np.float64]) -> list[Work]:
    """Run the peers' detectors on the same points; SciPy's and scikit-learn's on some of them."""
    some = xyz[: len(xyz) // SLOW]
    sor_name = f'SOR({NEIGHBOURS}, {MULTIPLIER})'
    works = []
    if peers.has_open3d():
        cloud = peers.open3d_cloud(xyz)
        works.append(
            Work(
                f'Open3D: {sor_name}',
                len(xyz),
                lambda: cloud.remove_statistical_outlier(NEIGHBOURS, MULTIPLIER),
            )
        )
    scipy = Work(f'SciPy: {sor_name}', len(some), lambda: peers.sor(some, NEIGHBOURS, MULTIPLIER))
    works.append(scipy)
    if find_spec('sklearn') is not None:
        name = f'scikit-learn: LOF({NEIGHBOURS})'
        works.append(Work(name, len(some), lambda: peers.lof(some, NEIGHBOURS)))
    return works


def floor_work(count: int) -> Work:
    """Copy as many bytes as points have at least: nothing that reads and writes them is faster."""
    source = np.ones(count * FLOOR // 8)
    target = np.empty_like(source)
    return Work(f'copy of {FLOOR} bytes', count, lambda: np.copyto(target, source))


def coordinates(messages: list[Any]) -> NDArray[np.float64]:
    """Return the returns of clouds (N, 3), metres."""
    parts = [structured(msg).reshape(-1) for msg in messages]
    xyz = np.concatenate([np.stack([part[axis] for axis in 'xyz'], axis=1) for part in parts])
    exact = xyz.astype(np.float64)
    return exact[is_return(exact)]
