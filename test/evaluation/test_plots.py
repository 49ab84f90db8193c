# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures: what is drawn is there, in both formats, and the same twice."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation import plots
from lidar_outlier_filter.evaluation.confusion import Confusion, Curve, confusion, curve


def made(strength: float) -> tuple[Curve, Confusion]:
    """Make a curve of 20 000 points, 1 % outliers, and what a threshold of 2 gives."""
    rng = np.random.default_rng(1)
    bad = rng.random(20_000) < 0.01
    score = rng.normal(0, 1, len(bad)) + strength * bad
    return curve(bad, score), confusion(bad, score > 2)


def pixels(path: Path) -> list[int]:
    """Count the pixels near each of the first three colours of a picture."""
    with Image.open(path) as image:
        shown = np.asarray(image.convert('RGB')).reshape(-1, 3).astype(np.int64)
    requested = [[int(one[i : i + 2], 16) for i in (1, 3, 5)] for one in plots.COLOURS[:3]]
    return [int((np.abs(shown - value).max(axis=1) < 24).sum()) for value in requested]


@pytest.mark.parametrize('draw', [plots.draw_roc, plots.draw_precision_recall])
def test_curves_are_drawn(tmp_path: Path, draw: Any) -> None:
    """Each curve in its colour, with its name in the legend, a dot where there is precision."""
    strong, setting = made(4.0)
    nothing = confusion(np.array([True, False]), np.array([False, False]))
    curves = {'strong one': strong, 'weak one': made(1.0)[0]}
    written = []
    for name in ('a', 'b'):
        (tmp_path / name).mkdir()
        files = draw(curves, tmp_path / name / 'x', {'strong one': setting, 'weak one': nothing})
        assert [file.name for file in files] == ['x.png', 'x.svg']
        written.append([file.read_bytes() for file in files])
    assert written[0] == written[1]
    strong_pixels, weak_pixels, others = pixels(files[0])
    assert (strong_pixels > 500, weak_pixels > 500, others) == (True, True, 0)
    area = strong.auc if draw is plots.draw_roc else strong.average_precision
    drawn = files[1].read_text(encoding='utf-8')
    assert f'{area:.4f}, dot' in drawn
    assert 'weak one' in drawn


def test_many_curves_and_refusals(tmp_path: Path) -> None:
    """More curves than colours differ by their dashes; no curve, and no folder, are refused."""
    one, _ = made(1.0)
    plots.draw_precision_recall({f'curve {i}': one for i in range(9)}, tmp_path / 'a')
    assert len({tuple(plots.style_of(i).values()) for i in range(9)}) == 9
    with pytest.raises(FilterError, match='must be at least one curve, got none'):
        plots.draw_roc({}, tmp_path / 'a')
    with pytest.raises(FilterError, match='must be written, got "No such file'):
        plots.draw_roc({'a': one}, tmp_path / 'no' / 'a')
