# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the node does at SIGINT and SIGTERM. Imports nothing heavy."""

from __future__ import annotations

import os
import signal
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def on_stop(react: Callable[[], object]) -> None:
    """Call ``react`` at the next SIGINT or SIGTERM; the one after it ends the process at once.

    By the system itself: Python would look at it only when it is through with what it does.
    """

    def first(*_: object) -> None:
        for number in STOP_SIGNALS:
            signal.signal(number, signal.SIG_DFL)
        react()

    for number in STOP_SIGNALS:
        signal.signal(number, first)


def leave() -> None:
    """End the process at once, with status 0.

    For as long as it has nothing to lose. Not by an exception: raised inside an import or a
    destructor, it would be swallowed, or come out as another.
    """
    os._exit(0)
