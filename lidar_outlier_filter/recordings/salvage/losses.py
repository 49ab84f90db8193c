# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What could not be read of a damaged recording, counted."""

from __future__ import annotations

from dataclasses import dataclass, field

from lidar_outlier_filter.errors import printable

MOST = 1000  # reasons that are kept


@dataclass
class Losses:
    """What is lost of a recording, at least.

    Attributes
    ----------
    messages : as far as they can be counted: by indexes, by ``metadata.yaml``, or one by one
    chunks : that cannot be unpacked, or hold no sequence of records
    size : bytes of the files that gave nothing, or are missing
    reasons : a clause for each loss, of the first ``MOST``
    more : losses beyond these

    """

    messages: int = 0
    chunks: int = 0
    size: int = 0
    reasons: list[str] = field(default_factory=list)
    more: int = 0

    def add(self, reason: str, *, messages: int = 0, chunks: int = 0, size: int = 0) -> None:
        """Count what is lost at once."""
        if len(self.reasons) < MOST:
            self.reasons.append(printable(' '.join(reason.split())))
        else:
            self.more += 1
        self.messages += messages
        self.chunks += chunks
        self.size += size

    def said(self, most: int = MOST) -> list[str]:
        """List so many of the first reasons, and behind them how many more there are."""
        more = self.more + max(0, len(self.reasons) - most)
        return self.reasons[:most] + ([f'and {more} more'] if more else [])
