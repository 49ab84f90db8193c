# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The warning about clouds that were not filtered as asked."""

from __future__ import annotations

import math
import re
from collections import Counter
from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from lidar_outlier_filter.pipeline.statistics import CountsByReason, Statistics
from lidar_outlier_filter.ros.health import LOSS_PERIOD, Health, Loss, LossWarning

SEEN = st.tuples(
    st.floats(0, 2 * LOSS_PERIOD),
    st.sampled_from([Loss.DROPPED, Loss.ON_THE_WAY]),
    st.integers(0, 3),
)


def test_the_first_loss_is_warned_of_at_once() -> None:
    """With the policy, which says why; nothing lost is nothing said."""
    warning = LossWarning()
    assert warning.look({Loss.DROPPED: 0, Loss.ON_THE_WAY: 0}, 'drop_oldest', 1.0) == ''
    assert warning.look({Loss.DROPPED: 3, Loss.ON_THE_WAY: 1}, 'drop_oldest', 1.0) == (
        'clouds not filtered as asked since the last warning: 3 dropped, 1 lost on the way '
        '(load.policy is drop_oldest)'
    )


def test_the_policy_is_named_where_it_matters() -> None:
    """Not for clouds that the middleware has lost."""
    assert 'load.policy' not in LossWarning().look({Loss.ON_THE_WAY: 1}, 'shed', 1.0)


@given(st.lists(SEEN))
def test_bounded_and_complete(seen: list[tuple[float, Loss, int]]) -> None:
    """Warnings are apart by the period at least, and their sum is all that was lost."""
    warning, lost, said = LossWarning(), Counter[Loss](), Counter[Loss]()
    time, times = 0.0, []
    for seconds, what, count in [*seen, (math.inf, Loss.DROPPED, 0)]:
        lost[what] += count
        time += seconds
        text = warning.look(lost, 'drop_oldest', seconds)
        if text:
            times.append(time)
            said += Counter({Loss(what): int(count) for count, what in _counts(text)})
    assert said == +lost
    gaps = [after - before for before, after in pairwise(times)]
    assert all(gap >= LOSS_PERIOD or math.isclose(gap, LOSS_PERIOD) for gap in gaps)


def _counts(text: str) -> list[tuple[str, str]]:
    return re.findall(r'(\d+) (dropped|lost on the way)', text)


def test_what_counts() -> None:
    """All that was not filtered in full; not clouds that the user lets pass, nor refused ones."""
    health = Health()
    health.lost(1)
    health.dropped(2)
    passed = Counter(overload=3, failure=4, disabled=100)
    refused = CountsByReason({'point_step': 100})
    health.counted(Statistics(bypassed=passed, degraded=5, without_pose=6, refusals=refused))
    assert health.losses() == {
        Loss.ON_THE_WAY: 1,
        Loss.DROPPED: 2,
        Loss.PASSED: 7,
        Loss.SHED: 5,
        Loss.UNMOVED: 6,
    }
