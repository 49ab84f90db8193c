# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The verdict: what the detectors of a chain say of each point."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.parameters.declaration import BITS, MASKED, MASKED_REASON, SHADOW_REASON

Part = slice | NDArray[np.intp] | NDArray[np.bool_]

# Columns that clouds and files gain.
SCORE, DETECTORS, REASON = 'outlier_score', 'outlier_detectors', 'outlier_reason'
OUTLIER = 'outlier'
ALL = sum(BITS)  # bits for detectors
# Bits beside that of a detector, which say more of the point, as it declares. Alone they say
# nothing, and have no vote.
EXTRA = 0xFFFF & ~ALL & ~MASKED


@dataclass(frozen=True)
class Verdict:
    """Verdict of a chain on N points.

    Attributes
    ----------
    score : (N,) float32
        The largest score any detector gave; NaN for a point that none could test, inf for one on
        the own vehicle.
    detectors : (N,) uint16
        Bits of the detectors whose score exceeds 1, and their ``EXTRA`` bits; ``MASKED`` alone for
        a point on the own vehicle.
    undecided : (N,) uint16
        The bits of the detectors that could not test the point.
    rejected : (N,) bool
        Whether the point is an outlier: by at least max(1, ``vote``) detectors, or ``masked``.
    reason : (N,) uint8
        Why, where ``scores`` are requested: a number that :func:`.registry.reasons` names, or 0.

    Examples
    --------
    >>> import numpy as np
    >>> from lidar_outlier_filter import detect_outliers
    >>> verdict = detect_outliers(np.array([[0, 0, 0], [0, 0, 1], [0, 0, 2.0]]), chain=['sor'])
    >>> len(verdict), verdict.outlier.tolist(), np.isnan(verdict.score).all()
    (3, [False, False, False], np.True_)

    """

    score: NDArray[np.float32]
    detectors: NDArray[np.uint16]
    undecided: NDArray[np.uint16]
    rejected: NDArray[np.bool_]
    reason: NDArray[np.uint8]

    @classmethod
    def untested(cls, count: int) -> Verdict:
        """Return the verdict of points that no detector has judged."""
        return cls(
            np.full(count, np.nan, np.float32),
            np.zeros(count, np.uint16),
            np.zeros(count, np.uint16),
            np.zeros(count, np.bool_),
            np.zeros(count, np.uint8),
        )

    @classmethod
    def beforehand(cls, points: Points) -> Verdict:
        """Return the verdict before any detector judges: only the own vehicle is rejected."""
        verdict = cls.untested(len(points))
        if points.masked is not None:
            verdict.score[points.masked] = np.inf
            verdict.detectors[points.masked] = MASKED
            verdict.rejected[points.masked] = True
            verdict.reason[points.masked] = MASKED_REASON
            if points.shadow is not None:
                verdict.reason[points.masked & points.shadow] = SHADOW_REASON
        return verdict

    @property
    def masked(self) -> NDArray[np.bool_]:
        """Which points are on the own vehicle."""
        return np.asarray((self.detectors & MASKED) != 0)

    def __len__(self) -> int:
        """Count the points."""
        return len(self.score)

    @property
    def outlier(self) -> NDArray[np.bool_]:
        """Which points are outliers: the same as ``rejected``, in the words of the library."""
        return self.rejected

    def add(self, bit: int, where: NDArray[np.intp], found: Scores) -> None:
        """Add the scores of one detector for some of the points; NaN means undecided."""
        columns = self.score, self.detectors, self.undecided
        _kernels.add_scores(bit, where, found.score, *columns)
        if found.extra is not None:
            self.detectors[where] |= found.extra
        if found.reason is not None:
            self.reason[where] = np.where(found.reason > 0, found.reason, self.reason[where])

    def settle(self, needed: int) -> None:
        """Reject the points that at least ``needed`` detectors reject."""
        if needed == 1:
            np.not_equal(self.detectors, 0, out=self.rejected)
        else:
            # NumPy counts bits by itself from 2.0 on; Ubuntu 24.04 has 1.26.
            bits = (self.detectors & ALL).view(np.uint8).reshape(-1, 2)
            votes = np.unpackbits(bits, axis=1).sum(axis=1)
            np.greater_equal(votes, needed, out=self.rejected)
            self.rejected[self.masked] = True

    def take(self, part: Part) -> Verdict:
        """Select points by indices (in their order), mask or slice.

        Examples
        --------
        >>> import numpy as np
        >>> from lidar_outlier_filter import detect_outliers
        >>> verdict = detect_outliers(np.zeros((5, 3)), chain=['sor'])
        >>> len(verdict.take(slice(0, 2))), len(verdict.take(verdict.outlier))
        (2, 0)

        """
        return Verdict(*(getattr(self, field.name)[part] for field in fields(Verdict)))

    def put(self, where: Part, result: Verdict) -> None:
        """Write the verdicts of some of the points."""
        for field in fields(Verdict):
            getattr(self, field.name)[where] = getattr(result, field.name)
