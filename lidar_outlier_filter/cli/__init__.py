# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Command line: arguments and terminal; here, the process of a command from its first import on.

Nothing heavy is imported: until this module is imported, Python itself handles Ctrl-C.
"""

from __future__ import annotations

import os
import signal
from typing import TYPE_CHECKING

from lidar_outlier_filter.cli.terminal import INTERRUPTED, ignore

if TYPE_CHECKING:
    from types import FrameType


def start() -> int:
    """Run the command line as a process of its own; return the exit status."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupt)
    from lidar_outlier_filter.cli.main import run  # noqa: PLC0415  as said above

    try:
        status = run()
    except KeyboardInterrupt:
        status = INTERRUPTED
    ignore()
    return status


def _interrupt(_number: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt, but end the process at once while it imports modules.

    From an import the exception may come as another one, or not at all. Nothing is written then.
    """
    while frame is not None:
        if frame.f_code.co_filename == '<frozen importlib._bootstrap>':
            os._exit(INTERRUPTED)
        frame = frame.f_back
    raise KeyboardInterrupt
