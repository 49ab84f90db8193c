# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Counts made by hand, the papers' tables made anew from their counts, intervals of textbooks."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest

from lidar_outlier_filter.evaluation.confusion import (
    Confusion,
    Share,
    confusion,
    f1_interval,
)

# Truth, verdict, group: two of three outliers are found, one of five good points is lost.
BAD = np.array([0, 1, 0, 1, 1, 0, 0, 0], np.bool_)
REJECTED = np.array([0, 1, 1, 0, 1, 0, 0, 0], np.bool_)


def test_counts_by_hand() -> None:
    """All figures of a table small enough to count."""
    counts = confusion(BAD, REJECTED)
    assert counts == Confusion(found=2, missed=1, lost=1, kept=4)
    assert (counts.outliers, counts.good, counts.rejected, counts.total) == (3, 5, 3, 8)
    assert counts.precision == Share(2, 3)
    assert counts.recall == Share(2, 3)
    assert counts.misses == Share(1, 3)
    assert counts.false_rejections == Share(1, 5)
    assert counts.prevalence == Share(3, 8)
    assert counts.identified == Share(3, 8)
    assert counts.alpha_error == Share(1, 8)
    assert counts.beta_error == Share(1, 8)
    assert counts.f1 == pytest.approx(2 / 3)


@pytest.mark.parametrize(
    ('bad', 'rejected', 'expected'),
    [
        ([0, 0], [0, 0], (math.nan, math.nan, math.nan)),
        ([0, 0], [0, 1], (0.0, math.nan, 0.0)),
        ([1, 0], [0, 0], (math.nan, 0.0, 0.0)),
        ([1, 1], [1, 1], (1.0, 1.0, 1.0)),
        ([1, 1, 1, 0], [1, 0, 0, 0], (1.0, 1 / 3, 0.5)),
        ([], [], (math.nan, math.nan, math.nan)),
    ],
)
def test_figures_at_the_limits(
    bad: list[int], rejected: list[int], expected: tuple[float, float, float]
) -> None:
    """What cannot be divided is no number; precision, recall and F1 differ where they should."""
    counts = confusion(np.array(bad, np.bool_), np.array(rejected, np.bool_))
    figures = (counts.precision.ratio, counts.recall.ratio, counts.f1)
    np.testing.assert_allclose(figures, expected)


# The papers -------------------------------------------------------------------------------------


class Row(NamedTuple):
    """One column of a table of Leslar et al. (2010), as printed; shares in percent."""

    points: int
    outliers: int
    found: int
    lost: int
    missed: int
    recall: float
    identified: float
    incorrectly: float


A, B, C = (1_098_689, 11_035), (295_147, 872), (237_740, 31)
LESLAR = {
    '2A': Row(*A, 3414, 55, 7621, 30.94, 0.32, 0.01),
    '2B': Row(*B, 291, 27, 581, 33.37, 0.11, 0.01),
    '2C': Row(*C, 4, 3, 27, 12.90, 0.00, 0.00),
    '3A': Row(*A, 16, 0, 11_024, 0.14, 0.00, 0.00),
    '3B': Row(*B, 33, 0, 839, 3.78, 0.01, 0.00),
    '3C': Row(*C, 4, 0, 27, 12.90, 0.00, 0.00),
    '4A': Row(*A, 5221, 15_431, 5060, 47.31, 1.88, 1.40),
    '4B': Row(*B, 712, 0, 160, 81.65, 0.24, 0.00),
    '4C': Row(*C, 15, 193, 16, 48.39, 0.09, 0.08),
    # Both routines of table 5 together: 3449 + 11, 53 + 1 and so on.
    '5A': Row(*A, 3460, 54, 7575, 31.35, 0.32, 0.00),
    '5B': Row(*B, 314, 25, 558, 36.01, 0.11, 0.01),
    '5C': Row(*C, 5, 4, 27, 16.13, 0.00, 0.00),
}
# Where found + missed are not the outliers of table 1. All shares are those of the found.
SLIPS = {
    '3A': 'missed 11 024, should be 11 019',
    '4A': 'missed 5060, should be 5814',
    '5C': 'missed 27, should be 26',
}


@pytest.mark.parametrize('name', LESLAR)
def test_tables_of_leslar(name: str) -> None:
    """Tables 2 to 5: every share follows from the counts, and three counts do not add up."""
    row = LESLAR[name]
    missed = row.outliers - row.found
    counts = Confusion(row.found, missed, row.lost, row.points - row.outliers - row.lost)
    assert counts.total == row.points
    assert counts.outliers == row.outliers
    printed = (row.recall, row.identified, row.incorrectly)
    shares = (counts.recall, counts.identified, counts.alpha_error)
    assert [round(100 * share.ratio, 2) for share in shares] == pytest.approx(printed)
    if row.missed != missed:
        assert SLIPS[name] == f'missed {_spaced(row.missed)}, should be {_spaced(missed)}'
    else:
        assert name not in SLIPS


def _spaced(number: int) -> str:
    return f'{number:,}'.replace(',', ' ' if number >= 10_000 else '')


# Intervals --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('part', 'total', 'low', 'high'),
    [
        # Newcombe (1998), Statistics in Medicine 17, table I, method 3
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
        (20, 20, 1 - 0.1611, 1.0),
    ],
)
def test_wilson(part: int, total: int, low: float, high: float) -> None:
    """Wilson's score interval has the published values."""
    interval = Share(part, total).interval
    assert interval == pytest.approx((low, high), abs=5e-5)


def test_bootstrap_of_two_stretches_by_hand() -> None:
    """Of two stretches, one perfect and one without any find, all draws can be counted.

    A quarter of the draws has the first twice (F1 1), a quarter the second twice (0), half of them
    both (10 found, 10 missed: 2/3).
    """
    counts = np.array([[10, 0, 0, 90], [0, 10, 0, 90]])
    assert f1_interval(counts) == (0.0, 1.0)


def test_bootstrap_covers_the_truth() -> None:
    """Of 95 % intervals for stretches drawn at random most hold the F1 of the whole process."""
    rng = np.random.default_rng(3)
    hits = 0
    for trial in range(100):
        # Outliers come in clouds: each stretch has its own share of found ones.
        found = rng.binomial(200, rng.uniform(0.5, 1.0, 40))
        lost = rng.poisson(20, 40)
        counts = np.stack([found, 200 - found, lost, np.full(40, 5000)], axis=1)
        low, high = f1_interval(counts, seed=trial)
        hits += low <= 2 * 150 / (2 * 150 + 20 + 50) <= high
    assert 86 <= hits <= 99


def test_bootstrap_of_too_little() -> None:
    """One stretch, or stretches without any outlier or rejection, say nothing."""
    for counts in ([[5, 1, 1, 9]], [[0, 0, 0, 9], [0, 0, 0, 9]]):
        assert all(math.isnan(limit) for limit in f1_interval(np.array(counts)))
