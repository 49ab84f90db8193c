# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Outliers made from a user's own good points, as Pirotti et al. (2018) made theirs.

Points picked at random are moved; their time and scan line stay, as for a wrongly measured shot.
Class 1 are single points, class 2 clusters, which stay together.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from lidar_outlier_filter.core.annotations import Bools, Floats, Ints
from lidar_outlier_filter.core.points.points import SECOND, Points
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation.truth import Cause

MAX_SHARE = 0.5
CLUSTERED = 0.5  # of the outliers
MIN_SIZE, MAX_SIZE = 2, 30  # points of a cluster
SPREAD = 0.3  # metres, standard deviation of the points around the middle of their cluster
WINDOW_NS = SECOND // 5  # good points up to so many nanoseconds apart are seen together
TRIES = 200  # until a position is given up to be found


@dataclass(frozen=True)
class Injection:
    """Settings of injected outliers; everything else is as in Pirotti et al.

    Attributes
    ----------
    share : of all points
    distance : (low, high)
        Metres from the position a point had, at random between them; and at least low from every
        good point that is seen with it. The middle of a cluster moves by at least
        2 low, in the paper 2 m.
    seed : the same seed, the same outliers

    """

    share: float = 0.0026
    distance: tuple[float, float] = (1.0, 200.0)
    seed: int = 1

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        low, high = self.distance
        if not 0 < self.share <= MAX_SHARE:
            must_be = f'more than 0, at most {MAX_SHARE}'
            raise FilterError('the share of outliers to inject', must_be, self.share)
        if not 0 < 2 * low < high < np.inf:
            got = f'{low:g} and {high:g}'
            raise FilterError('the distances of outliers', 'LOW and HIGH > 2 LOW > 0', got)


def inject(
    clouds: Sequence[Points], how: Injection, eyes: Sequence[Floats | None] = ()
) -> tuple[list[Points], Ints]:
    """Move some points of clouds, all of them valid, to empty space.

    ``eyes`` (N, 4, 3): for each point of a moved cloud, the sensor's position, and the positions
    1 m along its axes.

    Returns
    -------
    clouds : list of Points
        The same points, in the same order.
    code : (N,) int64
        Of all points of all clouds: ``Cause.GOOD``, ``SINGLE`` or ``CLUSTER``.

    """
    rng = np.random.default_rng(how.seed)
    first = np.cumsum([0, *(len(cloud) for cloud in clouds)])
    code, groups = _choose(first, how.share, rng)
    xyz = np.concatenate([cloud.xyz for cloud in clouds])
    t = np.concatenate([cloud.t for cloud in clouds])
    slot = (t - t.min()) // WINDOW_NS
    good = np.flatnonzero(code == Cause.GOOD)
    good = good[np.argsort(slot[good], kind='stable')]
    at = np.array([slot[group.start] for group in groups])
    for number in np.unique(at).tolist():
        # A cluster may end in the next slot, which is seen with the one behind it.
        begin, end = np.searchsorted(slot[good], (number - 1, number + 3))
        mine = [groups[k] for k in np.flatnonzero(at == number)]
        _move(xyz, mine, xyz[good[begin:end]], how.distance, rng)
    made = []
    for number, (cloud, start) in enumerate(zip(clouds, first.tolist(), strict=False)):
        part = slice(start, start + len(cloud))
        own, eye = cloud.own, eyes[number] if eyes else None
        if own is not None and eye is not None:
            away, axes = xyz[part] - eye[:, 0], eye[:, 1:] - eye[:, :1]
            there = np.einsum('nj,nkj->nk', away, axes)
            own = np.where(code[part, None] == Cause.GOOD, own, there)
        made.append(replace(cloud, xyz=xyz[part], own=own))
    return made, code


def _choose(first: Ints, share: float, rng: np.random.Generator) -> tuple[Ints, list[slice]]:
    """Choose which points become outliers: stretches of neighbours, and single ones between."""
    total = int(first[-1])
    count = round(share * total)
    if count < 1:
        must_be = f'enough for one outlier at a share of {share:g}'
        raise FilterError('the points to inject outliers into', must_be, total)
    code = np.full(total, int(Cause.GOOD), np.int64)
    cloud_of = np.repeat(np.arange(len(first) - 1), np.diff(first))
    groups: list[slice] = []
    left = round(CLUSTERED * count)
    for _ in range(TRIES * (count // MIN_SIZE + 1)):
        if left < MIN_SIZE:
            break
        size = min(int(rng.integers(MIN_SIZE, MAX_SIZE, endpoint=True)), left)
        start = int(rng.integers(total - size + 1)) if size <= total else 0
        members = slice(start, start + size)
        # Neighbours of one cloud, and of no other cluster.
        if cloud_of[start] == cloud_of[members.stop - 1] and not code[members].any():
            code[members] = Cause.CLUSTER
            groups.append(members)
            left -= size
    singles = count - int(np.count_nonzero(code))
    chosen = rng.choice(np.flatnonzero(code == Cause.GOOD), singles, replace=False)
    code[chosen] = Cause.SINGLE
    return code, groups + [slice(index, index + 1) for index in np.sort(chosen).tolist()]


def _move(
    xyz: Floats,
    groups: Sequence[slice],
    good: Floats,
    distance: tuple[float, float],
    rng: np.random.Generator,
) -> None:
    """Move groups of points as a whole, until none is too near to a good point."""
    tree, left = cKDTree(good), groups
    low, high = distance
    for _ in range(TRIES):
        moved = [_moved(xyz[group], low, high, rng) for group in left]
        near: Bools = tree.query(np.concatenate(moved), workers=-1)[0] < low
        which = np.repeat(np.arange(len(left)), [len(points) for points in moved])
        failed = np.bincount(which[near], minlength=len(left)) > 0
        for group, points, again in zip(left, moved, failed.tolist(), strict=True):
            if not again:
                xyz[group] = points
        left = [left[k] for k in np.flatnonzero(failed).tolist()]
        if not left:
            return
    must_be = f'with room {low:g} to {high:g} m away from all points'
    raise FilterError('the cloud to inject outliers into', must_be, 'none found')


def _moved(points: Floats, low: float, high: float, rng: np.random.Generator) -> Floats:
    """Give a group another position: a single point, or a cluster around its first one."""
    single = len(points) == 1
    direction = rng.standard_normal(3)
    direction /= np.linalg.norm(direction)
    middle: Floats = points[0] + direction * rng.uniform(low if single else 2 * low, high)
    if single:
        return middle[None]
    around: Floats = middle + SPREAD * rng.standard_normal(points.shape)
    return around
