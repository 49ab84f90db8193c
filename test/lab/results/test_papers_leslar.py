# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The page of Leslar, Wang and Hu (2010): its tables, its figure, and the strip of asphalt."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.evaluation.confusion import Confusion
from lidar_outlier_filter.messages.truth import Kind
from lidar_outlier_filter.tuning.training import Training
from lidar_outlier_lab.results.papers import leslar, leslar_picture
from lidar_outlier_lab.results.papers.counts import NONE_OF_ITS_PRESETS, Counted, count
from lidar_outlier_lab.results.papers.pages import write_up
from lidar_outlier_lab.results.samples import Sample

if TYPE_CHECKING:
    from pathlib import Path


def quiet(_done: int, _total: int, _what: str) -> None:
    """Show no progress."""


def street() -> Sample:
    """Lay out a road of 40 m by 2 m, a wall beside it, and outliers: three together, one alone."""
    x, y = (part.ravel() / 5 for part in np.mgrid[:200, :10])
    road = np.stack([x, y, np.zeros(len(x))], axis=1)
    wall = np.stack([x, np.full(len(x), 2.2), y], axis=1)
    outliers = np.array([[20.0, 1, 1], [20.5, 1, 1], [21.0, 1, 1], [2.0, 1, 1]])
    xyz = np.concatenate([road, wall, outliers])
    bad = np.arange(len(xyz)) >= 2 * len(x)
    zeros = np.zeros(len(xyz), np.int64)
    points = Points(xyz, zeros, zeros, np.ones(len(xyz), np.bool_))
    data = Training((points,), bad, ~bad, zeros, 1, streamed=False)
    kinds = np.repeat([Kind.ROAD, Kind.FACADE, Kind.AIR], [len(x), len(x), 4]).astype(np.uint8)
    return Sample('leslar-c', 1, data, bad.astype(np.int64), False, False, kinds)  # noqa: FBT003


def test_count() -> None:
    """The road is counted alone; without one there is none."""
    counted = count(street(), {'chain': ['sor'], 'sor.statistic': 'radius'})
    assert counted.whole.total == len(counted.rejected) == 4004
    assert counted.whole.found == 4
    assert counted.road == 0.0
    assert counted.seconds > 0.0
    counted = count(street(), {'chain': ['sor'], 'sor.multiplier': 0.0})
    assert counted.road == pytest.approx(counted.rejected[:2000].mean())


def test_the_papers_table() -> None:
    """Rows and percentages are those of the paper, and ours stand beside them."""
    ours = Counted(Confusion(10, 21, 3, 966), 0.0, 1.0, np.zeros(0, np.bool_))
    text = leslar._like_the_paper({'a': [ours, ours]}, 'a', ['C', 'A'])
    lines = text.splitlines()
    assert lines[0] == '|  | C: paper | C: ours | A: paper | A: ours |'
    assert lines[2] == '| No. of outliers identified | 4 | 10 | 3,414 | 10 |'
    assert lines[5] == '| % of outliers identified | 12.90 | 32.26 | 30.94 | 32.26 |'
    assert lines[7] == '| % of point cloud identified incorrectly | 0.00 | 0.30 | 0.01 | 0.30 |'


def test_strip() -> None:
    """The stretch with the most outliers, the road and what is above it; no wall."""
    sample = street()
    rejected = sample.data.bad.copy()
    one = leslar_picture.strip(sample, {'all': rejected})
    assert one.bad.sum() == 3
    assert (one.rejected['all'] == one.bad).all()
    assert np.ptp(one.flat[:, 0]) < leslar_picture.LENGTH
    assert set(one.flat[:, 1]) == {0.0, 1.0}


def test_without_its_presets(tmp_path: Path) -> None:
    """The page says so."""
    (text,) = write_up(['leslar2010'], ['sotoodeh-hod'], 1, tmp_path, quiet).values()
    assert text.endswith(NONE_OF_ITS_PRESETS)
