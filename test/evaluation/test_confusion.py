# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Counts by hand, tables of the papers, published intervals, and curves equal to scikit-learn's."""

import math

import numpy as np
import pytest
from sklearn import metrics

from lidar_outlier_filter.core.annotations import Reals
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation.confusion import Share, confusion, curve, f1_interval


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
    """Precision, recall and F1 are NaN where the denominator is 0."""
    counts = confusion(np.array(bad, np.bool_), np.array(rejected, np.bool_))
    figures = (counts.precision.ratio, counts.recall.ratio, counts.f1)
    np.testing.assert_allclose(figures, expected)


@pytest.mark.parametrize(
    ('part', 'total', 'low', 'high'),
    [
        # Newcombe (1998), Statistics in Medicine 17, table I, method 3
        (81, 263, 0.2553, 0.3662),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
        (20, 20, 1 - 0.1611, 1.0),
    ],
)
def test_wilson(part: int, total: int, low: float, high: float) -> None:
    """Wilson's score interval has the published values."""
    assert Share(part, total).interval == pytest.approx((low, high), abs=5e-5)


def test_bootstrap() -> None:
    """The interval spans two unequal stretches, covers the truth, and needs two with an F1."""
    assert f1_interval(np.array([[10, 0, 0, 90], [0, 10, 0, 90]])) == (0.0, 1.0)
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
    for too_little in ([[5, 1, 1, 9]], [[0, 0, 0, 9], [0, 0, 0, 9]]):
        assert all(math.isnan(limit) for limit in f1_interval(np.array(too_little)))


@pytest.mark.parametrize('kind', ['different', 'ties', 'all equal', 'all untested', 'infinite'])
@pytest.mark.parametrize('seed', range(2))
def test_equal_to_scikit_learn(kind: str, seed: int) -> None:
    """Every point of both curves, and both areas, are scikit-learn's."""
    rng = np.random.default_rng(seed)
    bad = rng.random(500) < 0.1
    bad[:2] = True, False
    score: Reals = rng.lognormal(0, 1, 500) + 2 * bad * rng.random(500)
    if kind == 'ties':
        score = np.round(score.astype(np.float32))
    if kind in {'all equal', 'all untested'}:
        score[:] = 1.0 if kind == 'all equal' else np.nan
    if kind == 'infinite':
        score[rng.random(500) < 0.1] = np.inf
        score[rng.random(500) < 0.1] = np.nan
    # scikit-learn takes finite scores only.
    finite = np.nan_to_num(score, nan=-1.0, posinf=1e30)
    result = curve(bad, score)
    false, true, threshold = metrics.roc_curve(bad, finite, drop_intermediate=False)
    np.testing.assert_allclose(result.false_rejections, false)
    np.testing.assert_allclose(result.recall, true)
    known = np.isfinite(result.threshold)
    np.testing.assert_array_equal(result.threshold[known], threshold[known])
    assert result.auc == pytest.approx(metrics.roc_auc_score(bad, finite), abs=1e-12)
    precision, recall, _ = metrics.precision_recall_curve(bad, finite)
    np.testing.assert_allclose(result.precision, precision[::-1])
    np.testing.assert_allclose(result.recall, recall[::-1])
    expected = metrics.average_precision_score(bad, finite)
    assert result.average_precision == pytest.approx(expected, abs=1e-12)
    assert result.best == pytest.approx(
        np.nanmax(2 * precision * recall / np.maximum(precision + recall, 1e-12))
    )


def test_thinned_curve_is_drawn_alike() -> None:
    """A thinned curve keeps both ends and lies on the whole one, nowhere far from it."""
    rng = np.random.default_rng(3)
    bad = rng.random(100_000) < 0.01
    whole = curve(bad, rng.normal(0, 1, len(bad)) + 3 * bad)
    thin = whole.thinned(300)
    assert len(thin.threshold) <= 300
    assert set(thin.threshold) <= set(whole.threshold)
    for name in ('threshold', 'found', 'lost'):
        assert getattr(thin, name)[[0, -1]].tolist() == getattr(whole, name)[[0, -1]].tolist()
    assert np.diff(thin.recall).max() < 0.0125
    assert np.diff(thin.false_rejections).max() < 0.0125
    # In each decade of false rejections that exists there are points.
    decades = np.floor(np.log10(thin.false_rejections[thin.lost > 0]))
    assert np.bincount((-decades).astype(np.int64))[1:5].min() > 10
    assert whole.thinned(10**6) is whole


@pytest.mark.parametrize('bad', [[0, 0, 0], [1, 1], []])
def test_one_class_alone_is_refused(bad: list[int]) -> None:
    """Without outliers, or without good points, there is no curve."""
    with pytest.raises(FilterError, match='must be of outliers and good points, got'):
        curve(np.array(bad, np.bool_), np.zeros(len(bad)))
