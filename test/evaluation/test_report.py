# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Evaluations against counts made by hand, and how they are laid out and drawn."""

import json
import math
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.labelled import BAD, REJECTED, TRUTH
from PIL import Image
from rich.console import Console

from lidar_outlier_filter.cli.terminal import show
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation import plots
from lidar_outlier_filter.evaluation.confusion import Confusion, Curve, Share, confusion, curve
from lidar_outlier_filter.evaluation.judged import CAUSES, Judged
from lidar_outlier_filter.evaluation.report import evaluate, percent, tables, to_json

POINTS = Judged(
    TRUTH[:, 0].astype(np.int64),
    BAD,
    REJECTED,
    np.arange(8) // 2,
    TRUTH[:, 3].astype(np.float32),
    np.array([0, 1, 5, 0, 4, 0, 0, 0], np.uint16),
    np.arange(0.0, 80.0, 10.0),
    TRUTH[:, 1].astype(np.uint8),
)


def lines(*things: object) -> list[str]:
    """Print as on a terminal of 80 columns; return the lines, each with single spaces."""
    text = StringIO()
    for thing in things:
        Console(width=80, file=text).print(thing)
    return [' '.join(line.split()) for line in text.getvalue().splitlines()]


def test_by_hand() -> None:
    """All groups of eight points, counted by hand; then as JSON, and printed."""
    result = evaluate(POINTS, CAUSES)
    assert result.whole == Confusion(found=2, missed=1, lost=1, kept=4)
    expected = [[1, 0, 0, 1], [0, 1, 1, 0], [1, 0, 0, 1], [0, 0, 0, 2]]
    np.testing.assert_array_equal(result.stretches, expected)
    assert result.causes == {'exhaust': Share(1, 2), 'mixed': Share(1, 1)}
    assert result.surfaces == {'road': Share(1, 3), 'pole': Share(0, 1), 'car': Share(0, 1)}
    assert result.ranges == {
        '0 to 10 m': Confusion(0, 0, 0, 1),
        '10 to 20 m': Confusion(1, 0, 0, 0),
        '20 to 30 m': Confusion(0, 0, 1, 0),
        '30 to 50 m': Confusion(1, 1, 0, 0),
        '50 to 75 m': Confusion(0, 0, 0, 3),
    }
    counts = Confusion(1, 2, 1, 4)
    assert result.detectors == {'alpha_beta_gamma': counts, 'lof': counts}
    assert result.untested == Share(1, 2)
    assert result.curve is not None
    # Of 15 pairs the outlier is above in 5 + 5, level with the untested good point in one.
    assert result.curve.auc == pytest.approx(10.5 / 15)
    found = json.loads(json.dumps(to_json(result), allow_nan=False))
    assert [found[name] for name in ('found', 'missed', 'lost', 'kept')] == [2, 1, 1, 4]
    assert found['f1'] == pytest.approx(2 / 3)
    assert found['f1_interval'] == list(result.f1_interval)
    recall = {'part': 2, 'total': 3, 'share': 2 / 3, 'interval': list(Share(2, 3).interval)}
    assert found['recall'] == recall
    assert found['causes']['exhaust']['share'] == 0.5
    assert found['detectors']['lof']['found'] == 1
    assert found['untested'] == {'points': 2, 'outliers': 1}
    assert found['curve']['threshold'][:2] == [None, 9.0]
    assert found['curve']['found'][-1] == 3
    printed = lines(*tables(result))
    for line in (
        'points 8',
        'outliers 3 37.50 % cloud 13.68 % – 69.43 %',
        'outliers identified, recall 2 66.67 % outliers 20.77 % – 93.85 %',
        'outliers missed 1 33.33 % outliers 6.15 % – 79.23 %',
        'non-outliers identified 1 20.00 % good 3.62 % – 62.45 %',
        'wrongly identified, α-error 1 12.50 % cloud 2.24 % – 47.09 %',
        'missed, β-error 1 12.50 % cloud 2.24 % – 47.09 %',
        'rightly identified, precision 2 66.67 % rejected 20.77 % – 93.85 %',
        'untested, and so kept 2',
        'outliers among them 1 50.00 %',
        'area under the ROC curve 0.7000',
        'exhaust 2 1 50.00 % 9.45 % – 90.55 %',
        'road 3 1 33.33 % 6.15 % – 79.23 %',
        '30 to 50 m 2 1 50.00 % 100.00 % 66.67 % 0 –',
        'lof 3 1 33.33 % 50.00 % 40.00 % 1 20.00 %',
    ):
        assert line in printed


@pytest.mark.parametrize('total', [5_000_000, 99_000_000])
def test_small_shares_are_whole(total: int, capsys: pytest.CaptureFixture[str]) -> None:
    """They fit into 80 columns; of very many points they go beyond, and no digit is cut."""
    counts = Confusion(found=7321, missed=400, lost=21, kept=total)
    result = replace(
        evaluate(POINTS, CAUSES),
        whole=counts,
        causes={'near surface': Share(21, total)},
        detectors={'alpha_beta_gamma': counts},
        stretches=np.array([[1, 0, 1, total]]),
    )
    show(*tables(result))
    printed = capsys.readouterr().out
    assert '…' not in printed
    assert f'{total:,}' in printed
    assert max(map(len, printed.splitlines())) <= (80 if total < 1e7 else 99)


@pytest.mark.parametrize('kept', [BAD, ~BAD])
def test_one_class_alone_without_columns(kept: np.ndarray) -> None:
    """Outliers alone, or good points alone, without scores, bits, ranges and surfaces."""
    bare = replace(POINTS.take(kept), detectors=None, range=None, surface=None)
    result = evaluate(bare, CAUSES)
    assert (result.surfaces, result.ranges, result.detectors) == ({}, {}, {})
    assert result.curve is None
    assert result.whole.total == np.count_nonzero(kept)
    assert math.isnan(result.whole.recall.ratio) == (not kept[1])
    json.dumps(to_json(result), allow_nan=False)
    assert any(line.startswith('F1 ') for line in lines(*tables(result)))
    assert evaluate(replace(bare, score=None), CAUSES).untested is None


@pytest.mark.parametrize(
    ('ratio', 'printed'),
    [
        (0.0, '0.00 %'),
        (1.0, '100.00 %'),
        (0.123456, '12.35 %'),
        (0.0000123456, '0.0012 %'),
        (1e-12, '0.000000 %'),
        (math.nan, '–'),
    ],
)
def test_percent(ratio: float, printed: str) -> None:
    """Two decimals; small shares keep two digits that count."""
    assert percent(ratio) == printed


# Pictures ---------------------------------------------------------------------------------------


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
