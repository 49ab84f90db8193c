# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What a worker of this machine does first; Dask imports it in each, and calls ``dask_setup``."""

from __future__ import annotations

import signal


def dask_setup(_worker: object) -> None:
    """Leave Ctrl-C, which a terminal sends to all its processes, to the one that started it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
