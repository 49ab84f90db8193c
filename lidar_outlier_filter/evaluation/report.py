# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Evaluation of verdicts against the truth, and its tables."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from rich.table import Table

from lidar_outlier_filter.core.annotations import Bools, Bytes, Ints
from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.evaluation.confusion import (
    CONFIDENCE,
    SHARES,
    Confusion,
    Curve,
    Interval,
    Share,
    confusion,
    curve,
    f1_interval,
    tally,
)
from lidar_outlier_filter.evaluation.judged import Judged
from lidar_outlier_filter.evaluation.labels import Codes, words
from lidar_outlier_filter.evaluation.truth import Kind

STRETCHES = 20  # that a recording is cut into
SURFACES = Codes(names={kind: words(kind.name) for kind in Kind})
RANGE_BANDS_M = (0.0, 10.0, 20.0, 30.0, 50.0, 75.0, 100.0)  # metres; the last has no end


@dataclass(frozen=True)
class Evaluation:
    """How well the outliers were found.

    Attributes
    ----------
    whole : counts of all points
    stretches : (S, 4) int64, the same of each stretch of the recording
    causes : share of the outliers rejected, by cause or class
    surfaces : share of the good points rejected, by surface, if known
    ranges : counts by range, where that is known
    detectors : counts of what each detector rejected, where that is known
    untested : points without a score, and how many of them are outliers, where scores are known
    curve : results at other thresholds, if scores are known

    """

    whole: Confusion
    stretches: Ints
    causes: Mapping[str, Share]
    surfaces: Mapping[str, Share]
    ranges: Mapping[str, Confusion]
    detectors: Mapping[str, Confusion]
    untested: Share | None
    curve: Curve | None

    @property
    def f1_interval(self) -> Interval:
        """How far the F1 would vary between recordings like this one."""
        return f1_interval(self.stretches)


def evaluate(points: Judged, codes: Codes) -> Evaluation:
    """Compare verdicts with the truth.

    Parameters
    ----------
    points : judged points with their truth
    codes : names of its codes

    """
    stretch, count = points.stretch(STRETCHES)
    bad, score = points.bad, points.score
    both = 0 < np.count_nonzero(bad) < len(bad)
    untested = None
    if score is not None:
        unknown = np.isnan(score)
        untested = Share(int(np.count_nonzero(unknown & bad)), int(np.count_nonzero(unknown)))
    return Evaluation(
        confusion(bad, points.rejected),
        tally(bad, points.rejected, stretch, count),
        _by_code(points.code, bad, points.rejected, codes),
        {} if points.surface is None else _by_code(points.surface, ~bad, points.rejected, SURFACES),
        _ranges(points),
        _detectors(points),
        untested,
        curve(bad, score) if score is not None and both else None,
    )


def _by_code(code: Ints | Bytes, of: Bools, rejected: Bools, codes: Codes) -> dict[str, Share]:
    """Count some points by code, and those of them that are rejected."""
    there, which = np.unique(code[of], return_inverse=True)
    total = np.bincount(which, minlength=len(there)).tolist()
    found = np.bincount(which[rejected[of]], minlength=len(there)).tolist()
    names = (codes.name(one) for one in there.tolist())
    return {name: Share(*pair) for name, *pair in zip(names, found, total, strict=True)}


def _ranges(points: Judged) -> dict[str, Confusion]:
    """Count by range; nothing where all points are in one of them, as in a georeferenced cloud."""
    if points.range is None:
        return {}
    band = np.searchsorted(RANGE_BANDS_M, points.range, side='right') - 1
    counts = tally(points.bad, points.rejected, band, len(RANGE_BANDS_M))
    names = [f'{low:g} to {high:g} m' for low, high in pairwise(RANGE_BANDS_M)]
    names.append(f'{RANGE_BANDS_M[-1]:g} m and more')
    found = {
        name: Confusion(*row) for name, row in zip(names, counts.tolist(), strict=True) if any(row)
    }
    return found if len(found) > 1 else {}


def _detectors(points: Judged) -> dict[str, Confusion]:
    bits = points.detectors
    if bits is None:
        return {}
    found = {name: confusion(points.bad, (bits & one.bit) != 0) for name, one in DETECTORS.items()}
    return {name: counts for name, counts in found.items() if counts.rejected}


