# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Golden verdicts: a hash of what every detector finds in real recordings and simulated clouds.

    scripts/environment python benchmarks/golden.py           # compares; exit status 1 if different
    scripts/environment python benchmarks/golden.py --write   # writes test/golden/verdicts.json
    scripts/environment python benchmarks/golden.py --small   # small real recordings only
    scripts/environment python benchmarks/golden.py --few     # some points of each of them only

With ``PYTHONPATH=.`` another Python compares what it finds, with the libraries that it has.
``--level`` chooses the instructions of the compiled kernels; all must find the same.

The hash covers the bits of the detectors and the float32 score of every point, so that a change of
the last bit is seen.
"""
# ruff: noqa: INP001, T201  a script, no package

import argparse
import hashlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from rosbags.typesys import Stores, get_typestore

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.core.engine.blocks import Blocks
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.engine.stream_cloud import StreamCloud
from lidar_outlier_filter.core.points.points import Points, concatenate
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.recordings.bags import Recording
from lidar_outlier_lab.results.samples import simulated

ROOT = Path(__file__).resolve().parent.parent
GOLDEN = ROOT / 'test' / 'golden' / 'verdicts.json'
BAGS = ROOT.parent / 'shared' / 'data' / 'bags'
SMALL = ('vlp16_mrpt_mcap', 'vlp32_nebula.bag', 'os0_32.bag')
LARGE = ('hdl32_mrpt_mcap', 'os1_128_db3', 'hesai_xt32_nebula_mcap', 'cloudini_lidar_link_mcap')
PRESETS = ('sotoodeh-hod', 'pirotti-fcd', 'leslar-b', 'leslar-c', 'street-16', 'street-32')
CHAINS: dict[str, dict[str, object]] = {
    **{name: {'chain': (name,)} for name in DETECTORS if name != 'field_range'},
    'paper smoother': {'chain': ('alpha_beta_gamma',), 'alpha_beta_gamma.sides': 'both'},
    'quadric patches': {'chain': ('quadric',), 'quadric.window': 'patch'},
    'lof2': {'chain': ('lof',), 'lof.statistic': 'lof2', 'lof.threshold': 0.5},
    'sor2 by range': {'chain': ('sor',), 'sor.statistic': 'sor2', 'sor.range_scaled': True},
    'three of a chain': {'chain': ('alpha_beta_gamma', 'quadric', 'lof')},
    'vote': {'chain': ('sor', 'lof', 'alpha_beta_gamma'), 'vote': 2},
    'by message': {'chain': ('alpha_beta_gamma', 'sor'), 'blocks': 'message'},
}
SEED = 7
LINES, FEW = 4, 240  # lines and points of a recording: a test judges these at all levels
SLOW_FROM = 100_000  # points of a preset above which patches are left out


def recording(name: str, parameters: FilterParameters) -> Iterator[Points]:
    """Decode the clouds of a real recording."""
    store, decoder = get_typestore(Stores.ROS2_JAZZY), Decoder(parameters)
    with Recording(BAGS / name) as source:
        for topic, _, data in source.messages():
            if topic.msgtype == 'sensor_msgs/msg/PointCloud2':
                yield decoder.decode(store.deserialize_cdr(data, topic.msgtype))


def digest(verdicts: list[Verdict]) -> str:
    """Hash verdicts: how many points each rejects goes first, to be read."""
    total = hashlib.sha256()
    rejected = 0
    for verdict in verdicts:
        total.update(np.ascontiguousarray(verdict.detectors, '<u2').tobytes())
        total.update(np.ascontiguousarray(verdict.undecided, '<u2').tobytes())
        total.update(np.ascontiguousarray(verdict.score, '<f4').tobytes())
        rejected += int(np.count_nonzero(verdict.rejected))
    return f'{rejected} {total.hexdigest()[:32]}'


def stream(clouds: list[Points], parameters: FilterParameters) -> list[Verdict]:
    """Judge clouds as the filter does."""
    pushed: Blocks[StreamCloud] = Blocks(parameters)
    finished = []
    for points in clouds:
        try:
            finished += pushed.push(StreamCloud(points))
        except CloudError:
            continue
    return [cloud.verdict for cloud in finished + pushed.flush()]


def few(name: str, parameters: FilterParameters) -> Points:
    """Take the first returns of some lines of a recording."""
    points = next(recording(name, parameters))
    valid = np.flatnonzero(points.valid)
    lines = np.unique(points.line[valid])[:LINES]
    return points.take(valid[np.isin(points.line[valid], lines)][:FEW])


def of_recordings(
    names: tuple[str, ...], threads: int = 0, *, only_few: bool = False
) -> dict[str, str]:
    """Hash the verdicts of all chains on real recordings, or on few points of each."""
    found = {}
    for name in names:
        title = f'{name}, {FEW} points' if only_few else name
        for chain, values in CHAINS.items():
            parameters = FilterParameters().changed({**values, 'threads': threads})
            if chain == 'quadric patches' and name not in SMALL:
                continue
            clouds = [few(name, parameters)] if only_few else list(recording(name, parameters))
            found[f'{title}, {chain}'] = digest(stream(clouds, parameters))
            print(f'{title}, {chain}: {found[f"{title}, {chain}"]}', flush=True)
    return found


def of_presets(names: tuple[str, ...], threads: int = 0) -> dict[str, str]:
    """Hash the verdicts of all chains on simulated clouds."""
    found = {}
    for name in names:
        for sample in simulated(name, SEED):
            for chain, values in CHAINS.items():
                parameters = FilterParameters().changed({**values, 'threads': threads})
                many = len(sample.code) > SLOW_FROM
                if (many and chain == 'quadric patches') or not sample.suits(parameters.chain):
                    continue
                clouds = list(sample.data.clouds)
                if sample.data.streamed:
                    verdicts = stream(clouds, parameters)
                else:
                    verdicts = [Chain(parameters, whole=True).judge(concatenate(clouds))]
                found[f'{sample.name}, {chain}'] = digest(verdicts)
                print(f'{sample.name}, {chain}: {found[f"{sample.name}, {chain}"]}', flush=True)
    return found


def main() -> int:
    """Compare, or write; return the exit status."""
    parser = argparse.ArgumentParser(description='Compare golden verdicts.')
    parser.add_argument('--write', action='store_true', help='write the file again')
    parser.add_argument('--small', action='store_true', help='small real recordings only')
    parser.add_argument('--few', action='store_true', help='few points of these only')
    parser.add_argument('--level', choices=_kernels.levels(), default=_kernels.levels()[-1])
    parser.add_argument('--threads', type=int, default=0, help='0: all cores')
    parser.add_argument('--recordings', nargs='+', default=SMALL, metavar='NAME', help='small ones')
    arguments = parser.parse_args()
    small = tuple(arguments.recordings)
    threads = arguments.threads
    _kernels.set_level(arguments.level)
    print(f'Python {sys.version.split()[0]}, NumPy {np.__version__}')
    found = of_recordings(small, threads, only_few=True)
    if not arguments.few:
        found |= of_recordings(small, threads)
    if not (arguments.small or arguments.few):
        found |= of_recordings(LARGE, threads) | of_presets(PRESETS, threads)
    if arguments.write:
        GOLDEN.parent.mkdir(exist_ok=True)
        GOLDEN.write_text(json.dumps(found, indent=1) + '\n')
        return 0
    golden = json.loads(GOLDEN.read_text())
    different = [name for name, value in found.items() if golden.get(name) != value]
    for name in different:
        print(f'different: {name}: {found[name]}, was {golden.get(name)}')
    print(f'{len(found)} verdicts, {len(different)} different')
    return 1 if different else 0


if __name__ == '__main__':
    sys.exit(main())
