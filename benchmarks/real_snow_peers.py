# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Peers on sweeps of WADS, each with the thresholds that are best for its labels.

Nobody knows these thresholds in the field: the labels are what is to be found. Copies take no part
in neighbourhoods, as each would be its own nearest neighbour. They get the verdict of what they are
copies of. All sweeps have the same thresholds.
"""

# ruff: noqa: INP001  a part of a script, no package

from __future__ import annotations

from itertools import product
from time import perf_counter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from real_snow_forms import Verdict
from scipy.spatial import cKDTree

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from numpy.typing import NDArray
    from real_snow_forms import Cloud
    from real_snow_sweeps import Floats, Mask

    from lidar_outlier_filter.annotations import Singles


NEIGHBOURS = 20  # of SOR and LOF
NEAREST = 10  # whose distances the rules use
SPACING = np.radians(0.2)  # between shots
AVERAGED = 5  # distances of the range-scaled one
MULTIPLES = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 14.0, 20.0)
LEAST = (0.02, 0.04, 0.07, 0.1, 0.15, 0.2, 0.3)  # metres
COUNTS = (1, 2, 3, 4, 5, 6, 8, 10)
DARKEST = (0, 1, 2, 4, 8)
REACHES = (10.0, 12.0, 15.0, 20.0, 30.0, 71.0)  # metres; LIOR's own is 71
RADII = (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5)  # metres; 0: neighbours do not matter
SHARES = (0.004, 0.007, 0.01, 0.014, 0.02, 0.03)  # of the range


class Features(NamedTuple):
    """What peers see of the N points of all clouds, copies among them.

    ``near`` (N, 10) are distances to the nearest points, ``sor`` the mean of 20 of them, as
    standard deviations from the mean of the sweep, ``lof`` the local outlier factor, all (N,).
    ``seconds`` is what neighbours took, ``splits`` where clouds end.
    """

    snow: Mask
    range: Singles
    flat: Singles
    intensity: Singles
    near: Singles
    sor: Singles
    lof: Singles
    seconds: float
    splits: NDArray[np.int64]


def features(clouds: Sequence[Cloud]) -> Features:
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


def neighbours(cloud: Cloud) -> tuple[Singles, Singles, Singles]:
    """Return distances to the nearest points, SOR's and LOF's statistics; see ``Features``."""
    own = np.flatnonzero(cloud.source == np.arange(len(cloud)))
    xyz = cloud.xyz[own].astype(np.float64)
    distance, index = cKDTree(xyz).query(xyz, NEIGHBOURS + 1, workers=-1)
    distance, index = distance[:, 1:], index[:, 1:]
    mean = distance.mean(axis=1)
    far = distance[:, -1]
    density = NEIGHBOURS / np.maximum(distance, far[index]).sum(axis=1).clip(1e-9)
    of = np.searchsorted(own, cloud.source)  # the measured point of each
    found = (
        distance[:, :NEAREST],
        (mean - mean.mean()) / mean.std(),
        density[index].mean(axis=1) / density,
    )
    near, sor, lof = (one.astype(np.float32)[of] for one in found)
    return near, sor, lof


def f1(snow: Mask, rejected: Mask) -> float:
    """Return the harmonic mean of precision and recall."""
    both = int(np.count_nonzero(snow)) + int(np.count_nonzero(rejected))
    return 2 * int(np.count_nonzero(snow & rejected)) / max(both, 1)


def best_threshold(score: Singles, snow: Mask) -> float:
    """Return the threshold with the best F1, where points from it on are rejected."""
    order = np.argsort(-score)
    ranked = score[order]
    found = np.cumsum(snow[order])
    values = 2 * found / (np.arange(1, len(score) + 1) + found[-1])
    values[:-1][ranked[1:] == ranked[:-1]] = -1.0  # equal scores are rejected together
    return float(ranked[values.argmax()])


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
    rule: Callable[..., Mask],
) -> Callable[[Features], Verdict]:
    """Make a judge of a rule with several parameters, all of whose settings are tried."""

    def judge(seen: Features) -> Verdict:
        found = [(f1(seen.snow, rule(seen, *one)), one) for one in settings()]
        setting = max(found)[1]
        rejected = np.split(rule(seen, *setting), seen.splits)
        return Verdict(rejected, seen.seconds, said.format(*setting))

    return judge


def dror(seen: Features, multiple: float, least: float, count: float) -> Mask:
    """Reject what has fewer than so many points within a radius that grows with the range."""
    radius = np.maximum(least, multiple * SPACING * seen.flat)
    found: Mask = seen.near[:, int(count) - 1] > radius
    return found


def lior(seen: Features, darkest: float, reach: float, radius: float, count: float) -> Mask:
    """Reject what is dark, near, and has fewer than so many points within a radius."""
    dark = (seen.intensity <= darkest) & (seen.range < reach)
    found: Mask = dark & (seen.near[:, int(count) - 1] >= radius)
    return found


def three(seen: Features, darkest: float, reach: float, share: float) -> Mask:
    """Reject what is dark, near, and far from others for its range."""
    dark = (seen.intensity <= darkest) & (seen.range < reach)
    found: Mask = dark & (scaled(seen) > share)
    return found


def scaled(seen: Features) -> Floats:
    """Return the mean distance to five others as a part of the range."""
    found: Floats = seen.near[:, :AVERAGED].mean(axis=1) / seen.range
    return found


PEERS: dict[str, Callable[[Features], Verdict]] = {
    'DROR': _ruled(
        'radius {:g} × 0.2° × range, at least {:g} m; fewer than {:g} others',
        lambda: product(MULTIPLES, LEAST, COUNTS),
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
