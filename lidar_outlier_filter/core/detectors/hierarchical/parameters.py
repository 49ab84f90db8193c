# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of the clusters of graphs."""

from __future__ import annotations

from dataclasses import dataclass

from lidar_outlier_filter.parameters.declaration import Section, declare


@dataclass(frozen=True)
class Hierarchical(Section):
    """Clusters that a graph falls into when its long edges are cut."""

    global_confidence: float = declare(
        0.99,
        'Phase 1: edges of the spanning tree that are longer than this two-sided interval around '
        'the median allows are cut.',
        '',
        0.0,
        1.0 - 1e-9,
    )
    local_confidence: float = declare(
        0.95,
        'Phase 2: the same for the Gabriel graph of each cluster of phase 1.',
        '',
        0.0,
        1.0 - 1e-9,
    )
    min_cluster: int = declare(
        100,
        'Fewest points of a cluster that is kept; fewer points altogether stay untested.',
        '',
        1,
        1_000_000_000,
    )
