# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Classes of LAS points: which stay untouched, and what goes of each."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.errors import CloudError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lidar_outlier_filter.annotations import Bools, Bytes
    from lidar_outlier_filter.files.cloud_file import CloudFile

CLASSIFICATION = 'classification'
MOST = 255  # the highest class


def check(file: CloudFile, named: Sequence[int]) -> None:
    """Refuse classes that no file, or this one, can have.

    Raises
    ------
    CloudError
        If its format has none, or there is no class of such a number.

    """
    if named and not file.classes:
        raise CloudError(f'the classes of {file.path}', 'in the file (LAS, LAZ)', 'none')
    for one in named:
        if not 0 <= one <= MOST:
            raise CloudError('a class', f'from 0 to {MOST}', one)


def untouched(classes: Bytes, only: Sequence[int], keep: Sequence[int]) -> Bools:
    """Return which points stay as they are: of other classes than ``only``, or of ``keep``."""
    kept = np.isin(classes, keep)
    if only:
        kept |= ~np.isin(classes, only)
    return kept


def spare(verdict: Verdict, kept: Bools) -> Verdict:
    """Return a verdict that rejects none of some points: they count as never tested."""
    result = verdict.take(np.s_[:])
    spared = Verdict(*(values.copy() for values in vars(result).values()))
    where = np.flatnonzero(kept & verdict.rejected)
    spared.put(where, Verdict.untested(len(where)))
    return spared


def by_class(classes: Bytes, rejected: Bools) -> dict[int, tuple[int, int]]:
    """Count the points of each class, and those of them that are rejected."""
    points = np.bincount(classes, minlength=MOST + 1)
    gone = np.bincount(classes[rejected], minlength=MOST + 1)
    return {int(one): (int(points[one]), int(gone[one])) for one in np.flatnonzero(points)}
