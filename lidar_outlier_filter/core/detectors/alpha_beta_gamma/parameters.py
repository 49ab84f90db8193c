# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of the smoother."""

from __future__ import annotations

from dataclasses import dataclass

from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.declaration import Section, declare


@dataclass(frozen=True)
class AlphaBetaGamma(Section):
    """The moving fixed-interval α-β-γ smoother along each line segment."""

    before: int = declare(3, 'Points of the window in front of the tested one.', '', 0, 1000)
    after: int = declare(3, 'Points of the window behind the tested one.', '', 0, 1000)
    order: int = declare(
        1,
        'Motion along the line: 2 with acceleration (α-β-γ), 1 without (α-β).',
        '',
        1,
        2,
    )
    significance: float = declare(
        1e-6, 'Two-sided probability to reject a good point, for one test.', '', 1e-15, 0.5
    )
    sides: str = declare(
        'either',
        'both: the window around the point decides (the paper); either: a point that agrees with '
        'the window on one side is kept, so edges and corners stay.',
        choices=('both', 'either'),
    )
    sigma: float = declare(
        0.0, 'Standard deviation of a coordinate; 0: estimated from each line.', 'm', 0.0, 100.0
    )
    sigma_floor: float = declare(
        0.005, 'Least standard deviation that an estimate may give.', 'm', 1e-6, 100.0
    )
    passes: int = declare(
        30, 'Most repetitions without the rejected; the last rejects all that is left.', '', 1, 1000
    )
    engine: str = declare(
        'kernel',
        'kernel: compiled; filterpy: a Kalman filter with RTS smoother, slow but auditable.',
        choices=('kernel', 'filterpy'),
    )

    @property
    def min_window(self) -> int:
        """Fewest other points in a window: one more than the unknowns of the motion.

        With as many as unknowns all points of a window would fail alike.
        """
        return self.order + 2

    def check(self) -> None:
        """Refuse windows that are too short."""
        got = f'{self.before} and {self.after}'
        if self.before + self.after < self.min_window:
            must_be = f'together at least order + 2 = {self.min_window}'
            raise ParameterError('alpha_beta_gamma.before and after', must_be, got)
        if self.sides == 'either' and max(self.before, self.after) < self.min_window:
            must_be = f'one of them at least order + 2 = {self.min_window}, with sides: either'
            raise ParameterError('alpha_beta_gamma.before and after', must_be, got)
