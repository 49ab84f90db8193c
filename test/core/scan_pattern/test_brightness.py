# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Brightness is that of loops, in any unit and order; clouds without intensities have none."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.clouds import cloud, table
from helpers.scans import measured, pattern_of, sweep
from naive import scan_pattern as naive

from lidar_outlier_filter.core.detectors.boosted_trees.features import WINDOW
from lidar_outlier_filter.core.points.points import Points, concatenate
from lidar_outlier_filter.core.scan_pattern.scan_pattern import brightness
from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_filter.parameters.filter import FilterParameters


@pytest.mark.parametrize('count', [0, 1, 119, 121, 5000])
def test_as_loops(count: int) -> None:
    """At edges and beyond, unknown intensities, dark ranges, and cells without a point."""
    rng = np.random.default_rng(count)
    reach = rng.choice(np.array([0.1, 0.5, 0.75, 1.0, 7.0, 8.0, 200.0, 500.0], np.float32), count)
    values = np.array([0.0, 1.0, 3.0, 250.0, -1.0, np.nan, np.inf], np.float32)
    intensity = rng.choice(values, count)
    intensity[reach == np.float32(0.75)] = 0.0
    order = np.where(rng.random(count) < 0.1, -1, rng.permutation(count))
    bright = brightness(order, reach, intensity)
    cells = [
        None if i < 0 else (float(r), float(intensity[i]))
        for i, r in zip(order.tolist(), reach, strict=True)
    ]
    assert bright[0].tolist() == pytest.approx(naive.brightness(cells))
    assert bright[1].tolist() == naive.ranks(cells)


def test_thirty_cells_are_enough() -> None:
    """Of 30 cells at about one range the median is known, of 29 it is not."""
    for count, expected, rank in ((30, 1.0, 0.0), (29, -1.0, -1.0)):
        reach, intensity = np.full((2, 4 * count), [[2], [7]], np.float32)
        bright = brightness(np.arange(4 * count), reach, intensity)
        assert [{*row} for row in bright.tolist()] == [{expected}, {rank}]


def with_intensity(points: Points, scale: float = 1.0) -> Points:
    """Give points intensities that depend on where they are."""
    values = np.abs(np.sin(40.0 * points.xyz).sum(axis=1)) * scale
    return replace(points, intensity=values.astype(np.float32))


def test_unit_and_order_do_not_matter() -> None:
    """They are ratios and ranks; nothing else of a pattern depends on intensities."""
    points = sweep(1, 0.2, columns=300)
    rows = [[*WINDOW].index(name) for name in ('bright', 'rank')]
    plain = measured(pattern_of(points))
    assert {*plain[rows][:, pattern_of(points).order >= 0].ravel().tolist()} == {-1.0}
    once = measured(pattern_of(with_intensity(points)))
    assert np.array_equal(np.delete(once, rows, axis=0), np.delete(plain, rows, axis=0))
    bright, rank = once[rows]
    assert np.median(bright[bright > 0]) == pytest.approx(1.0, abs=0.1)
    assert np.quantile(rank[rank > 0], [0.25, 0.75]) == pytest.approx([0.25, 0.75], abs=0.05)
    assert np.array_equal(measured(pattern_of(with_intensity(points, 64.0))), once)
    mixed = points.take(np.random.default_rng(1).permutation(len(points)))
    assert np.array_equal(measured(pattern_of(with_intensity(mixed))), once)


def test_parts_without_intensities() -> None:
    """Where some clouds have them, those of the others are unknown; they stay with their points."""
    points = with_intensity(sweep(2, 0.1))
    first, second = points.take(slice(0, 50)), points.take(np.arange(50, len(points)))
    assert np.array_equal(concatenate([first, second]).intensity, points.intensity)  # type: ignore[arg-type]
    some = concatenate([replace(first, intensity=None), second]).intensity
    assert some is not None
    assert np.isnan(some[:50]).all()
    assert np.array_equal(some[50:], points.intensity[50:])  # type: ignore[index]
    none = [replace(part, intensity=None) for part in (first, second)]
    assert concatenate(none).intensity is None


@pytest.mark.parametrize(
    ('name', 'kind', 'chain', 'known'),
    [
        ('intensity', 'f4', 'boosted_trees', True),
        ('reflectivity', 'u2', 'boosted_trees', True),
        ('reflectance', 'f8', 'boosted_trees', True),
        ('ambient', 'u2', 'boosted_trees', False),
        ('intensity', 'f4', 'sor', False),
    ],
)
def test_decoder_reads_them(name: str, kind: str, chain: str, *, known: bool) -> None:
    """A field of a usual name counts if a detector reads it; too large numbers are infinite."""
    values = [1.0, 1e300 if kind == 'f8' else 77.0, 3.0]
    rows = table(3, ring=('u2', 0), t=('u4', np.arange(3)), **{name: (kind, values)})
    points = Decoder(FilterParameters().changed({'chain': [chain]})).decode(cloud(rows))
    if known:
        expected = [1.0, np.inf if kind == 'f8' else 77.0, 3.0]
        assert points.intensity is not None
        assert points.intensity.tolist() == expected
        assert points.intensity.dtype == np.float32
    else:
        assert points.intensity is None
