# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What a worker does first: Dask imports it in each, and calls ``dask_setup``."""

from __future__ import annotations

import os
import signal
import socket
from typing import TYPE_CHECKING

from lidar_outlier_filter.pipeline.memory import keep_memory

if TYPE_CHECKING:
    from distributed import Worker

NICER = 2  # than the process that gives names, which shall not wait for what it need not


def name_of_worker() -> str:
    """Name this process, as a manifest does: machine and number."""
    return f'{socket.gethostname()}:{os.getpid()}'


def dask_setup(worker: Worker) -> None:
    """Leave Ctrl-C, which a terminal sends to all its processes, to the one that started it.

    Dask lets the C library give all free memory back at once: a third of the time would go.
    """
    if worker.nanny is not None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(NICER)
    keep_memory()
