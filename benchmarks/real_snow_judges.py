# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Judges of sweeps of WADS: the default as it is shipped, a published network, and peers.

Peers have the thresholds that are best for the labels, the same for all sweeps; nobody knows them
in the field. Copies take no part in their neighbourhoods, as each would be its own nearest
neighbour: a copy has the verdict of its point.
"""

# ruff: noqa: INP001  a part of a script, no package

from collections.abc import Callable, Iterable, Sequence
from importlib import import_module
from itertools import product
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from real_snow_sweeps import Sweep, Verdict
from scipy.spatial import cKDTree

from lidar_outlier_filter import CloudFilter
from lidar_outlier_filter.core.annotations import Bools, Floats, Ints, Rows, Singles
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.evaluation.confusion import curve
from lidar_outlier_filter.parameters.yaml_files import read_yaml
from lidar_outlier_lab.results import peers

HESAI = Path(__file__).resolve().parents[1] / 'config' / 'hesai.yaml'  # as the quick start says
XYZI = [('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('intensity', '<f4')]
MESSAGE = np.dtype([*XYZI, ('ring', '<u2'), ('timestamp', '<f8'), ('index', '<u4')])
NETWORK_NEIGHBOURS = 9  # the point itself among them
AWAY = 1.0  # metres, added to their distances
# Of x, y, z and intensity in its training, from its own code
MEAN = np.array([0.3420934, -0.01516175, -0.5889243, 9.875928])
DEVIATION = np.array([25.845459, 18.93466, 1.5863657, 14.734034])
NEIGHBOURS = 20  # of SOR and LOF
NEAREST = 10  # whose distances the rules use
SPACING = np.radians(0.2)  # between shots
AVERAGED = 5  # distances of the range-scaled one
MULTIPLES = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 14.0, 20.0)
MIN_RADII_M = (0.02, 0.04, 0.07, 0.1, 0.15, 0.2, 0.3)  # metres
COUNTS = (1, 2, 3, 4, 5, 6, 8, 10)
DARKEST = (0, 1, 2, 4, 8)
REACHES = (10.0, 12.0, 15.0, 20.0, 30.0, 71.0)  # metres; LIOR's own is 71
RADII = (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5)  # metres; 0: neighbours do not matter
SHARES = (0.004, 0.007, 0.01, 0.014, 0.02, 0.03)  # of the range


def by_default(clouds: Sequence[Sweep]) -> Verdict:
    """Judge clouds one after the other, as the node and `replay` do."""
    messages = [message(one) for one in clouds]
    filters = [CloudFilter(read_yaml(HESAI)) for _ in range(2)]
    filters[0].push(messages[0])  # what is compiled or read once is no part of the time
    filters[0].flush()
    begin = perf_counter()
    outputs = [output for one in messages for output in filters[1].push(one)]
    outputs += filters[1].flush()
    seconds = perf_counter() - begin
    if len(outputs) != len(clouds):
        raise RecordingError('the outputs', f'{len(clouds)}, one for each sweep', len(outputs))
    rejected = []
    for one, output in zip(clouds, outputs, strict=True):
        mask = np.zeros(len(one), np.bool_)
        mask[output.outliers['index']] = True
        rejected.append(mask)
    return Verdict(rejected, seconds, '')


def message(cloud: Sweep) -> Rows:
    """Lay out a cloud as Hesai's driver does, and number its points."""
    points = np.zeros(len(cloud), MESSAGE)
    for axis, column in zip('xyz', cloud.xyz.T, strict=True):
        points[axis] = column
    points['intensity'] = cloud.intensity
    points['ring'] = cloud.ring
    points['timestamp'] = cloud.time / 1e9
    points['index'] = np.arange(len(cloud))
    return points


def load_network(path: Path) -> Any:
    """Load the network."""
    onnxruntime = import_module('onnxruntime')
    return onnxruntime.InferenceSession(path.read_bytes(), providers=['CPUExecutionProvider'])


def by_network(clouds: Sequence[Sweep], network: Any) -> Verdict:
    """Judge each cloud alone by 3D-OutDet, all points of it, copies too, as in its training.

    Raisuddin, Cortinhal, Holmblad and Aksoy (2024); the network was trained on WADS.
    """
    begin, rejected = perf_counter(), []
    for cloud in clouds:
        given = np.column_stack([cloud.xyz, cloud.intensity]).astype(np.float64)
        distance, index = cKDTree(given[:, :3]).query(given[:, :3], NETWORK_NEIGHBOURS, workers=-1)
        asked = {
            'points': ((given - MEAN) / DEVIATION).astype(np.float32),
            'dist': (distance + AWAY).astype(np.float32),
            'indices': index.astype(np.int64),
        }
        output = network.run(None, asked)[0]
        rejected.append(output[:, 1] > output[:, 0])
    return Verdict(rejected, perf_counter() - begin, '')


class Features(NamedTuple):
    """What peers see of the N points of all clouds, copies among them.

    ``near`` (N, 10) are distances to the nearest points, ``sor`` the mean of 20 of them, as
    standard deviations from the mean of the sweep, ``lof`` the local outlier factor, all (N,).
    ``seconds`` is what neighbours took, ``splits`` where clouds end.
    """

    snow: Bools
    range: Singles
    flat: Singles
    intensity: Singles
    near: Singles
    sor: Singles
    lof: Singles
    seconds: float
    splits: Ints


