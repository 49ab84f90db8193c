# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The pieces of one recording after the other, some of them under way while one is written."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from lidar_outlier_filter.archive.pieces import JudgedPiece, Piece
    from lidar_outlier_filter.archive.workers import Workers


class PieceQueue:
    """Keeps the workers busy, and no more: pieces are sent as those before are taken."""

    def __init__(
        self,
        recordings: Iterator[Sequence[Piece]],
        workers: Workers,
        tick: Callable[[], object],
    ) -> None:
        """Take recordings, each as its pieces, in the order in which they will be asked for.

        ``tick`` is called while a piece is waited for, and may leave by an exception.
        """
        self._recordings, self._workers, self._tick = recordings, workers, tick
        self._unsent: deque[Piece] = deque()
        self._sent: dict[Piece, Any] = {}

    def take(self, piece: Piece) -> JudgedPiece:
        """Wait for a piece; those behind it are sent meanwhile."""
        self.send()
        future = self._sent[piece]
        judged = self._workers.wait(future, piece, self._tick)
        del self._sent[piece]
        self.send()
        return judged

    def give_up(self, pieces: Sequence[Piece]) -> None:
        """Forget what is left of a recording."""
        for piece in pieces:
            if piece in self._sent:
                self._workers.give_up(self._sent.pop(piece))
        left = set(map(id, pieces))
        self._unsent = deque(piece for piece in self._unsent if id(piece) not in left)

    def send(self) -> None:
        """Send pieces, as many as the workers shall have."""
        ahead = self._workers.ahead
        while len(self._sent) < ahead:
            while not self._unsent:
                following = next(self._recordings, None)
                if following is None:
                    return
                self._unsent.extend(following)
            piece = self._unsent.popleft()
            self._sent[piece] = self._workers.submit(piece)
