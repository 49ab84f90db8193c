# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What cleaned clouds change behind the filter: odometry by KISS-ICP, and cells of a map.

KISS-ICP is no part of the environment:

    scripts/environment pip install kiss-icp
    scripts/environment python benchmarks/downstream.py --wads ../CRFOR --write

Without ``--wads`` the drive in real snow is left out; `doc/real_snow.md` says how to get it.
``--write`` puts the table into ``doc/accuracy.md``.
"""

# ruff: noqa: INP001, T201  a script, which prints

import argparse
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from real_snow_sweeps import SNOW, read_rings
from real_snow_sweeps import read_sweeps as read_wads

from lidar_outlier_filter.core.annotations import Bools, Floats, Ints, Reals, Singles
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.points.points import SECOND, Points
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_lab.results.markdown import NOTHING, table, write
from lidar_outlier_lab.simulation.scenes.random_streets import LANES
from lidar_outlier_lab.simulation.scenes.spinning_streets import plan
from lidar_outlier_lab.simulation.world.drive import about, gather
from lidar_outlier_lab.simulation.world.trajectory import Route
from lidar_outlier_lab.training.scenes import known_recordings, read_sweeps

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT.parent / 'shared' / 'data'
PAGE = ROOT / 'doc' / 'accuracy.md'
SECTION = 'downstream'
COMMAND = 'benchmarks/downstream.py --write'
RINGS, SEED = 32, 901  # of the simulated street, which trained nothing
# From a stand, as drives begin: odometry knows no motion before its first sweep.
ROUTE = Route(
    ((0.0, 0.0, 0.0), (2.0, 6.0, 0.0)), (-40.0, LANES[0], 0.0), bump=0.03, mount=(0.0, 0.0, 1.9)
)
SHARES = (0.0, 0.03, 0.07)  # of the points that are outliers, most of them snow
CELL = 0.2  # metres: side of a cell
BAND = (0.3, 2.0)  # metres above the ground: what a vehicle would drive into
NEAR = 8.0  # metres: radius of the search for the ground
FARTHEST = 100.0  # metres: KISS-ICP's own default
MIN_SWEEPS = 3  # sweeps of a recording


@dataclass(frozen=True)
class DriveOf:
    """Sweeps, which points of each are outliers, and the pose (4, 4) at the end of each.

    ``bad`` is empty where nobody knows; ``truth`` is empty where odometry has to stand for it.
    """

    name: str
    sweeps: Sequence[Points]
    bad: Sequence[Bools] = ()
    truth: Sequence[Floats] = ()


HEAD = (
    *('drive', 'sweeps', 'metres', 'rejected', 'drift, raw', 'drift, cleaned'),
    *('phantom cells, raw', 'phantom cells, cleaned', 'real cells lost'),
)


def sweep_of(xyz: Reals, t: Ints, ring: NDArray[np.uint16], intensity: Singles) -> Points:
    """Return a sweep without missing returns."""
    valid = np.ones(len(xyz), np.bool_)
    return Points(xyz.astype(np.float64), t, ring.astype(np.int64), valid, intensity=intensity)


def simulated(turns: int) -> Iterator[DriveOf]:
    """Simulate one straight drive in dry air, in snow, and in heavy snow."""
    drive = replace(plan(RINGS, SEED), lines=turns, trajectory=ROUTE)
    block = gather(drive)
    per_turn = drive.sensor.shots_per_line
    for share in SHARES:
        returns = about(block, share) if share else block.clean
        points, turn = returns.points, returns.shot // per_turn
        sweeps, bad = [], []
        for k in range(turns):
            own = points[turn == k]
            shot = returns.shot[turn == k]
            xyz, t = np.stack([own[axis] for axis in 'xyz'], axis=1), shot * drive.sensor.interval
            sweeps.append(sweep_of(xyz, t, own['ring'], own['intensity'].copy()))
            bad.append(own['label'] > 0)
        ends = np.arange(1, turns + 1) * per_turn * drive.sensor.interval / SECOND
        what = f'snow, {100 * share:.0f} % outliers' if share else 'dry'
        yield DriveOf(f'`street-{RINGS}`, {what}', sweeps, bad, poses_of(ROUTE, ends))


def poses_of(route: Route, seconds: Floats) -> list[Floats]:
    """Return the sensor's poses (4, 4) at these times."""
    rotation, position = route.rotation(seconds), route.position(seconds)
    poses = []
    for k in range(len(seconds)):
        pose = np.eye(4)
        pose[:3, :3] = rotation[:, :, k]
        pose[:3, 3] = position[:, k] + rotation[:, :, k] @ np.array(route.mount)
        poses.append(pose)
    return poses


def in_snow(folder: Path, most: int) -> DriveOf:
    """Read the first sweeps of the drive in real snow, both returns, without copies."""
    sweeps, bad = [], []
    for one in read_wads(folder, read_rings(ROOT / 'benchmarks' / 'pandar64.csv'))[:most]:
        own = ~one.copy
        sweeps.append(sweep_of(one.xyz[own], one.time[own], one.ring[own], one.intensity[own]))
        bad.append(one.label[own] == SNOW)
    return DriveOf('WADS, real snow, labelled', sweeps, bad)


