# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What is a block: a stretch of sensor time, or a message."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lidar_outlier_filter.core.points.points import SECOND

if TYPE_CHECKING:
    from collections.abc import Callable

    from lidar_outlier_filter.parameters.filter import FilterParameters

FIRST = 3  # messages that decide under `auto`; the very first sweep may be cut short
SWEEP = 1 / 4  # of `block`: a message that spans less brings scan lines, or has no times


class BlockChoice:
    """Chooses what `blocks` names; under `auto` by the first messages of a stream alone.

    So live and replay choose the same.

    Attributes
    ----------
    by_message : bool
        Whether each message is a block. Stretches of time are the blocks until that is decided.
    inform : callable
        Is called with a sentence that says what `auto` has chosen.

    """

    def __init__(self, parameters: FilterParameters) -> None:
        """Take blocks and block."""
        self._blocks = parameters.blocks
        self._least = round(SWEEP * parameters.block * SECOND)
        self.inform: Callable[[str], object] = str
        self.begin_anew()

    def begin_anew(self) -> None:
        """Choose anew: what comes is another stream."""
        self.by_message = self._blocks == 'message'
        self._left = FIRST if self._blocks == 'auto' else 0

    def becomes_message(self, first: int, last: int) -> bool:
        """Look at the times of the next message, ns; return whether from it on messages are blocks.

        A message without points, whose ``last`` is before ``first``, decides nothing.
        """
        if not self._left or last < first:
            return False
        self._left -= 1
        span = f'a message spans {(last - first) / SECOND:.3g} s'
        if last - first >= self._least:
            self.by_message, self._left = True, 0
            self.inform(f'blocks: each message is judged at once, because {span}')
        elif not self._left:
            self.inform(f'blocks: messages wait for stretches of sensor time, because {span}')
        return self.by_message
