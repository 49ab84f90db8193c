# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings or files worked through by whoever has time: so many are begun, and each is ended."""

from __future__ import annotations

from collections import deque
from contextlib import ExitStack
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable

One = TypeVar('One')
One_contra = TypeVar('One_contra', contravariant=True)


class Hands(Protocol[One_contra]):
    """Works on recordings or files, several at once."""

    @property
    def at_once(self) -> int:
        """How many it takes."""

    def submit(self, item: One_contra, /) -> Any:
        """Begin with one; return what stands for its result."""

    def first_done(self, futures: Collection[Any], /) -> Collection[Any]:
        """Wait for the first of some, not for long; return those that are done."""

    def take(self, item: One_contra, future: Any, /) -> Any:
        """Return what became of one; raise why nothing did."""

    def end(self) -> None:
        """Leave what is not done."""


def work_through(  # noqa: PLR0913  items, who works, and what is called when
    items: Iterable[One],
    hands: Hands[One],
    begin: Callable[[One], bool],
    noted: Callable[[], object],
    end: Callable[[One, Callable[[], Any]], object],
    tick: Callable[[], object],
) -> None:
    """Work through recordings or files, as many at once as ``hands`` take.

    Parameters
    ----------
    items : recordings or files, in the order in which they are begun
    hands : who works on them
    begin : notes that one is begun; returns whether there is anything to do
    noted : is called when some are noted, before work on them begins, and at the end
    end : notes what became of one; is given what returns that, or raises
    tick : is called now and then, and may leave by an exception

    """
    waiting = deque(items)
    running: dict[Any, One] = {}
    with ExitStack() as stack:
        stack.callback(hands.end)
        stack.callback(noted)
        while waiting or running:
            begun: list[One] = []
            free = hands.at_once - len(running)
            while waiting and len(begun) < free:
                item = waiting.popleft()
                if begin(item):
                    begun.append(item)
            noted()
            running.update((hands.submit(item), item) for item in begun)
            tick()
            for future in hands.first_done(running) if running else ():
                item = running.pop(future)
                end(item, partial(hands.take, item, future))