def features(clouds: Sequence[Sweep]) -> Features:
    """Measure all clouds."""
    begin = perf_counter()
    near, sor, lof = zip(*map(neighbours, clouds), strict=True)
    seconds = perf_counter() - begin
    xyz = np.concatenate([one.xyz for one in clouds]).astype(np.float64)
    return Features(
        np.concatenate([one.snow for one in clouds]),
        np.linalg.norm(xyz, axis=1).astype(np.float32),
        np.hypot(xyz[:, 0], xyz[:, 1]).astype(np.float32),
        np.concatenate([one.intensity for one in clouds]),
        np.concatenate(near),
        np.concatenate(sor),
        np.concatenate(lof),
        seconds,
        np.cumsum([len(one) for one in clouds])[:-1],
    )


def neighbours(cloud: Sweep) -> tuple[Singles, Singles, Singles]:
    """Return distances to the nearest points, SOR's and LOF's statistics; see ``Features``."""
    own = np.flatnonzero(~cloud.copy)
    xyz = cloud.xyz[own].astype(np.float64)
    distance = peers.distances(xyz, NEIGHBOURS, workers=-1)
    mean = distance.mean(axis=1)
    of = np.searchsorted(own, cloud.source)  # the measured point of each
    found = distance[:, :NEAREST], (mean - mean.mean()) / mean.std(), peers.lof(xyz, NEIGHBOURS)
    near, sor, lof = (one.astype(np.float32)[of] for one in found)
    return near, sor, lof


def f1(snow: Bools, rejected: Bools) -> float:
    """Return the harmonic mean of precision and recall."""
    both = int(np.count_nonzero(snow)) + int(np.count_nonzero(rejected))
    return 2 * int(np.count_nonzero(snow & rejected)) / max(both, 1)


def best_threshold(score: Singles, snow: Bools) -> float:
    """Return the threshold with the best F1, where points from it on are rejected."""
    known = curve(snow, score)
    f1s = known.found / (known.found + known.lost + known.found[-1])
    return float(known.threshold[f1s.argmax()])


def _scored(said: str, score: Callable[[Features], Singles]) -> Callable[[Features], Verdict]:
    """Make a judge of a score."""

    def judge(seen: Features) -> Verdict:
        values = score(seen)
        threshold = best_threshold(values, seen.snow)
        rejected = np.split(values >= threshold, seen.splits)
        return Verdict(rejected, seen.seconds, said.format(threshold))

    return judge


def _ruled(
    said: str,
    settings: Callable[[], Iterable[tuple[float, ...]]],
    rule: Callable[..., Bools],
) -> Callable[[Features], Verdict]:
    """Make a judge of a rule with several parameters, all of whose settings are tried."""

    def judge(seen: Features) -> Verdict:
        found = [(f1(seen.snow, rule(seen, *one)), one) for one in settings()]
        setting = max(found)[1]
        rejected = np.split(rule(seen, *setting), seen.splits)
        return Verdict(rejected, seen.seconds, said.format(*setting))

    return judge


def dror(seen: Features, multiple: float, least: float, count: float) -> Bools:
    """Reject what has fewer than so many points within a radius that grows with the range."""
    radius = np.maximum(least, multiple * SPACING * seen.flat)
    return seen.near[:, int(count) - 1] > radius


def lior(seen: Features, darkest: float, reach: float, radius: float, count: float) -> Bools:
    """Reject what is dark, near, and has fewer than so many points within a radius."""
    dark = (seen.intensity <= darkest) & (seen.range < reach)
    return dark & (seen.near[:, int(count) - 1] >= radius)


def three(seen: Features, darkest: float, reach: float, share: float) -> Bools:
    """Reject what is dark, near, and far from others for its range."""
    dark = (seen.intensity <= darkest) & (seen.range < reach)
    return dark & (scaled(seen) > share)


def scaled(seen: Features) -> Floats:
    """Return the mean distance to five others as a part of the range."""
    return seen.near[:, :AVERAGED].mean(axis=1) / seen.range


PEERS: dict[str, Callable[[Features], Verdict]] = {
    'DROR': _ruled(
        'radius {:g} × 0.2° × range, at least {:g} m; fewer than {:g} others',
        lambda: product(MULTIPLES, MIN_RADII_M, COUNTS),
        dror,
    ),
    'SOR': _scored('20 others, {:.3g} standard deviations', lambda seen: seen.sor),
    'LOF': _scored('20 others, factor {:.3g}', lambda seen: seen.lof),
    'range-scaled distance': _scored('5 others, {:.3g} × range', scaled),
    'LIOR': _ruled(
        'intensity ≤ {:g}, range < {:g} m; within {:g} m fewer than {:g} others',
        lambda: product(DARKEST, REACHES, RADII, COUNTS),
        lior,
    ),
    'intensity, range, distance': _ruled(
        'intensity ≤ {:g}, range < {:g} m, mean distance to 5 others > {:g} × range',
        lambda: product(DARKEST, REACHES, SHARES),
        three,
    ),
}
