# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the default finds and loses of two helical heads, on streets that never trained.

    scripts/environment python benchmarks/profile_heads.py [--chains] [--write] [--seeds 9001 9002]

A wet avenue, a dry suburb, and a street with sunken ground beside it, each with second echoes and
noise of the sun. Each head sees every street for 0.3 s, with 5000 shots a line; what it measured is
judged in the frame of the map, in its own frame moved by odometry of 100 Hz, and in its own frame
as it is. The training has other streets. ``--chains`` judges these
and streets of ``leslar-*`` by the papers' methods, in the map; ``--write`` writes the page.
"""

# ruff: noqa: INP001, T201  a script, which prints

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import pairwise, product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from lidar_outlier_filter.core.annotations import Bools, Ints
from lidar_outlier_filter.core.engine.blocks import Blocks
from lidar_outlier_filter.core.engine.stream_cloud import StreamCloud
from lidar_outlier_filter.core.points.points import SECOND, Points
from lidar_outlier_filter.core.points.poses import SensorExtrinsics, Track
from lidar_outlier_filter.evaluation.confusion import confusion
from lidar_outlier_filter.evaluation.report import percent
from lidar_outlier_filter.evaluation.truth import Cause, Kind
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_lab.results.markdown import NOTHING, table, write
from lidar_outlier_lab.results.papers.methods import CLASSIC, VEGETATION
from lidar_outlier_lab.simulation.papers.surveyed_streets import SURVEYS, plan
from lidar_outlier_lab.simulation.scenes.mapping_streets import avenue, suburb
from lidar_outlier_lab.simulation.scenes.random_streets import Town
from lidar_outlier_lab.simulation.scenes.sunken_ground import lay_out_sunken
from lidar_outlier_lab.simulation.world.drive import Disturbances, Drive
from lidar_outlier_lab.simulation.world.particles import SunNoise
from lidar_outlier_lab.simulation.world.scene import Scene
from lidar_outlier_lab.simulation.world.sensors import ProfileScanner
from lidar_outlier_lab.training.held_out import worst_quarter
from lidar_outlier_lab.training.train_profile import measured_rows

PAGE = Path(__file__).resolve().parents[1] / 'doc' / 'results' / 'profile_heads.md'
COMMAND = 'benchmarks/profile_heads.py [--chains] --write'
SEEDS = (9001, 9002, 9003, 9004)
SECONDS = 0.3
YAWS = {'left head': np.radians(45.0), 'right head': -np.radians(45.0)}
RATES = (200.0, 250.0)  # lines per second, by turns of the seeds
SHOTS = 5000  # of a line
FRAMES = MAP, MOVED, OWN = 'map', 'odometry', 'own frame'
CHAINS = {'classic.yaml': CLASSIC, 'classic_vegetation.yaml': VEGETATION}
POSE = SECOND // 100  # nanoseconds from one to the next
BELOW = -0.2  # metres: a mirrored point below the road, which is nowhere lower than 0
BANDS = (0.0, 0.03, 0.05, 0.1, 1.0)  # metres: mixed pixels, from what their footprints met
MIN_POINTS = 20  # of a cause, or good ones of an object; fewer show no share


class HeadReturns(NamedTuple):
    """What a head measured: points in the map, their truth, and how it drove."""

    drive: Drive
    points: Points
    cause: Ints
    kind: Ints


def sunken(seed: int) -> Drive:
    """Draw a wet street with bridges, ditches, stairs and ramps beside it."""
    rng = np.random.default_rng([seed, 90])
    town = Town(half_road=rng.uniform(3.8, 5.0), crown=0.05, kerb=0.12)
    scene = Scene(lay_out_sunken(town, rng), (SunNoise(1e-4),))
    return replace(avenue(seed), scene=scene, disturbances=Disturbances(0.0, wet=0.1, glass=0.04))


STREETS = {'avenue': avenue, 'suburb': suburb, 'sunken': sunken}


def measure(name: str, seed: int, head: str) -> HeadReturns:
    """Let a head look at a street."""
    if name in SURVEYS:
        drive = plan(SURVEYS[name], seed)
        drive = replace(drive, lines=round(drive.sensor.lines_per_second))
    else:
        drive, rate = STREETS[name](seed), RATES[seed % len(RATES)]
        how = {'lines_per_second': rate, 'shots_per_line': SHOTS, 'yaw': YAWS[head]}
        sensor = ProfileScanner(**how, noise=0.005, numbers_lines=True)
        drive = replace(drive, sensor=sensor, lines=round(rate * SECONDS), seed=seed + len(head))
    points, rows = measured_rows(drive, echoes=1 if name in SURVEYS else 2)
    cause, kind = (rows[name].astype(np.int64) for name in ('label', 'surface'))
    return HeadReturns(drive, points, cause, kind)


def in_frame(seen: HeadReturns, frame: str) -> Points:
    """Return the points of a head in a frame."""
    points, (position, rotation, mount) = seen.points, _poses(seen, seen.points.t)
    if frame == MAP:
        return points
    own = np.einsum('jin,nj->ni', rotation, points.xyz - position.T) - mount
    points = replace(points, xyz=own.astype(np.float32).astype(np.float64))
    if frame == OWN:
        return points
    t = np.arange(-POSE, int(points.t[-1]) + 2 * POSE, POSE)
    position, rotation, _ = _poses(seen, t)
    track = Track(max_gap=1.0, time_jump=1.0)
    quaternions = Rotation.from_matrix(np.moveaxis(rotation, 2, 0)).as_quat()
    for one, at, quaternion in zip(t.tolist(), position.T.tolist(), quaternions, strict=True):
        track.add(one, (*at, *quaternion.tolist()))
    moved, _ = track.move(points, SensorExtrinsics.at(seen.drive.trajectory.mount, (0.0, 0.0, 0.0)))
    return moved


def _poses(seen: HeadReturns, t: Ints) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return position (3, N) and rotation (3, 3, N) of the vehicle, and where the head is on it."""
    seconds, way = t / SECOND, seen.drive.trajectory
    return way.position(seconds), way.rotation(seconds), np.array(way.mount)


