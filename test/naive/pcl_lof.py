# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""PCL-LOFFilter as textbook loops: the slow twin that the fast one is compared with.

As its three passes do: the k nearest points of each, itself among them, with squares of distances;
k over the sum of squared reach distances; the mean ratio of these densities.
"""

from collections.abc import Sequence

Cloud = Sequence[Sequence[float]]


def factors(cloud: Cloud, k: int) -> list[float]:
    """LOF of each point, computed exactly as in the code of PCL."""
    near: list[list[tuple[float, int]]] = []
    for p in cloud:
        square = [
            (sum((a - b) ** 2 for a, b in zip(p, q, strict=True)), i) for i, q in enumerate(cloud)
        ]
        near.append(sorted(square)[:k])
    density = []
    for mine in near:
        reach = [max(near[o][k - 1][0], square) for square, o in mine]
        density.append(k / sum(reach))
    return [sum(density[o] / density[p] for _, o in mine) / k for p, mine in enumerate(near)]