def recorded(data: Path) -> Iterator[DriveOf]:
    """Read the real, clean recordings of a few sweeps each."""
    for recording in known_recordings(data / 'bags'):
        clouds = [cloud.take(np.flatnonzero(cloud.valid)) for cloud in read_sweeps(recording)]
        if len(clouds) >= MIN_SWEEPS:
            yield DriveOf(f'{recording.sensor}, real, dry', clouds)


def odometry(sweeps: Iterable[Points], kept: Iterable[Bools]) -> list[Floats]:
    """Let KISS-ICP, with its defaults, find the pose (4, 4) of each sweep."""
    from kiss_icp.config import load_config  # noqa: PLC0415  no part of the environment
    from kiss_icp.kiss_icp import KissICP  # noqa: PLC0415

    config = load_config(None)
    config.data.max_range = FARTHEST
    config.mapping.voxel_size = FARTHEST / 100
    finder = KissICP(config)
    poses = []
    for sweep, keep in zip(sweeps, kept, strict=True):
        t = sweep.t.astype(np.float64)
        times = (t - t.min()) / max(1.0, np.ptp(t))
        finder.register_frame(sweep.xyz[keep], times[keep])
        poses.append(finder.last_pose.copy())
    return poses


def drift(poses: Sequence[Floats], truth: Sequence[Floats]) -> float:
    """Return how far the last place is off that of the truth, metres; both begin at the first."""
    ends = [np.linalg.inv(one[0]) @ one[-1] for one in (poses, truth)]
    return float(np.linalg.norm(ends[0][:3, 3] - ends[1][:3, 3]))


def cells(
    sweeps: Sequence[Points], masks: Sequence[Bools], poses: Sequence[Floats], ground: float
) -> set[tuple[int, int]]:
    """Return the cells of a map that any of these points occupies."""
    found: set[tuple[int, int]] = set()
    for sweep, mask, pose in zip(sweeps, masks, poses, strict=True):
        placed = sweep.xyz[mask] @ pose[:3, :3].T + pose[:3, 3]
        height = placed[:, 2] - ground
        level = placed[(height > BAND[0]) & (height < BAND[1]), :2]
        found |= set(map(tuple, np.unique(np.floor(level / CELL).astype(int), axis=0).tolist()))
    return found


def ground_of(sweep: Points, good: Bools, pose: Floats) -> float:
    """Return the height of the ground around the first pose, metres."""
    near = sweep.xyz[good & (np.hypot(*sweep.xyz.T[:2]) < NEAR)]
    placed = near @ pose[:3, :3].T + pose[:3, 3]
    return float(np.percentile(placed[:, 2], 20))


def measure(drive: DriveOf, chain: Chain) -> list[str]:
    """Clean a drive, and compare what is behind the filter before and after: a row of the table."""
    sweeps = drive.sweeps
    every: list[Bools] = [np.ones(len(one), np.bool_) for one in sweeps]
    rejected = [chain.judge(one).rejected for one in sweeps]
    kept = [~one for one in rejected]
    good = [~one for one in drive.bad] or every
    raw, cleaned = odometry(sweeps, every), odometry(sweeps, kept)
    # Without a truth, odometry of the good points stands for it; without labels, these are all.
    truth = list(drive.truth) or odometry(sweeps, good)
    ground = ground_of(sweeps[0], good[0], truth[0])
    real = cells(sweeps, good, truth, ground)
    left = cells(sweeps, kept, truth, ground)
    phantom = [NOTHING] * 2
    if drive.bad:
        before = len(cells(sweeps, every, truth, ground) - real)
        phantom = [f'{before:,}', f'{len(left - real):,}']
    path = np.diff([pose[:3, 3] for pose in truth], axis=0)
    share = sum(map(np.sum, rejected)) / sum(map(len, sweeps))
    return [
        drive.name,
        str(len(sweeps)),
        f'{np.sum(np.linalg.norm(path, axis=1)):.1f}',
        f'{100 * share:.2f} %',
        *(f'{100 * drift(one, truth):.1f} cm' for one in (raw, cleaned)),
        *phantom,
        f'{len(real - left):,} of {len(real):,}',
    ]


def main() -> int:
    """Measure all drives, and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').partition('\n')[0])
    parser.add_argument('--data', type=Path, default=DATA, metavar='FOLDER')
    parser.add_argument('--wads', type=Path, metavar='FOLDER')
    parser.add_argument('--turns', type=int, default=50, help='of the simulated drive')
    parser.add_argument('--sweeps', type=int, default=20, help='of the drive in real snow')
    parser.add_argument('--write', action='store_true')
    options = parser.parse_args()
    chain = Chain(FilterParameters())
    rows = []
    snow = [in_snow(options.wads, options.sweeps)] if options.wads else []
    for drives in (simulated(options.turns), snow, recorded(options.data)):
        for drive in drives:
            rows.append(measure(drive, chain))
            print(table(HEAD, rows[-1:]), flush=True)
    if options.write:
        write(PAGE, SECTION, table(HEAD, rows), command=COMMAND)
    return 0


if __name__ == '__main__':
    sys.exit(main())