def judge(points: Points, values: Mapping[str, object]) -> Bools:
    """Judge points as a node does."""
    blocks: Blocks[StreamCloud] = Blocks(FilterParameters().changed(values))
    clouds = [*blocks.push(StreamCloud(points)), *blocks.flush()]
    return np.concatenate([cloud.verdict.outlier for cloud in clouds])


class Tally:
    """Rejected points and all points, by what they are, and by head and frame."""

    def __init__(self) -> None:
        """Begin with none."""
        self.counts: dict[str, dict[tuple[str, str], list[int]]] = {}
        self.f1: dict[tuple[str, str], list[float]] = {}

    def add(self, seen: HeadReturns, cell: tuple[str, str], rejected: Bools) -> None:
        """Count a cloud."""
        for what, mask in named(seen):
            of = self.counts.setdefault(what, {}).setdefault(cell, [0, 0])
            of[0] += int(rejected[mask].sum())
            of[1] += int(mask.sum())
        self.f1.setdefault(cell, []).append(confusion(seen.cause > 0, rejected).f1)

    def rows(self, cells: list[tuple[str, str]]) -> Iterator[list[str]]:
        """Lay out a row for each cause and object, and of F1."""
        first = cells[0][1]
        for what in sorted(self.counts, key=lambda name: (name.startswith('lost'), name)):
            counts = [self.counts[what].get(cell, [0, 0]) for cell in cells]
            some = [percent(part / n) if n >= MIN_POINTS else NOTHING for part, n in counts]
            total = sum(self.counts[what].get(cell, [0, 0])[1] for cell in cells if first in cell)
            yield [what, f'{total:,}', *some]
        means = [f'{np.mean(self.f1[cell]):.3f}' for cell in cells]
        worst = [f'{worst_quarter([np.array(one) for one in self.f1[cell]]):.3f}' for cell in cells]
        yield ['mean F1 of the streets', '', *means]
        yield ['… of the worst quarter', '', *worst]


def named(seen: HeadReturns) -> Iterator[tuple[str, Bools]]:
    """Name what points are, and choose them."""
    below = (seen.cause == Cause.REFLECTION) & (seen.points.xyz[:, 2] < BELOW)
    yield 'found: mirrored by the road', below
    for cause in np.unique(seen.cause[(seen.cause > 0) & ~below]).tolist():
        name = Cause(cause).name.lower().replace('_', ' ')
        yield f'found: {name}', (seen.cause == cause) & ~below
    yield from _mixed(seen)
    good = seen.cause == Cause.GOOD
    yield 'lost: all good points', good
    for kind in np.unique(seen.kind[good]).tolist():
        yield f'lost: {Kind(kind).name.lower()}', good & (seen.kind == kind)


def _mixed(seen: HeadReturns) -> Iterator[tuple[str, Bools]]:
    """Part mixed pixels by their distances from the nearest of what their footprints met."""
    index = np.flatnonzero(seen.cause == Cause.MIXED)
    rays = seen.drive.rays(seen.points.t[index] // seen.drive.sensor.interval)
    met = seen.drive.scene.cast(rays).distance
    measured = np.linalg.norm(seen.points.xyz[index] - rays.origin[:, :, 0].T, axis=1)
    off = np.full(len(seen.cause), np.inf)
    off[index] = np.abs(met - measured[:, None]).min(axis=1)
    for low, high in pairwise(BANDS if len(index) > 0 else ()):
        yield f'found: mixed, {low:.2f} to {high:.2f} m off', (low <= off) & (off < high)


def main() -> None:
    """Judge everything, and print or write the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').splitlines()[0])
    parser.add_argument('--chains', action='store_true', help="judge by the papers' methods")
    parser.add_argument('--write', action='store_true', help='put the table into the page')
    parser.add_argument('--seeds', nargs='+', type=int, default=list(SEEDS), metavar='N')
    options = parser.parse_args()
    tally, surveys = Tally(), SURVEYS if options.chains else ()
    for seed in options.seeds:
        for name, head in (*product(STREETS, YAWS), *product(surveys, ['`leslar-*`'])):
            seen = measure(name, seed, head)
            for chain, values in CHAINS.items() if options.chains else ():
                cell = (head if name in SURVEYS else 'two heads', chain)
                tally.add(seen, cell, judge(seen.points, values))
            for frame in () if options.chains else FRAMES:
                tally.add(seen, (head, frame), judge(in_frame(seen, frame), {}))
            print(name, seed, head, flush=True)
    cells = list(tally.f1)
    text = table(['', 'points', *(', '.join(cell) for cell in cells)], tally.rows(cells))
    print(text)
    if options.write:
        write(PAGE, 'chains' if options.chains else 'two heads', text, command=COMMAND)


if __name__ == '__main__':
    main()
