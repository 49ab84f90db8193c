# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Runs over an archive: what is counted, what it says in its table and at its end."""

from __future__ import annotations

import numpy as np

from lidar_outlier_filter.archive import run
from lidar_outlier_filter.recordings.bags import Topic
from lidar_outlier_filter.stream.topics import CLOUD


def test_gaps() -> None:
    """A cloud is missing where a distance is longer than twice the median of all distances."""
    for distances, gaps in (
        ([10] * 9 + [20], 0),
        ([10] * 9 + [21], 1),
        ([21] + [10] * 5 + [1000] * 3 + [10] * 5, 4),
        ([0, 0, 0, 1], 1),
        ([10], 0),
        ([], 0),
    ):
        times = run._Times()
        for time in reversed(np.cumsum([0, *distances]).tolist()):  # in any order
            times.note(Topic('/lidar', CLOUD, '', ''), time)
        times.note(None, 10**6)
        assert times.gaps('/lidar') == gaps
    assert run._Times().gaps('/other') == 0
