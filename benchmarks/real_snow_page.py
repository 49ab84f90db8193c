# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of real snow as tables, kept in a file, and as a part of a page."""

# ruff: noqa: INP001  a part of a script, no package

from __future__ import annotations

import json
from dataclasses import asdict
from itertools import pairwise
from typing import TYPE_CHECKING

from real_snow_forms import FORMS, RANGES, Figures
from real_snow_sweeps import CLASSES, SNOW

from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.evaluation.confusion import Confusion, Share
from lidar_outlier_filter.evaluation.report import percent
from lidar_outlier_lab.results.markdown import NOTHING, number, paragraphs, table

if TYPE_CHECKING:
    from pathlib import Path

    Judged = dict[str, Figures]  # by judge
    All = dict[str, Judged]  # by form

DEFAULT, NETWORK = 'default', '3D-OutDet'


def load(path: Path) -> All:
    """Read the figures that were kept; none where there is no file.

    Raises
    ------
    RecordingError
        If the file has others.

    """
    if not path.exists():
        return {}
    try:
        kept = json.loads(path.read_text(encoding='utf-8'))
        return {
            form: {judge: _figures(one) for judge, one in judged.items()}
            for form, judged in kept.items()
        }
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as err:
        raise RecordingError(str(path), 'figures that this command wrote', repr(err)) from err


def _figures(kept: dict[str, object]) -> Figures:
    """Make figures of what JSON has made of them: text of numbers, and lists of tuples."""
    classes = {int(label): tuple(pair) for label, pair in kept.pop('classes').items()}  # type: ignore[attr-defined]
    ranges = tuple(map(tuple, kept.pop('ranges')))  # type: ignore[call-overload]
    return Figures(classes=classes, ranges=ranges, **kept)  # type: ignore[arg-type]


def save(path: Path, everything: All) -> None:
    """Keep figures for a later run."""
    kept = {
        form: {judge: asdict(one) for judge, one in judged.items()}
        for form, judged in everything.items()
    }
    path.write_text(json.dumps(kept, indent=1) + '\n', encoding='utf-8')


def text(everything: All) -> str:
    """Write up all figures, form by form."""
    forms = [form for form in FORMS if everything.get(form)]
    return paragraphs(in_short(everything), *(of_form(form, everything[form]) for form in forms))


def in_short(everything: All) -> str:
    """Lay out F1, and the share of the good points that is lost, of each judge in each form."""
    forms = [form for form in FORMS if everything.get(form)]
    judges = dict.fromkeys(judge for form in forms for judge in everything[form])
    rows = [
        (_bold(judge, judge), *(_short(everything[form].get(judge)) for form in forms))
        for judge in judges
    ]
    return paragraphs(
        '## In short',
        'F1, and in brackets the good points lost:',
        table(('', *(FORMS[form].title for form in forms)), rows),
    )


def _short(figures: Figures | None) -> str:
    if figures is None:
        return NOTHING
    return f'{number(figures.whole.f1)} ({percent(figures.whole.false_rejections.ratio)})'


def _bold(judge: str, said: str) -> str:
    return f'**{said}**' if judge == DEFAULT else said


def of_form(form: str, judged: Judged) -> str:
    """Write up one form: all judges, by class, by range, and where the default is worse."""
    title = FORMS[form].title
    return paragraphs(
        f'## {title[0].upper()}{title[1:]}',
        *(f'Given to {names}: {said}.' for said, names in _given(judged).items()),
        whole(judged),
        'Rejected, by class. Of falling snow much is good, of all others little:',
        by_class(judged),
        'Found of the snow, and lost of the rest, by range:',
        by_range(judged),
        worse(judged),
    )


def _given(judged: Judged) -> dict[str, str]:
    """Say what was judged by whom; most often all judge the same."""
    said: dict[str, list[str]] = {}
    for judge, one in judged.items():
        sweeps, points, snow = one.sweeps, one.whole.total, one.whole.outliers
        text = f'{sweeps} sweeps, {points:,} points, {snow:,} of them falling snow'
        said.setdefault(text, []).append(judge)
    return {text: 'all' if len(said) == 1 else '; '.join(names) for text, names in said.items()}


