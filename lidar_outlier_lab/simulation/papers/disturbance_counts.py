# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Which of the shots that could go wrong do, so that a cloud has the outliers that it is to have.

More shots are disturbed than are needed. Of these, some are chosen by lot; the others measure what
they would have measured undisturbed.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation.truth import Cause
from lidar_outlier_lab.simulation.world.drive import Block, Drive, Returns, cast, merge


def gather(
    drive: Drive, points: int | None = None, progress: Callable[[float], object] = lambda _: None
) -> Block:
    """Cast a drive until ``points`` shots have an echo, undisturbed; None: all of it.

    ``progress`` is called with the share done.

    Raises
    ------
    FilterError
        If the whole drive has fewer points.

    """
    blocks, found = [], 0
    for end, block in cast(drive):
        blocks.append(block)
        found += len(block.clean.shot)
        progress(end / drive.shots if points is None else min(found / points, 1.0))
        if points is not None and found >= points:
            break
    if points is not None and found < points:
        raise FilterError('the points of the drive', f'at least {points}', found)
    return Block(
        _join([block.clean for block in blocks]),
        _join([block.spoilt for block in blocks]),
        np.concatenate([block.lot for block in blocks]),
    )


def _join(parts: list[Returns]) -> Returns:
    return Returns(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def exactly(block: Block, points: int, outliers: int) -> Returns:
    """Take the first ``points`` shots with an echo, and disturb some, so that ``outliers`` are.

    Raises
    ------
    FilterError
        If the scene itself makes more outliers, or too few shots are disturbed.

    """
    clean = block.clean.take(slice(0, points))
    at = _same_shots(clean, block.spoilt)
    # Only shots that stay a point, and become an outlier.
    fit = at.inside & (clean.points['label'][at.where] == Cause.GOOD)
    candidates, lot = block.spoilt.take(fit), block.lot[fit]
    own = int(np.count_nonzero(clean.points['label']))
    _check(outliers, own, own + len(lot), points)
    chosen = np.sort(np.argsort(lot, kind='stable')[: outliers - own])
    return merge(clean, candidates.take(chosen))


def about(block: Block, share: float) -> Returns:
    """Disturb some shots, so that the share of outliers comes as near to ``share`` as it can.

    Raises
    ------
    FilterError
        If the scene itself makes a larger share, or too few shots are disturbed.

    """
    clean, spoilt = block.clean, block.spoilt
    at = _same_shots(clean, spoilt)
    order = np.argsort(block.lot, kind='stable')
    is_new = ~at.inside[order]
    was_good = clean.points['label'][at.where[order]] == Cause.GOOD
    points = len(clean.shot) + np.concatenate([[0], np.cumsum(is_new)])
    own = np.count_nonzero(clean.points['label'])
    outliers = own + np.concatenate([[0], np.cumsum(is_new | was_good)])
    shares = outliers / points
    if not shares[0] <= share <= shares[-1]:
        raise FilterError('the share', f'from {shares[0]:.6f} to {shares[-1]:.6f} here', share)
    chosen = np.sort(order[: int(np.argmin(np.abs(shares - share)))])
    return merge(clean, spoilt.take(chosen))


class _SameShots(NamedTuple):
    """Where the shots of some returns are among those of others."""

    where: NDArray[np.intp]
    inside: NDArray[np.bool_]


def _same_shots(clean: Returns, spoilt: Returns) -> _SameShots:
    where = np.minimum(np.searchsorted(clean.shot, spoilt.shot), max(len(clean.shot) - 1, 0))
    return _SameShots(where, clean.shot[where] == spoilt.shot)


def _check(outliers: int, fewest: int, most: int, points: int) -> None:
    if not fewest <= outliers <= most:
        must_be = f'from {fewest / points:.6f} to {most / points:.6f} here'
        raise FilterError('the share', must_be, f'{outliers / points:.6f}')