def to_json(result: Evaluation) -> dict[str, Any]:
    """Write all of it in the types of JSON; NaN and infinity are null."""
    groups = ('f1_interval', 'stretches', 'causes', 'surfaces', 'ranges', 'detectors')
    found: dict[str, Any] = {
        **_to_json(result.whole),
        'confidence': CONFIDENCE,
        **{name: _to_json(getattr(result, name)) for name in groups},
    }
    if result.untested is not None:
        found['untested'] = {'points': result.untested.total, 'outliers': result.untested.part}
    if whole := result.curve:
        # Areas under the whole curve, and enough of its points for any picture.
        thinned = whole.thinned()
        names = ('threshold', 'found', 'lost', 'recall', 'false_rejections', 'precision')
        found |= {'auc': whole.auc, 'average_precision': whole.average_precision}
        found['curve'] = {name: _to_json(getattr(thinned, name)) for name in names}
    return found


def _to_json(value: Any) -> Any:
    if isinstance(value, Confusion):
        shares = {name: _to_json(value.share(name)) for name in SHARES}
        return {**asdict(value), 'f1': _to_json(value.f1), **shares}
    if isinstance(value, Share):
        share, interval = _to_json(value.ratio), _to_json(value.interval)
        return {'part': value.part, 'total': value.total, 'share': share, 'interval': interval}
    if isinstance(value, dict):
        return {key: _to_json(one) for key, one in value.items()}
    if isinstance(value, np.ndarray | tuple | list):
        return [_to_json(one) for one in np.asarray(value).tolist()]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def tables(result: Evaluation) -> list[Table]:
    """Lay out one run: the papers' figures, then causes, surfaces, ranges and detectors."""
    content = [_figures(result)]
    for title, shares in (
        ('outliers', result.causes),
        ('good points', result.surfaces),
    ):
        if shares:
            content.append(_shares(title, shares))
    for title, groups in (('range', result.ranges), ('detector', result.detectors)):
        if groups:
            content.append(_groups(title, groups))
    for table in content:
        table.padding = (0, 1, 0, 0)  # in 80 columns
    return content


def number_table(*columns: str) -> Table:
    """Make a table whose first column is a text and all others are numbers."""
    content = Table(*columns, box=None, pad_edge=False)
    for column in content.columns:
        column.no_wrap = True
    for column in content.columns[1:]:
        column.justify = 'right'
    return content


def _figures(result: Evaluation) -> Table:
    content = number_table('', 'points', 'share', 'of', f'{100 * CONFIDENCE:g} % interval')
    whole = result.whole
    content.add_row('points', f'{whole.total:,}')
    for name, (_, of, title) in SHARES.items():
        share = whole.share(name)
        shown = (f'{share.part:,}', percent(share.ratio), of.replace('total', 'cloud'))
        content.add_row(title, *shown, limits(share.interval))
    content.add_row('F1', '', percent(whole.f1), '', limits(result.f1_interval))
    if result.untested is not None:
        unknown = result.untested
        content.add_row('untested, and so kept', f'{unknown.total:,}')
        content.add_row('  outliers among them', f'{unknown.part:,}', percent(unknown.ratio))
    if result.curve is not None:
        content.add_row('area under the ROC curve', '', f'{result.curve.auc:.4f}')
        content.add_row('average precision', '', f'{result.curve.average_precision:.4f}')
    return content


def _shares(title: str, shares: Mapping[str, Share]) -> Table:
    content = number_table(
        title, 'points', 'identified', 'share', f'{100 * CONFIDENCE:g} % interval'
    )
    for name, share in shares.items():
        counts = (f'{share.total:,}', f'{share.part:,}')
        content.add_row(name, *counts, percent(share.ratio), limits(share.interval))
    return content


def _groups(title: str, groups: Mapping[str, Confusion]) -> Table:
    content = number_table(title, 'outliers', 'found', 'recall', 'precision', 'F1', 'good lost', '')
    for name, one in groups.items():
        ratios = (one.recall.ratio, one.precision.ratio, one.f1)
        lost = (f'{one.lost:,}', percent(one.false_rejections.ratio))
        counts = (f'{one.outliers:,}', f'{one.found:,}')
        content.add_row(name, *counts, *(percent(ratio) for ratio in ratios), *lost)
    return content


def percent(ratio: float) -> str:
    """Write a share in percent: two decimals, and below one percent two digits that count."""
    if math.isnan(ratio):
        return '–'
    value = 100 * ratio
    decimals = 2 if value == 0 or value >= 1 else min(6, 1 - math.floor(math.log10(value)))
    return f'{value:.{max(decimals, 2)}f} %'


def limits(interval: Interval) -> str:
    """Write an interval in percent."""
    if math.isnan(interval.low):
        return '–'
    return f'{percent(interval.low)} – {percent(interval.high)}'
