# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Curves: by hand, and equal to scikit-learn's, with ties and untested points."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from sklearn import metrics

from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation.confusion import curve

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Reals

KINDS = ('different', 'ties', 'untested', 'all equal', 'all untested', 'float32', 'infinite')


def scores(kind: str, seed: int, count: int = 500) -> tuple[NDArray[np.bool_], Reals]:
    """Make truth and scores that say something, but not all."""
    rng = np.random.default_rng(seed)
    bad = rng.random(count) < 0.1
    bad[:2] = True, False
    score: Reals = rng.lognormal(0, 1, count) + 2 * bad * rng.random(count)
    if kind == 'ties':
        score = np.round(score)
    if kind == 'untested':
        score[rng.random(count) < 0.2] = np.nan
    if kind in {'all equal', 'all untested'}:
        score[:] = 1.0 if kind == 'all equal' else np.nan
    if kind == 'float32':
        score = np.round(score.astype(np.float32), 2)
    if kind == 'infinite':
        score[rng.random(count) < 0.1] = np.inf
        score[rng.random(count) < 0.1] = np.nan
    return bad, score


def finite(score: Reals) -> Reals:
    """Write scores so that scikit-learn takes them: one lowest value, one highest."""
    lowered = np.where(np.isnan(score), -1.0, score)
    return np.where(np.isinf(lowered), 1e30, lowered)


def test_by_hand() -> None:
    """Six points, two of them tied, one untested."""
    bad = np.array([1, 0, 1, 0, 1, 0], np.bool_)
    score = np.array([5.0, 4.0, 3.0, 3.0, np.nan, 1.0])
    result = curve(bad, score)
    np.testing.assert_array_equal(result.threshold, [np.inf, 5, 4, 3, 1, -np.inf])
    np.testing.assert_array_equal(result.found, [0, 1, 1, 2, 2, 3])
    np.testing.assert_array_equal(result.lost, [0, 0, 1, 2, 3, 3])
    np.testing.assert_allclose(result.recall, [0, 1 / 3, 1 / 3, 2 / 3, 2 / 3, 1])
    np.testing.assert_allclose(result.false_rejections, [0, 0, 1 / 3, 2 / 3, 1, 1])
    np.testing.assert_allclose(result.precision, [1, 1, 1 / 2, 1 / 2, 2 / 5, 1 / 2])
    # Of nine pairs the outlier is above in 3 + 1, and level with the good point in one.
    assert result.auc == pytest.approx(4.5 / 9)
    # Steps of a third of the recall, at precisions 1, 1/2 and 1/2.
    assert result.average_precision == pytest.approx((1 + 1 / 2 + 1 / 2) / 3)


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize('seed', range(5))
def test_equal_to_scikit_learn(kind: str, seed: int) -> None:
    """Every point of both curves, and both areas, are scikit-learn's."""
    bad, score = scores(kind, seed)
    result = curve(bad, score)
    false, true, threshold = metrics.roc_curve(bad, finite(score), drop_intermediate=False)
    np.testing.assert_allclose(result.false_rejections, false)
    np.testing.assert_allclose(result.recall, true)
    known = np.isfinite(result.threshold)
    np.testing.assert_array_equal(result.threshold[known], threshold[known])
    assert result.auc == pytest.approx(metrics.roc_auc_score(bad, finite(score)), abs=1e-12)
    precision, recall, _ = metrics.precision_recall_curve(bad, finite(score))
    np.testing.assert_allclose(result.precision, precision[::-1])
    np.testing.assert_allclose(result.recall, recall[::-1])
    expected = metrics.average_precision_score(bad, finite(score))
    assert result.average_precision == pytest.approx(expected, abs=1e-12)


def test_thinned_curve_looks_the_same() -> None:
    """A thinned curve keeps both ends and lies on the whole one, nowhere far from it."""
    rng = np.random.default_rng(3)
    bad = rng.random(100_000) < 0.01
    score = rng.normal(0, 1, len(bad)) + 3 * bad
    whole = curve(bad, score)
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
    assert thin.auc == pytest.approx(whole.auc, abs=1e-3)
    assert whole.thinned(10**6) is whole


@pytest.mark.parametrize('bad', [[0, 0, 0], [1, 1], []])
def test_one_class_alone_is_refused(bad: list[int]) -> None:
    """Without outliers, or without good points, there is no curve."""
    with pytest.raises(FilterError, match='must be of outliers and good points, got'):
        curve(np.array(bad, np.bool_), np.zeros(len(bad)))
