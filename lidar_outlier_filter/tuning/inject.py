# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Outliers made from a user's own good points, as Pirotti et al. (2018) made theirs.

Points picked at random leave their position; their time and scan line stay, as those of a shot that
was measured wrongly. Class 1 are single points, class 2 clusters, which keep together.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.messages.truth import Cause

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from lidar_outlier_filter.core.annotations import Floats, Ints
    from lidar_outlier_filter.core.points.points import Points


MOST_SHARE = 0.5
TRIES = 200  # until a position is given up to be found


@dataclass(frozen=True)
class Injection:
    """How many outliers of which kind; the defaults are those of Pirotti et al.

    Attributes
    ----------
    share : of all points
    distance : (low, high)
        Metres from the position a point had, at random between them; and at least low from every
        good point that is seen with it. Clusters are twice as far at least: theirs is the
        distance of the middle, and the paper has 2 m for it.
    clustered : share of the outliers that are in clusters, as far as these find points that were
        taken after each other
    size : (low, high)
        Points of a cluster, both inclusive.
    spread : standard deviation of the points around the middle of their cluster, metres
    window : good points up to so many seconds apart are seen together
    seed : the same seed, the same outliers

    """

    share: float = 0.0026
    distance: tuple[float, float] = (1.0, 200.0)
    clustered: float = 0.5
    size: tuple[int, int] = (2, 30)
    spread: float = 0.3
    window: float = 0.2
    seed: int = 1

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        low, high = self.distance
        if not 0 < self.share <= MOST_SHARE:
            must_be = f'more than 0, at most {MOST_SHARE}'
            raise FilterError('the share of outliers to inject', must_be, self.share)
        if not 0 < 2 * low < high < np.inf:
            got = f'{low:g} and {high:g}'
            raise FilterError('the distances of outliers', 'LOW and HIGH > 2 LOW > 0', got)


def inject(
    clouds: Sequence[Points], how: Injection, eyes: Sequence[Floats | None] = ()
) -> tuple[list[Points], Ints]:
    """Move some points of clouds, all of them valid, to where no point is.

    ``eyes`` (N, 4, 3) says of clouds that were moved where the sensor was, and what lay 1 m off on
    each of its axes.

    Returns
    -------
    clouds : list of Points
        The same points, in the same order.
    code : (N,) int64
        Of all points of all clouds: ``Cause.GOOD``, ``SINGLE`` or ``CLUSTER``.

    Raises
    ------
    FilterError
        If there are too few points, or no position is far enough from all of them.

    """
    rng = np.random.default_rng(how.seed)
    first = np.cumsum([0, *(len(cloud) for cloud in clouds)])
    code, groups = _choose(first, how, rng)
    xyz = np.concatenate([cloud.xyz for cloud in clouds]) if clouds else np.zeros((0, 3))
    is_good = code == Cause.GOOD
    for begin, end, seen in _windows(clouds, first, how.window):
        good = np.concatenate([xyz[part][is_good[part]] for part in seen])
        for kind in (Cause.SINGLE, Cause.CLUSTER):
            here = bisect_left(groups[kind], begin, key=lambda group: group.start)
            there = bisect_left(groups[kind], end, key=lambda group: group.start)
            _move(xyz, groups[kind][here:there], good, how, rng)
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


def _choose(
    first: Ints, how: Injection, rng: np.random.Generator
) -> tuple[Ints, dict[Cause, list[slice]]]:
    """Choose which points become outliers: stretches of neighbours, and single ones between."""
    total = int(first[-1])
    requested = round(how.share * total)
    if requested < 1:
        must_be = f'enough for one outlier at a share of {how.share:g}'
        raise FilterError('the points to inject outliers into', must_be, total)
    code = np.full(total, int(Cause.GOOD), np.int64)
    cloud_of = np.repeat(np.arange(len(first) - 1), np.diff(first))
    groups: dict[Cause, list[slice]] = {Cause.SINGLE: [], Cause.CLUSTER: []}
    left = round(how.clustered * requested)
    smallest, largest = how.size
    for _ in range(TRIES * (requested // smallest + 1)):
        if left < smallest:
            break
        size = min(int(rng.integers(smallest, largest, endpoint=True)), left)
        start = int(rng.integers(total - size + 1)) if size <= total else 0
        members = slice(start, start + size)
        # Neighbours of one cloud, and of no other cluster.
        if cloud_of[start] == cloud_of[members.stop - 1] and not code[members].any():
            code[members] = Cause.CLUSTER
            groups[Cause.CLUSTER].append(members)
            left -= size
    groups[Cause.CLUSTER].sort(key=lambda group: group.start)
    singles = requested - int(np.count_nonzero(code))
    free = np.flatnonzero(code == Cause.GOOD)
    for index in np.sort(rng.choice(free, singles, replace=False)).tolist():
        code[index] = Cause.SINGLE
        groups[Cause.SINGLE].append(slice(index, index + 1))
    return code, groups


def _windows(
    clouds: Sequence[Points], first: Ints, window: float
) -> Iterator[tuple[int, int, list[slice]]]:
    """Put clouds together: their points, from where to where, and all that are seen with these.

    Those of other clouds up to a window before the first of them and after the last.
    """
    there = [number for number, cloud in enumerate(clouds) if len(cloud) > 0]
    low = np.array([clouds[number].t.min() for number in there])
    high = np.array([clouds[number].t.max() for number in there])
    parts = [slice(int(first[number]), int(first[number + 1])) for number in there]
    longest, begin = round(window * SECOND), 0
    while begin < len(there):
        late = np.flatnonzero(high[begin + 1 :] - low[begin] > longest)
        end = begin + 1 + int(late[0]) if len(late) else len(there)
        until, since = high[begin:end].max() + longest, low[begin:end].min() - longest
        seen = np.flatnonzero((low <= until) & (high >= since)).tolist()
        yield parts[begin].start, parts[end - 1].stop, [parts[k] for k in seen]
        begin = end


def _move(
    xyz: Floats,
    groups: Sequence[slice],
    good: Floats,
    how: Injection,
    rng: np.random.Generator,
) -> None:
    """Move groups of points as a whole, until none is too near to a good point."""
    if not groups:
        return
    tree = cKDTree(good)
    low, high = how.distance
    left = list(groups)
    for _ in range(TRIES):
        moved = [_moved(xyz[group], low, high, how.spread, rng) for group in left]
        sizes = [len(points) for points in moved]
        near = tree.query(np.concatenate(moved), workers=-1)[0] < low
        which = np.repeat(np.arange(len(left)), sizes)
        failed = np.bincount(which[near], minlength=len(left)) > 0
        for group, points, again in zip(left, moved, failed.tolist(), strict=True):
            if not again:
                xyz[group] = points
        left = [group for group, again in zip(left, failed.tolist(), strict=True) if again]
        if not left:
            return
    must_be = f'with room {low:g} to {high:g} m away from all points'
    raise FilterError('the cloud to inject outliers into', must_be, 'none found')


def _moved(
    points: Floats, low: float, high: float, spread: float, rng: np.random.Generator
) -> Floats:
    """Give a group another position: a single point, or a cluster around its first one."""
    single = len(points) == 1
    direction = rng.standard_normal(3)
    direction /= np.linalg.norm(direction)
    middle: Floats = points[0] + direction * rng.uniform(low if single else 2 * low, high)
    if single:
        return middle[None]
    around: Floats = middle + spread * rng.standard_normal(points.shape)
    return around
