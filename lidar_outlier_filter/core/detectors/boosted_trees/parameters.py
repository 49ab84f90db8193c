# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of the default detector."""

from __future__ import annotations

from dataclasses import dataclass

from lidar_outlier_filter.parameters.declaration import Section, declare


@dataclass(frozen=True)
class BoostedTrees(Section):
    """Gradient-boosted trees on the features of each point."""

    sensor: str = declare(
        'auto',
        'Where the scan pattern comes from: spinning: rings; profile: one scan line after another; '
        'auto: whichever fits; free: a scanner without rings, in its own frame, such as a Livox; '
        'survey: none, points are compared with their nearest neighbours only.',
        choices=('auto', 'profile', 'spinning', 'survey', 'free'),
    )
    threshold: float = declare(
        1.0, "Rejected above this many times the sensor's own threshold.", '', 1e-6, 1e6
    )

    @property
    def columns(self) -> tuple[str, ...]:
        """What it reads of a cloud besides points and times."""
        return ('intensity', 'ring') if self.sensor in {'auto', 'spinning'} else ('intensity',)
