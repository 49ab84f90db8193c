# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How far a run over recordings or files is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True)
class Step:
    """How far a run is: recording ``number`` of ``total``, and messages of one.

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


class Progress:
    """How far recordings or files are that are worked on at once; threads may note it."""

    def __init__(self, sizes: Mapping[str, int], unit: str = 'messages') -> None:
        """Take the bytes of each, by their names; ``unit`` is of what is counted."""
        self._sizes, self._unit = sizes, unit
        self._total, self._bytes = sum(sizes.values()), 0
        self._running: dict[str, tuple[float, int, int]] = {}
        self._done: set[str] = set()
        self._last = ''

    def note(self, name: str, done: int, total: int, share: float | None = None) -> None:
        """Note how much of one is done; its ``share``, where that is another."""
        if name in self._done:
            return  # a worker's message came late
        _, _, known = self._running.get(name, (0.0, 0, 0))
        part = done / max(done, total, 1) if share is None else share
        self._running[name] = part, done, total or known

    def finish(self, name: str) -> None:
        """Note that nothing more becomes of one."""
        self._done.add(name)
        self._bytes += self._sizes[name]
        self._running.pop(name, None)
        self._last = name

    @property
    def step(self) -> Step:
        """All of it together; named is the one that is furthest, or the last one done."""
        running = self._running.copy()
        begun = sum(at[0] * self._sizes[name] for name, at in running.items())
        name = max(running, key=lambda one: running[one][0], default=self._last)
        _, done, total = running.get(name, (0.0, 0, 0))
        return Step(
            name.rpartition('/')[2],
            min(len(self._done) + bool(running), len(self._sizes)),
            len(self._sizes),
            done,
            total,
            self._bytes + begun,
            self._total,
            self._unit,
        )
