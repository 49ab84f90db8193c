# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The warning about clouds that were not filtered fully."""

import math
import re
from collections import Counter
from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from lidar_outlier_filter.pipeline.statistics import CountsByReason, Statistics
from lidar_outlier_filter.ros.health import (
    DEGRADED,
    DROPPED,
    LOSS_PERIOD,
    LOST,
    UNFILTERED,
    WITHOUT_POSE,
    Health,
)

SEEN = st.tuples(
    st.floats(0, 2 * LOSS_PERIOD),
    st.sampled_from([DROPPED, LOST]),
    st.integers(0, 3),
)


@given(st.lists(SEEN))
def test_bounded_and_complete(seen: list[tuple[float, str, int]]) -> None:
    """Warnings are apart by the period at least, and their sum is all that was lost."""
    health, lost, said = Health(), Counter[str](), Counter[str]()
    time, times, lossy = 0.0, list[float](), list[float]()
    for seconds, what, count in [*seen, (math.inf, DROPPED, 0)]:
        lost[what] += count
        health.missed(what, count)
        time += seconds
        lossy += [time] * bool(count)
        if text := health.loss_warning('drop_oldest', seconds):
            times.append(time)
            assert ('for large clouds all nodes need' in text) == (LOST in text)
            said += Counter({what: int(count) for count, what in _counts(text)})
    assert said == +lost
    assert times[:1] == lossy[:1]  # the first at once
    gaps = [after - before for before, after in pairwise(times)]
    assert all(gap >= LOSS_PERIOD or math.isclose(gap, LOSS_PERIOD) for gap in gaps)


def _counts(text: str) -> list[tuple[str, str]]:
    return re.findall(r'(\d+) (dropped|lost in transit)', text)


def test_what_counts() -> None:
    """All that was not filtered in full; not clouds that the user lets pass, nor refused ones."""
    health = Health()
    health.missed(LOST, 1)
    health.missed(DROPPED, 2)
    passed = Counter(overload=3, failure=4, disabled=100)
    refused = CountsByReason({'point_step': 100})
    health.counted(Statistics(bypassed=passed, degraded=5, without_pose=6, refusals=refused))
    assert health.losses() == {
        LOST: 1,
        DROPPED: 2,
        UNFILTERED: 7,
        DEGRADED: 5,
        WITHOUT_POSE: 6,
    }
