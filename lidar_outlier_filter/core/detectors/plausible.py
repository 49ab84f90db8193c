# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of verdicts that need no labels: what is rejected is not much, and forms no surfaces."""

from collections.abc import Sequence

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.errors import CloudError

# Of the points, up to which nothing is checked: clean data have far less rejected.
MIN_REJECTED_SHARE = 0.03
MIN_REJECTED = 64  # points, fewer show no surface
SAMPLE_POINTS = 512  # rejected points that are looked at
NEAREST = 8  # other rejected points
# Typical thickness ÷ extent of rejected neighbours. In simulated snow, fog, dust and spray it was
# 0.24 and more, also where 58 % of the points were fog; of surfaces 0.001.
MAX_FLATNESS = 0.05
# Thickness ÷ extent of a cloud in one plane, as a profile scanner's in its own frame: 1e-4.
MAX_THICKNESS = 0.005
# Share of a file or topic that the default detector may reject unasked. Of labelled clouds up to
# 10 % were outliers; methods that do not fit a file rejected half of it, and more.
MAX_REJECTED_SHARE = 0.15
MIN_SHARE_POINTS = 1000  # points, of which fewer show no share


def rejects_surfaces(xyz: Floats, rejected: Bools, threads: int = 0) -> bool:
    """Return whether many points are rejected, and these lie on surfaces or lines.

    Parameters
    ----------
    xyz : (N, 3) float64
        Metres, in any frame.
    rejected : (N,) bool
    threads : maximum number of threads; 0: all cores

    """
    count = np.count_nonzero(rejected)
    if count < max(MIN_REJECTED_SHARE * len(xyz), MIN_REJECTED):
        return False
    hood, _, _ = Neighbourhood(xyz[rejected], NEAREST, threads).distinct()
    if len(hood) < MIN_REJECTED:
        return False
    some = np.arange(0, len(hood), -(-len(hood) // SAMPLE_POINTS))
    near = hood.xyz[np.column_stack([some, hood.nearest_of(some, NEAREST)])]
    about = near - near.mean(axis=1, keepdims=True)
    squares = np.linalg.eigvalsh(np.einsum('ski,skj->sij', about, about))
    extent = np.maximum(squares.sum(axis=1), np.finfo(float).tiny)
    return bool(np.median(np.maximum(squares[:, 0], 0.0) / extent) < MAX_FLATNESS**2)


def is_in_one_plane(xyz: Floats) -> bool:
    """Return whether all points (N, 3) lie in a plane: then what is rejected does, too."""
    some = xyz[:: max(len(xyz) // SAMPLE_POINTS, 1)]
    least, *others = np.linalg.eigvalsh(np.cov(some, rowvar=False)).tolist()
    return bool(least < MAX_THICKNESS**2 * sum(others))


def check_share(
    what: str,
    rejected: int,
    tested: int,
    methods: Sequence[str],
    accepted: float | None,
    *,
    helps: str = '',
) -> None:
    """Refuse verdicts that reject more than can be outliers, unless the user accepts that.

    Detectors other than the default reject as much as their thresholds say: they have no limit.

    Parameters
    ----------
    what : the file or topic, for the sentence
    rejected, tested : points
    methods : how the default judged, by name; empty: other detectors did
    accepted : share of the tested points that may be rejected; None: what the default may
    helps : what may judge better, for the sentence

    """
    limit = accepted
    if limit is None:
        limit = MAX_REJECTED_SHARE if methods and tested >= MIN_SHARE_POINTS else 1.0
    share = rejected / max(tested, 1)
    if share > limit:
        by = f' by {" and by ".join(methods)}' if methods else ''
        must_be = f'at most {limit:.1%} of the points, unless --accept-share says so{helps}'
        raise CloudError(f'what is rejected of {what}', must_be, f'{share:.1%}{by}')
