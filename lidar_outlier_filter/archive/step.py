# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How far a run over recordings or files is."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Step:
    """How far a run is: recording ``number`` of ``total``, and messages of it.

    Of files ``messages`` are points, as ``unit`` says.
    """

    recording: str
    number: int
    total: int
    done: int
    messages: int
    bytes_done: float
    bytes_total: int
    unit: str = 'messages'
