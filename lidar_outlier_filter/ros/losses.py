# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The warning in the log about clouds that were not filtered as asked. Knows no ROS."""

from __future__ import annotations

from collections import Counter
from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

LOSS_PERIOD = 5.0  # seconds between two warnings


class Loss(Enum):
    """What happened to a cloud that was not filtered as asked, for people."""

    ON_THE_WAY = 'lost on the way'
    DROPPED = 'dropped'
    PASSED = 'passed unfiltered'
    SHED = 'filtered by the smoother alone'
    UNMOVED = 'judged without poses'

    @property
    def is_by_policy(self) -> bool:
        """Whether ``load.policy`` decided it."""
        return self in {Loss.DROPPED, Loss.PASSED, Loss.SHED}


class LossWarning:
    """Sums up losses, and warns of them at a bounded rate; no loss is left out."""

    def __init__(self) -> None:
        """Begin with nothing lost; the first loss is warned of at once."""
        self._said: Counter[Loss] = Counter()
        self._quiet = LOSS_PERIOD  # seconds since the last warning

    def look(self, lost: Mapping[Loss, int], policy: str, seconds: float) -> str:
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
        counts = ', '.join(f'{count} {loss.value}' for loss, count in new.items())
        reason = f' (load.policy is {policy})' if any(loss.is_by_policy for loss in new) else ''
        return f'clouds not filtered as asked since the last warning: {counts}{reason}'
