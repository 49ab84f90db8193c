# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Whole recordings or files that are sent to workers, and again where others are to blame."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from itertools import count
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from lidar_outlier_filter.errors import FilterError

if TYPE_CHECKING:
    from collections.abc import Collection
    from pathlib import Path

    from lidar_outlier_filter.archive.workers import Workers

One = TypeVar('One')


@dataclass(eq=False)
class Sent(Generic[One]):
    """A recording or file that was sent; the folders of all attempts at it begin alike."""

    item: One
    prefix: str
    future: Any
    is_anew: bool = False


class SentWork(ABC, Generic[One]):
    """Sends recordings or files to workers: what :class:`.Hands` are, but for their results."""

    def __init__(self, workers: Workers, folder: Path | None) -> None:
        """Take workers that reach all, and ``folder``, by the same paths as this process.

        Each attempt has a folder of its own in there; None: attempts leave nothing here.
        """
        self._workers, self._folder = workers, None if folder is None else folder.absolute()
        self._numbers = count()
        self._sent: set[Sent[One]] = set()

    def submit(self, item: One) -> Sent[One]:
        """See :class:`.Hands`."""
        prefix = f'{next(self._numbers)}-'
        sent = Sent(item, prefix, self._send(item, prefix))
        self._sent.add(sent)
        return sent

    @abstractmethod
    def _send(self, item: One, prefix: str) -> Any:
        """Send it; return Dask's future."""

    def first_done(self, futures: Collection[Sent[One]]) -> Collection[Sent[One]]:
        """See :class:`.Hands`.

        Dask blames a worker's death on all that it had, also on what had only begun, or waited.
        Such work is sent again.
        """
        self._workers.first_done([sent.future for sent in futures])
        for sent in futures:
            if sent.future.done() and self._is_innocent(sent):
                sent.future, sent.is_anew = self._send(sent.item, sent.prefix), True
        return [sent for sent in futures if sent.future.done()]

    def _is_innocent(self, sent: Sent[One]) -> bool:
        """Return whether more deaths are blamed on it than there were attempts at it."""
        attempts = len(self._attempts(sent))
        return self._folder is not None and self._workers.deaths(sent.future) > attempts

    def _attempts(self, sent: Sent[One]) -> list[Path]:
        """List the folders of all attempts."""
        return [] if self._folder is None else list(self._folder.glob(f'{sent.prefix}*'))

    def _result(self, sent: Sent[One], what: str) -> Any:
        """Return what a worker made of ``what``; raise the refusal that it returned."""
        self._sent.discard(sent)
        found = self._workers.result(sent.future, what)
        if isinstance(found, FilterError):
            raise found
        return found

    def end(self) -> None:
        """See :class:`.Hands`."""
        for sent in self._sent:
            self._workers.give_up(sent.future)
