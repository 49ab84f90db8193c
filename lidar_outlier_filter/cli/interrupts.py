# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C and SIGTERM while a command works, and when its work is done."""

from __future__ import annotations

import signal
import sys
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import FrameType

INTERRUPTED = 130  # exit status
SIGNALS = (signal.SIGINT, signal.SIGTERM)


def ignore() -> None:
    """Ignore both signals once all is written: the exit status reports success."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


@contextmanager
def stopping() -> Iterator[Callable[[], None]]:
    """Give a function to call where work may stop; it leaves if SIGINT or SIGTERM was received.

    An exception raised by the handler could come up anywhere: inside a compiled kernel or the
    middleware, which swallow or replace it. A second signal ends the process at once. Once the work
    is done, both are ignored.
    """
    received: list[int] = []

    def note(number: int, _frame: FrameType | None) -> None:
        received.append(number)
        for one in SIGNALS:
            signal.signal(one, signal.SIG_DFL)

    def leave_if_asked() -> None:
        if signal.SIGINT in received:
            raise KeyboardInterrupt
        if received:
            sys.exit(128 + received[0])

    before = {number: _once(number, note) for number in SIGNALS}
    try:
        yield leave_if_asked
    except BaseException:
        for number, handler in before.items():
            signal.signal(number, handler)
        raise
    ignore()


def _once(number: int, handler: Callable[[int, FrameType | None], None]) -> signal._HANDLER:
    """Set a handler for one signal only: the next one ends the process. Return the handler before.

    Python runs a handler between two of its steps, which may be hours apart. So the system puts the
    default back, where it has a function for that.
    """
    before = signal.signal(number, handler)
    import ctypes  # noqa: PLC0415  help needs none of it

    system = ctypes.CDLL(None)
    if hasattr(system, 'sysv_signal'):
        system.sysv_signal.restype = ctypes.c_void_p
        system.sysv_signal.argtypes = (ctypes.c_int, ctypes.c_void_p)
        python = system.sysv_signal(number, None)
        system.sysv_signal(number, python)
    return before


@contextmanager
def handlers_kept() -> Iterator[None]:
    """Put the handlers of both signals back at the end, for whoever called."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
