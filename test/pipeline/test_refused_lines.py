# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A cloud that is refused after it was decoded begins no scan line."""

import pytest
from helpers.nodes import line

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.pipeline import Pipeline


def test_a_refused_cloud_begins_no_scan_line() -> None:
    """The next cloud has the line that it would have had: the third of three."""
    values = {'line_source': 'message', 'chain': ('alpha_beta_gamma',), 'block': 0.02, 'halo': 0.0}
    clean = Pipeline(FilterParameters().changed(values))
    clean.process(line(0.5))
    clean.process(line(0.6))
    with pytest.raises(CloudError, match=r'^the time of a cloud must be at or after'):
        clean.process(line(0.4))
    assert clean._decoder.decode(line(0.62)).line.tolist() == [3] * 100
