# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What could not be read of a damaged recording, counted."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class Losses:
    """What is lost of a recording, at least.

    Attributes
    ----------
    messages : as far as they can be counted: by indexes, by ``metadata.yaml``, or one by one
    chunks : that cannot be unpacked, or hold no sequence of records
    size : bytes of the files that gave nothing, or are missing
    reasons : a clause for each place

    """

    messages: int = 0
    chunks: int = 0
    size: int = 0
    reasons: list[str] = field(default_factory=list)

    def add(self, reason: str, *, messages: int = 0, chunks: int = 0, size: int = 0) -> None:
        """Count what is lost at one place."""
        self.reasons.append(' '.join(reason.split()))
        self.messages += messages
        self.chunks += chunks
        self.size += size
