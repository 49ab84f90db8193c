# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The contest as text: who found what on which cloud, and where others are better than we are."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from lidar_outlier_filter.evaluation.report import percent
from lidar_outlier_lab.results.markdown import (
    NOTHING,
    folded,
    number,
    paragraphs,
    table,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

    from lidar_outlier_lab.results.contest import Standing, Standings

    _Figure = Callable[[Standing], str]

SIGNIFICANT = 0.005  # a lead in F1 that is worth a sentence


@dataclass(frozen=True)
class Target:
    """What the default is to reach: an F1 of at least ``least``; ``lost`` of the good at most.

    Where it is to beat the ``tuned``, also the F1 of every other at its best thresholds.
    """

    name: str
    least: float
    lost: float
    tuned: bool = False

    def f1(self, others: Iterable[Standing]) -> float:
        """Return the F1 to reach beside these."""
        best = [one.best for one in others if not math.isnan(one.best)] if self.tuned else []
        return max([self.least, *best])

    def met(self, standing: Standing, others: Iterable[Standing] = ()) -> bool:
        """Return whether both are reached on all seeds together."""
        whole = standing.whole
        return whole.f1 >= self.f1(others) and whole.false_rejections.ratio <= self.lost


# By preset: the default chain is to be right on clouds like these without knowing which it is.
TARGETS: Mapping[str, Target] = {
    'leslar-a': Target('dense clouds', 0.985, 0.000015),
    'leslar-b': Target('scattered', 0.99, 0.000041),
    'leslar-c': Target('near the surface', 0.97, 0.0000025),
    'street-16': Target('rain and spray', 0.0, 0.002, tuned=True),
    'street-32': Target('snow', 0.92, 0.002, tuned=True),
    'street-64': Target('rain', 0.0, 0.002, tuned=True),
    'street-128': Target('rain and spray', 0.0, 0.002, tuned=True),
}


def overview(found: Standings, order: Sequence[str]) -> str:
    """Show contestants, in this order, on all samples: F1, then that at the best threshold."""
    best = {
        sample: max(_f1(standing) for standing in rows.values()) for sample, rows in found.items()
    }

    def bold_if_best(sample: str, text: str) -> str:
        return f'**{text}**' if text == best[sample] else text

    sheets = []
    for title, figure, dress in (
        ('F1', _f1, bold_if_best),
        ('F1 at the threshold that is best for each cloud', _best, lambda _, text: text),
    ):
        rows = [
            [name, *(dress(one, _cell(each.get(name), figure)) for one, each in found.items())]
            for name in order
        ]
        kept = [row for row in rows if any(cell != NOTHING for cell in row[1:])]
        sheets.append(paragraphs(f'{title}:', table(['', *found], kept)))
    return paragraphs(*sheets)


def details(found: Standings, order: Sequence[str]) -> str:
    """Show each sample by itself, all figures, contestants in this order."""
    return paragraphs(
        *(
            folded(sample, _one({name: rows[name] for name in order if name in rows}))
            for sample, rows in found.items()
        )
    )


def _one(rows: Mapping[str, Standing]) -> str:
    head = ('', 'seeds', 'recall', 'precision', 'F1', '95 %', 'good points lost', 'AUC', 'seconds')
    return table(head, [(name, *figures(standing)) for name, standing in rows.items()])


def figures(standing: Standing) -> tuple[str, ...]:
    """Write the figures of one contestant on one sample."""
    whole = standing.whole
    seconds = sum(record.seconds for record in standing.records) / len(standing.records)
    return (
        str(len(standing.records)),
        percent(whole.recall.ratio),
        percent(whole.precision.ratio),
        number(whole.f1),
        interval(standing),
        percent(whole.false_rejections.ratio),
        number(standing.auc, 4),
        f'{seconds:.1f}',
    )


def interval(standing: Standing) -> str:
    """Write between which limits the F1 is believed to lie."""
    low, high = standing.interval()
    return NOTHING if math.isnan(low) else f'{low:.3f} – {high:.3f}'


def targets(found: Standings, name: str, others: Sequence[str] = ()) -> str:
    """Show what the default chain reaches of what it is to reach beside others."""
    head = (
        'preset',
        'F1 to reach',
        'lost at most',
        'recall',
        'precision',
        'F1',
        '95 %',
        'worst seed',
        'good points lost',
        'seeds',
        'met',
    )
    rows = []
    for preset, target in TARGETS.items():
        standing = found.get(preset, {}).get(name)
        if standing is None:
            continue
        whole = standing.whole
        rivals = [found[preset][other] for other in others if other in found[preset]]
        rows.append(
            (
                f'{preset} ({target.name})',
                number(target.f1(rivals)),
                percent(target.lost),
                number(whole.recall.ratio),
                number(whole.precision.ratio),
                number(whole.f1),
                interval(standing),
                number(standing.worst),
                percent(whole.false_rejections.ratio),
                str(len(standing.records)),
                'yes' if target.met(standing, rivals) else '**no**',
            )
        )
    return table(head, rows) if rows else ''


def beside(found: Standings, names: Sequence[str]) -> str:
    """Show several contestants on the presets with targets.

    F1 as they are, F1 at the threshold that is best for each cloud, and what is lost.
    """
    presets = [preset for preset in TARGETS if preset in found]
    sheets = []
    for title, figure in (('F1', _f1), ('best F1', _best), ('good points lost', _lost)):
        rows = [
            [name, *(_cell(found[preset].get(name), figure) for preset in presets)]
            for name in names
        ]
        sheets.append(table((title, *presets), rows))
    return paragraphs(*sheets)


def worse(found: Standings, name: str, others: Collection[str]) -> str:
    """Say where others have a higher F1 than one of ours, or that none has."""
    lines = []
    for sample, rows in found.items():
        if name not in rows:
            continue
        mine = _f1_of(rows[name])
        better = {
            other: lead
            for other in rows
            if other in others and (lead := _f1_of(rows[other])) > mine + SIGNIFICANT
        }
        if better:
            listed = ', '.join(f'{other} {lead:.3f}' for other, lead in better.items())
            lines.append(f'* {sample}: {name} {mine:.3f}; {listed}')
    return '\n'.join(lines) if lines else 'Nowhere in this run.'


def _cell(standing: Standing | None, figure: _Figure) -> str:
    return NOTHING if standing is None else figure(standing)


def _f1_of(standing: Standing) -> float:
    """Take the F1; 0 where nothing was rejected."""
    value = standing.whole.f1
    return 0.0 if math.isnan(value) else value


def _f1(standing: Standing) -> str:
    return number(_f1_of(standing))


def _best(standing: Standing) -> str:
    return number(standing.best)


def _lost(standing: Standing) -> str:
    return percent(standing.whole.false_rejections.ratio)


def beaten(found: Standings, others: Collection[str]) -> str:
    """Say where one of the others has a higher F1 than all of ours."""
    lines = []
    for sample, rows in found.items():
        theirs = {name: _f1_of(one) for name, one in rows.items() if name in others}
        ours = {name: _f1_of(one) for name, one in rows.items() if name not in others}
        if not theirs or not ours:
            continue
        best, mine = max(theirs, key=theirs.__getitem__), max(ours, key=ours.__getitem__)
        if theirs[best] > ours[mine] + SIGNIFICANT:
            lines.append(f'* {sample}: {best} {theirs[best]:.3f}; ours at most {ours[mine]:.3f}')
    return '\n'.join(lines) if lines else 'Nowhere in this run.'
