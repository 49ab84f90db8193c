# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures: what is drawn is there, in both forms, and the same twice."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image

from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation import plots
from lidar_outlier_filter.evaluation.confusion import Curve, confusion, curve

if TYPE_CHECKING:
    from pathlib import Path

    from lidar_outlier_filter.evaluation.confusion import Confusion


def made(strength: float, seed: int = 1) -> tuple[Curve, Confusion]:
    """Make a curve of 20 000 points, 1 % outliers, and what a threshold of 2 gives."""
    rng = np.random.default_rng(seed)
    bad = rng.random(20_000) < 0.01
    score = rng.normal(0, 1, len(bad)) + strength * bad
    return curve(bad, score), confusion(bad, score > 2)


def colours(path: Path) -> dict[str, int]:
    """Count the pixels near each colour of a picture."""
    with Image.open(path) as image:
        pixels = np.asarray(image.convert('RGB')).reshape(-1, 3).astype(np.int64)
    wanted = {one: [int(one[i : i + 2], 16) for i in (1, 3, 5)] for one in plots.COLOURS[:3]}
    return {
        one: int((np.abs(pixels - value).max(axis=1) < 24).sum()) for one, value in wanted.items()
    }


@pytest.mark.parametrize('draw', [plots.draw_roc, plots.draw_precision_recall])
def test_curves_are_drawn(tmp_path: Path, draw: Any) -> None:
    """Each curve in its colour, with its name and area in the legend; twice gives the same."""
    strong, setting = made(4.0)
    weak, _ = made(1.0)
    curves = {'strong one': strong, 'weak one': weak}
    files = draw(curves, tmp_path / 'a', {'strong one': setting})
    assert [file.name for file in files] == ['a.png', 'a.svg']
    seen = list(colours(files[0]).values())
    assert seen[0] > 500
    assert seen[1] > 500
    assert seen[2] == 0
    (tmp_path / 'again').mkdir()
    again = draw(curves, tmp_path / 'again' / 'a', {'strong one': setting})
    for one, other in zip(files, again, strict=True):
        assert one.read_bytes() == other.read_bytes()
    drawn = files[1].read_text(encoding='utf-8')
    area = strong.auc if draw is plots.draw_roc else strong.average_precision
    assert f'strong one  {"AUC" if draw is plots.draw_roc else "average"} {area:.4f}, dot' in drawn
    assert drawn.count(', dot: as it was run') == 1


def test_a_verdict_without_rejections_has_no_dot(tmp_path: Path) -> None:
    """Nothing rejected has no precision; the curve is drawn all the same."""
    one, _ = made(3.0)
    nothing = confusion(np.array([True, False]), np.array([False, False]))
    plots.draw_precision_recall({'a': one}, tmp_path / 'a', {'a': nothing})
    assert colours(tmp_path / 'a.png')[plots.COLOURS[0]] > 500


@pytest.mark.slow
def test_many_curves_differ(tmp_path: Path) -> None:
    """More curves than colours differ by their dashes."""
    curves = {f'curve {i}': made(0.5 * i)[0] for i in range(9)}
    plots.draw_roc(curves, tmp_path / 'a')
    looks = {tuple(plots.look_of(i).values()) for i in range(9)}
    assert len(looks) == 9


def test_refusals(tmp_path: Path) -> None:
    """Nothing to draw, and nowhere to write it."""
    with pytest.raises(FilterError, match='must be at least one curve, got none'):
        plots.draw_roc({}, tmp_path / 'a')
    with pytest.raises(FilterError, match='must be written, got No such file'):
        plots.draw_roc({'a': made(1.0)[0]}, tmp_path / 'no' / 'a')