def whole(judged: Judged) -> str:
    """Lay out what each judge does to all points."""
    head = ('', 'F1', 'precision', 'recall', 'good points lost', 'million points/s', 'chosen')
    rows = [
        (
            _bold(judge, judge),
            number(one.whole.f1),
            number(one.whole.precision.ratio),
            number(one.whole.recall.ratio),
            percent(one.whole.false_rejections.ratio),
            number(one.speed, 2),
            one.setting or 'nothing',
        )
        for judge, one in judged.items()
    ]
    return table(head, rows)


def by_class(judged: Judged) -> str:
    """Lay out the share of each class that is rejected."""
    present = [label for label in CLASSES if any(label in one.classes for one in judged.values())]
    present.sort(key=lambda label: label != SNOW)
    rows = []
    for label in present:
        pairs = [one.classes.get(label, (0, 0)) for one in judged.values()]
        points = max(points for points, _ in pairs)
        shares = [percent(Share(rejected, count).ratio) for count, rejected in pairs]
        rows.append((CLASSES[label], f'{points:,}', *shares))
    return table(('', 'points', *judged), rows)


def by_range(judged: Judged) -> str:
    """Lay out recall, and the share of the good points that is lost, by range."""
    rows = [
        (said, *(_of_range(one, index) for one in judged.values()))
        for index, said in enumerate(range_names())
    ]
    return table(('', *judged), rows)


def _of_range(figures: Figures, index: int) -> str:
    part = Confusion(*figures.ranges[index])
    return f'{percent(part.recall.ratio)}, {percent(part.false_rejections.ratio)}'


def range_names() -> list[str]:
    """Name the ranges."""
    return [*(f'{low:g} to {high:g} m' for low, high in pairwise(RANGES)), f'from {RANGES[-1]:g} m']


def worse(judged: Judged) -> str:
    """Say which peers are better than the default, and where the best of them is."""
    if DEFAULT not in judged:
        return 'The default was not judged.'
    own, others = judged[DEFAULT], {name: one for name, one in judged.items() if name != DEFAULT}
    better = [name for name, one in others.items() if one.whole.f1 > own.whole.f1]
    if not others:
        return ''
    said = f'Peers with a better F1 than the default: {", ".join(better) or "none"}.'
    best = max(others, key=lambda name: others[name].whole.f1)
    classes, found, lost = _losses(own, others[best])
    return paragraphs(
        said,
        ''
        if others[best].sweeps == own.sweeps
        else f'The default and {best} did not judge the same sweeps.',
        f'The best of the peers is {best}. It is better than the default in:',
        '\n'.join(
            (
                f'* classes of which it loses less: {"; ".join(classes) or "none"}',
                f'* ranges where it finds more of the snow: {"; ".join(found) or "none"}',
                f'* ranges where it loses less: {"; ".join(lost) or "none"}',
            )
        ),
    )


def _losses(own: Figures, peer: Figures) -> tuple[list[str], list[str], list[str]]:
    """List classes, ranges by what is found, and ranges by what is lost, where a peer is better."""
    classes = []
    for label, pair in own.classes.items():
        mine, its = _rejected(pair), _rejected(peer.classes.get(label, (0, 0)))
        if label != SNOW and its < mine:
            classes.append(f'{CLASSES.get(label, label)}, {percent(its)} against {percent(mine)}')
    found, lost = [], []
    for name, mine_, its_ in zip(range_names(), own.ranges, peer.ranges, strict=True):
        a, b = Confusion(*mine_), Confusion(*its_)
        if b.recall.ratio > a.recall.ratio:
            found.append(f'{name}, {percent(b.recall.ratio)} against {percent(a.recall.ratio)}')
        its, mine = b.false_rejections.ratio, a.false_rejections.ratio
        if its < mine:
            lost.append(f'{name}, {percent(its)} against {percent(mine)}')
    return classes, found, lost


def _rejected(pair: tuple[int, int]) -> float:
    return Share(pair[1], pair[0]).ratio
