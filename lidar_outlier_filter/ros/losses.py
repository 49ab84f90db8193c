# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The warning in the log about clouds that were not filtered as asked. Knows no ROS."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

LOSS_PERIOD = 5.0  # seconds between two warnings
BY_POLICY = ('dropped', 'passed unfiltered', 'filtered by the smoother alone')


class LossWarning:
    """Sums up losses, and warns of them at a bounded rate; no loss is left out."""

    def __init__(self) -> None:
        """Begin with nothing lost; the first loss is warned of at once."""
        self._said: Counter[str] = Counter()
        self._quiet = LOSS_PERIOD  # seconds since the last warning

    def look(self, lost: Mapping[str, int], policy: str, seconds: float) -> str:
        """Return the warning that is due; empty where there is none.

        Parameters
        ----------
        lost : counts since the start, by what happened
        policy : ``load.policy``
        seconds : time since the last look; infinite at the end

        """
        self._quiet += seconds
        new = Counter(lost) - self._said
        if not new or self._quiet < LOSS_PERIOD:
            return ''
        self._said, self._quiet = Counter(lost), 0.0
        counts = ', '.join(f'{count} {what}' for what, count in new.items())
        reason = f' (load.policy is {policy})' if any(new[what] for what in BY_POLICY) else ''
        return f'clouds not filtered as asked since the last warning: {counts}{reason}'
