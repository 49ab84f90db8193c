# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Hierarchical outlier detection as textbook loops: the slow twin of the fast one.

Nothing of the package is imported here, so that no mistake can be shared. The method is that of
Sotoodeh, "Hierarchical clustered outlier detection in laser scanner point clouds" (2007), section
3, on the complete graph. Distances are compared by their squares. Coincident points are one place:
they have no edges of their own, and each of them counts in the size of its cluster.
"""

from collections.abc import Sequence
from math import inf, nan, sqrt
from statistics import NormalDist, median, stdev
from typing import NamedTuple

import numpy as np

from naive.lof import squared

Position = tuple[float, float, float]
Edge = tuple[int, int]

MIN_SPREAD = 1e-3  # of the median: edges that differ by rounding alone are equally long


class Verdict(NamedTuple):
    """What the two phases say: score, phase that rejected (0: none), points of the cluster."""

    score: list[float]
    phase: list[int]
    cluster: list[int]


def limit(lengths: Sequence[float], confidence: float) -> float:
    """Longest edge that is not cut: the median + the half width of the two-sided interval."""
    if not lengths:
        return inf
    spread = stdev(lengths) if len(lengths) > 1 else 0.0
    spread = max(spread, MIN_SPREAD * median(lengths))
    return median(lengths) + NormalDist().inv_cdf((1 + confidence) / 2) * spread


def spanning_tree(positions: Sequence[Position]) -> list[Edge]:
    """Shortest edges that hold all positions together, out of the complete graph (Prim)."""
    edges = []
    distance = {q: (squared(positions[0], positions[q]), 0) for q in range(1, len(positions))}
    while distance:
        q = min(distance, key=lambda one: distance[one])
        edges.append((distance.pop(q)[1], q))
        for other, known in distance.items():
            distance[other] = min(known, (squared(positions[q], positions[other]), q))
    return edges


def gabriel_graph(positions: Sequence[Position]) -> list[Edge]:
    """All pairs whose diametral ball is open and empty: no other place sees them at more than 90°.

    Erratum: the paper speaks of the largest ball through both positions; it means the smallest.
    """
    xyz = np.array(positions, np.float64).reshape(-1, 3)
    away = xyz[:, None] - xyz  # from the second point to the first one
    edges = []
    for p in range(len(positions)):
        # For every q the angle in which every r sees p and q.
        x, y, z = np.moveaxis(away[p] * away, -1, 0)
        seen = ((x + y) + z < 0).any(axis=1)
        edges += [(p, q) for q in range(p + 1, len(positions)) if not seen[q]]
    return edges


def prune(positions: Sequence[Position], edges: Sequence[Edge], confidence: float) -> list[Edge]:
    """Cut the edges that are longer than the limit of all of them."""
    lengths = [sqrt(squared(positions[p], positions[q])) for p, q in edges]
    longest = limit(lengths, confidence)
    return [edge for edge, length in zip(edges, lengths, strict=True) if length <= longest]


def components(count: int, edges: Sequence[Edge]) -> list[list[int]]:
    """Vertices that edges hold together, by walking from one to the next."""
    neighbours: list[list[int]] = [[] for _ in range(count)]
    for p, q in edges:
        neighbours[p].append(q)
        neighbours[q].append(p)
    found, seen = [], [False] * count
    for start in range(count):
        walk = [] if seen[start] else [start]
        seen[start] = True
        for p in walk:
            for q in neighbours[p]:
                if not seen[q]:
                    seen[q] = True
                    walk.append(q)
        if walk:
            found.append(walk)
    return found


def detect(
    cloud: Sequence[Sequence[float]],
    global_confidence: float,
    local_confidence: float,
    min_cluster: int,
) -> Verdict:
    """Run both phases."""
    members: dict[Position, list[int]] = {}
    for i, (x, y, z) in enumerate(cloud):
        members.setdefault((float(x), float(y), float(z)), []).append(i)
    verdict = Verdict([nan] * len(cloud), [0] * len(cloud), [0] * len(cloud))
    if len(cloud) < min_cluster:
        return verdict

    def size(positions: Sequence[Position]) -> int:
        return sum(len(members[place]) for place in positions)

    def settle(positions: Sequence[Position], phase: int) -> bool:
        small = size(positions) < min_cluster
        for i in (i for place in positions for i in members[place]):
            verdict.cluster[i] = size(positions)
            verdict.score[i] = min_cluster / size(positions)
            verdict.phase[i] = phase if small else 0
        return small

    everything = list(members)
    tree = prune(everything, spanning_tree(everything), global_confidence)
    for rough in components(len(everything), tree):
        positions = [everything[p] for p in rough]
        if settle(positions, 1):
            continue
        graph = prune(positions, gabriel_graph(positions), local_confidence)
        for fine in components(len(positions), graph):
            settle([positions[p] for p in fine], 2)
    return verdict
