# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Profiles along a street before and after each method, as figure 3 of Leslar et al. (2010)."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.messages.truth import Kind
from lidar_outlier_lab.results.papers import panels

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from lidar_outlier_filter.core.annotations import Bools, Floats
    from lidar_outlier_lab.results.samples import Sample


LENGTH = 14.0  # metres of a profile
HALF = 2.5  # metres to both sides of the middle of the outliers
LOW, HIGH = -0.15, 2.2  # metres
ROW = 2.2  # inches
TITLES = {'a': '(a)', 'b': '(b)', 'c': '(c)', 'ab': '(a), then (b)'}


class Strip(NamedTuple):
    """A stretch of a road seen from the side.

    Attributes
    ----------
    flat : (M, 2) float64
        Along the street and up, metres.
    bad : (M,) bool
    rejected : verdicts (M,) by method

    """

    flat: Floats
    bad: Bools
    rejected: Mapping[str, Bools]


def strip(sample: Sample, rejected: Mapping[str, Bools]) -> Strip:
    """Cut out the stretch of a street that has the most outliers: the road and what is above it.

    The street runs along x; what stands beside the road is left out.
    """
    (xyz,) = sample.clouds
    bad = sample.data.bad
    on_road = bad if sample.surface is None else sample.surface == Kind.ROAD
    outliers = xyz[bad]
    starts = np.arange(xyz[:, 0].min(), max(xyz[:, 0].max() - LENGTH, xyz[:, 0].min()) + 1.0)
    inside = [
        np.count_nonzero((outliers[:, 0] >= x) & (outliers[:, 0] < x + LENGTH)) for x in starts
    ]
    begin = starts[int(np.argmax(inside))]
    along = (xyz[:, 0] >= begin) & (xyz[:, 0] < begin + LENGTH)
    middle = float(np.median(xyz[along & bad, 1])) if (along & bad).any() else 0.0
    shown = along & (np.abs(xyz[:, 1] - middle) < HALF) & (bad | on_road)
    flat = np.stack([xyz[shown, 0] - begin, xyz[shown, 2]], axis=1)
    return Strip(flat, bad[shown], {name: one[shown] for name, one in rejected.items()})


def draw(strips: Sequence[tuple[str, Strip]], path: Path) -> None:
    """Draw a row for each cloud: before, and after each method."""
    rows = []
    for name, one in strips:
        after = {TITLES.get(title, title.partition(',')[0]): r for title, r in one.rejected.items()}
        every = {'before': np.zeros(len(one.bad), np.bool_), **after}
        rows.append(
            [
                panels.view(f'{name[-1].upper()}: {title}', one.flat, one.bad, ~rejected)
                for title, rejected in every.items()
            ]
        )
    panels.draw(rows, path, ('along, m', 'height, m'), ROW, ((0.0, LENGTH), (LOW, HIGH)))
