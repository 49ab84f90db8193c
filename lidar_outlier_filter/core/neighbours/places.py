# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Points that lie at one place, as in clouds that were rounded or merged: they are judged as one.

Their distances of 0 would make every other distance look large.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Floats, Ints
    from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood


class Places(NamedTuple):
    """The M places at which N points lie.

    Attributes
    ----------
    first : (M,) int64
        The first point at each place; they ascend.
    of : (N,) int64
        The place of each point, from 0 to M - 1.

    """

    first: Ints
    of: Ints


def find_places(xyz: Floats) -> Places:
    """Find the places of points (N, 3), metres, finite; 0 and -0 are one.

    Examples
    --------
    >>> import numpy as np
    >>> from lidar_outlier_filter.core.neighbours.places import find_places
    >>> places = find_places(np.array([[2.0, 0, 0], [1, 0, 0], [2, 0, 0]]))
    >>> places.first.tolist(), places.of.tolist()
    ([0, 1], [0, 1, 0])

    """
    order = np.lexsort(xyz.T)  # points at one place stay in their order
    ordered = np.take(xyz, order, axis=0)
    begins = np.ones(len(xyz), np.bool_)
    begins[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    group = np.empty(len(xyz), np.int64)
    group[order] = np.cumsum(begins) - 1
    first = order[begins]
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return Places(np.sort(first), rank[group])


def shares_places(hood: Neighbourhood, k: int) -> bool:
    """Return whether any point has its nearest neighbour, of k that are listed, at its place."""
    nearest = np.take(hood.xyz, hood.nearest(k).index[:, 0], axis=0)
    return bool((nearest == hood.xyz).all(axis=1).any())
