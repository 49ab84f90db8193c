# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The naive PCL-LOFFilter against numbers worked out by hand."""

import pytest

from naive import pcl_lof as naive


def test_by_hand() -> None:
    """With k = 2 of 0, 1, 3, 7: each has itself and one other; squared k-distances 1, 1, 4, 16.

    Sums of squared reach distances: 1 + 1, 1 + 1, 4 + 4, 16 + 16; so densities are 1, 1, 1/4, 1/16.
    """
    cloud = [(x, 0.0, 0.0) for x in (0.0, 1.0, 3.0, 7.0)]
    expected = [1, 1, (1 + 4) / 2, (1 + 4) / 2]
    assert naive.factors(cloud, 2) == pytest.approx(expected, rel=1e-15)
