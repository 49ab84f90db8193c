# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Output of the tuner: tables, a parameter file, and commands for a running node."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from rich.table import Table

from lidar_outlier_filter.core.annotations import Ints
from lidar_outlier_filter.evaluation.confusion import CONFIDENCE, Confusion, f1_interval
from lidar_outlier_filter.evaluation.report import limits, number_table, percent
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.parameters.yaml_files import as_yaml


@dataclass(frozen=True)
class Tuned:
    """Result of a search.

    Attributes
    ----------
    parameters : the best found, on all stretches
    values : what was searched, by name
    before, after : (S, 4) int64
        Tallies by stretch: with the parameters at the start, and with those found.
    held_out : (S, 4) int64
        The same with the parameters found without the stretch's fold: the expectation.
    folds : what was found without each fold
    alone : outliers and good points that each detector of the chain, and no other, rejects
    default : (S, 4) int64 or None
        Tally of the default chain; None if the search began with it.
    notes : sentences on values at limits of the search, and on detectors that reject nothing

    """

    parameters: FilterParameters
    values: Mapping[str, object]
    before: Ints
    after: Ints
    held_out: Ints
    folds: tuple[Mapping[str, object], ...]
    alone: Mapping[str, tuple[int, int]]
    default: Ints | None = None
    notes: tuple[str, ...] = ()


def whole(counts: Ints) -> Confusion:
    """Add up the tallies of all stretches."""
    return Confusion(*counts.sum(axis=0).tolist())


def tables(found: Tuned, start: FilterParameters) -> list[Table]:
    """Lay out what the chain was worth, is, and will be; then what was changed."""
    tallies = {'start': found.before, 'tuned': found.after, 'to expect': found.held_out}
    if found.default is not None:
        tallies = {'default': found.default, **tallies}
    worth = number_table('', *tallies, f'{100 * CONFIDENCE:g} % interval')
    runs = [whole(counts) for counts in tallies.values()]
    expected = f1_interval(found.held_out)
    low_to_high = '' if math.isnan(expected.low) else limits(expected)
    worth.add_row('F1', *(percent(run.f1) for run in runs), low_to_high)
    worth.add_row('precision', *(percent(run.precision.ratio) for run in runs))
    worth.add_row('recall', *(percent(run.recall.ratio) for run in runs))
    worth.add_row('good points lost', *(percent(run.false_rejections.ratio) for run in runs))
    # What each detector is needed for.
    alone = number_table('rejected by it alone', 'outliers', 'good points')
    for name, (outliers, good) in found.alone.items():
        alone.add_row(name, f'{outliers:,}', f'{good:,}')
    return [worth, _values(found, start), *([alone] if len(found.alone) > 1 else [])]


def _values(found: Tuned, start: FilterParameters) -> Table:
    table = Table('parameter', 'start', 'tuned', 'without each fold', box=None, pad_edge=False)
    before, after = start.flat(), found.parameters.flat()
    for name, start_value in before.items():
        others = [fold.get(name, start_value) for fold in found.folds]
        if any(value != start_value for value in (after[name], *others)):
            texts = ', '.join(dict.fromkeys(as_yaml(value) for value in others))
            table.add_row(name, as_yaml(start_value), as_yaml(after[name]), texts)
    return table


def sentence(found: Tuned, source: str) -> str:
    """Say in one line what the parameters are worth, and how that is known."""
    expected = whole(found.held_out)
    low, high = f1_interval(found.held_out)
    limits = '' if math.isnan(low) else f' ({100 * CONFIDENCE:g} %: {low:.3f} to {high:.3f})'
    return (
        f'Tuned on {source}: F1 {expected.f1:.3f}{limits}, '
        f'{percent(expected.false_rejections.ratio)} of the good points lost, '
        f'where it was not learnt from, in {len(found.folds)} folds.'
    )
