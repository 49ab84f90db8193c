# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The contest of all detectors, chains and peers on all presets, run and written up.

Everybody judges the same clouds in the same run, and each is counted alike.
"""

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from time import process_time
from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Ints, Progress
from lidar_outlier_filter.evaluation.confusion import Confusion, curve, f1, f1_interval, tally
from lidar_outlier_filter.evaluation.report import percent
from lidar_outlier_lab.results.contestants import (
    DEFAULT,
    MAX_PEER_POINTS,
    OURS,
    RULES,
    Contestant,
    missing,
    peers,
)
from lidar_outlier_lab.results.markdown import NOTHING, folded, number, paragraphs, table
from lidar_outlier_lab.results.samples import Sample, simulated

Contest = tuple[str, int, Sequence[Contestant]]  # preset, seed, and who judges what they give

STEPS = 100  # of a bar, for each cloud
SIGNIFICANT = 0.005  # a lead in F1 that is worth a sentence


@dataclass(frozen=True)
class Record:
    """How one contestant judged one sample.

    Attributes
    ----------
    sample, contestant : names
    seed : of the sample
    counts : (S, 4) int64, tally of each stretch
    auc : area under the ROC curve; NaN where there is no score
    seconds : of the processor that it took, once
    best : F1 at the best threshold for this sample; NaN where there is no score

    """

    sample: str
    contestant: str
    seed: int
    counts: Ints
    auc: float
    seconds: float
    best: float = math.nan


@dataclass(frozen=True)
class Standing:
    """One contestant on all seeds of one sample."""

    records: tuple[Record, ...]

    @property
    def by_seed(self) -> Ints:
        """Tally of each seed (R, 4)."""
        return np.array([record.counts.sum(axis=0) for record in self.records])

    @property
    def whole(self) -> Confusion:
        """Counts of all seeds together."""
        return Confusion(*self.by_seed.sum(axis=0).tolist())

    @property
    def auc(self) -> float:
        """Mean area under the ROC curve over the seeds; NaN where there is no score."""
        return fmean(record.auc for record in self.records)

    @property
    def best(self) -> float:
        """Mean F1 over the seeds, each at its best threshold; NaN where there is no score."""
        return fmean(record.best for record in self.records)

    @property
    def worst(self) -> float:
        """Lowest F1 of any seed; one without any F1 (nothing rejected) counts as 0."""
        return float(np.nan_to_num(f1(self.by_seed)).min())


Standings = dict[str, dict[str, Standing]]  # by sample, then by contestant


def compete(entries: Sequence[Contest], progress: Progress) -> list[Record]:
    """Let contestants judge what presets and seeds give.

    Parameters
    ----------
    entries : what they give is simulated once for each
    progress : is called before every step: how many of how many are done, and of what; it may leave

    """
    total, records = STEPS * len(entries), []
    for before, (preset, seed, contestants) in zip(range(0, total, STEPS), entries, strict=True):
        what = f'{preset}, seed {seed}'

        def simulating(done: float, what: str = what, before: int = before) -> None:
            progress(before + int(STEPS * done / 2), total, f'simulating {what}')

        samples = simulated(preset, seed, simulating)
        for sample in samples:
            for contestant in contestants:
                progress(before + STEPS // 2, total, f'{contestant.name} on {what}')
                if contestant.suits(sample):
                    records.append(score(contestant, sample))
    return records


def score(contestant: Contestant, sample: Sample) -> Record:
    """Let one judge one sample."""
    begin = process_time()  # others may be at work on the machine
    rejected, scores = contestant.judge(sample)
    seconds = process_time() - begin
    data = sample.data
    result = None if scores is None else curve(data.bad, scores)
    auc, best = (math.nan, math.nan) if result is None else (result.auc, result.best)
    counts = tally(data.bad, rejected, data.stretch, data.stretches)
    return Record(sample.name, contestant.name, sample.seed, counts, auc, seconds, best)


def standings(records: Iterable[Record]) -> Standings:
    """Put the seeds of each sample and contestant together, in the order in which they came."""
    together: dict[str, dict[str, list[Record]]] = {}
    for record in records:
        together.setdefault(record.sample, {}).setdefault(record.contestant, []).append(record)
    return {
        sample: {name: Standing(tuple(found)) for name, found in rows.items()}
        for sample, rows in together.items()
    }


_Figure = Callable[[Standing], str]


class Target(NamedTuple):
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


def entries(presets: Sequence[str], seeds: Sequence[int], full: int) -> list[Contest]:
    """Say who judges what.

    Parameters
    ----------
    presets : names
    seeds : where there is a target, the default, the rules and the peers judge all of them
    full : so many of the seeds, the first, are judged by everybody, on all presets

    """
    few = [*(one for one in OURS if one.name in {DEFAULT, *RULES}), *peers()]
    everybody = [*OURS, *peers()]
    return [
        (preset, seed, everybody if number < full else few)
        for preset in presets
        for number, seed in enumerate(seeds)
        if number < full or preset in TARGETS
    ]


def section(
    presets: Sequence[str], seeds: Sequence[int], full: int, progress: Progress
) -> dict[str, str]:
    """Run the contest and write it up: the sections ``default`` and ``contest``.

    In the second, everybody is compared on seeds that everybody has judged.
    """
    records = compete(entries(presets, seeds, full), progress)
    alike = standings([record for record in records if record.seed in seeds[:full]])
    return {
        'default': _default(standings(records), seeds),
        'contest': _contest(alike, seeds[:full]),
    }


def _default(found: Standings, seeds: Sequence[int]) -> str:
    others = [*RULES, *(peer.name for peer in peers())]
    reached = targets(found, DEFAULT, others)
    if not reached:
        return paragraphs('## The default', 'None of its presets were in this run.')
    aimed = {preset: found[preset] for preset in TARGETS if preset in found}
    return paragraphs(
        '## The default',
        f'Defaults as they are, without knowledge of the scene, on seeds {_list(seeds)}. None of '
        'them trained the trees. Intervals are of 95 %, drawn from the seeds with replacement; '
        'with few seeds they are rather too narrow. On streets, the F1 to reach is that of the '
        'best rule or peer in this run, each drive judged at the threshold that is best for it.',
        reached,
        'The rules and the peers in the same run. The best F1 is that at the threshold that suits '
        'each drive best, which nobody knows in the field:',
        *(
            sheet(aimed, [DEFAULT, *others], title, figure)
            for title, figure in (('F1', _f1), ('best F1', _best), ('good points lost', _lost))
        ),
        'Rules and peers with a higher F1 than the default, both as they are:',
        leader(found, [DEFAULT], others),
    )


def _contest(found: Standings, seeds: Sequence[int]) -> str:
    absent, others, ours = missing(), [one.name for one in peers()], [one.name for one in OURS]
    everybody = [*ours, *others]
    return paragraphs(
        '## All detectors, chains and peers on simulated clouds',
        'Protocol: `lidar-outlier-filter simulate PRESET --seed N` for each preset and seed; '
        'everybody gets the same points and is counted alike. Detectors have their default '
        'parameters, unless the name says otherwise; those with ±5 points have acceleration, and '
        'test each point once; these, and those with one surface, have a significance of 0.001. '
        'Recordings go through the stream in blocks of 0.1 s with 10 ms before and after, as in '
        'the node; single clouds (`pirotti-…`, `sotoodeh-hod`, `kang-…`) are judged as a whole, as '
        'by `clean`. Peers get what stands still as a whole (`leslar-…` and single clouds) and '
        "sweeps in the sensor's frame one by one.",
        f'Seeds: {_list(seeds)}. Intervals of 95 % are drawn from seeds where there are several, '
        'otherwise from 20 stretches of the one. The best F1 of each column is bold. `sor` as '
        'DROR has the setting that was found best for 32 rings in snow elsewhere, as DSOR that of '
        "its authors; both need the sensor's own frame. A dash: the cloud lacks what the detector "
        'needs (times, the origin), or it is too large for a slow peer (above '
        f'{MAX_PEER_POINTS:,} points at once).'
        + (f' Not installed, so left out: {", ".join(absent)}.' if absent else ''),
        'F1:',
        sheet(found, everybody, '', _f1, is_best_bold=True),
        'F1 at the threshold that is best for each cloud:',
        sheet(found, everybody, '', _best),
        'Where a peer has a higher F1 than every detector and chain of ours:',
        leader(found, ours, others),
        'Everything, sample by sample; seconds are of the processor, for one sample, once:',
        details(found, everybody),
    )


def _list(seeds: Sequence[int]) -> str:
    return ', '.join(map(str, seeds))


def sheet(
    found: Standings,
    names: Sequence[str],
    title: str,
    figure: _Figure,
    *,
    is_best_bold: bool = False,
) -> str:
    """Show one figure of contestants, in this order, on all samples."""
    columns = []
    for rows in found.values():
        cells = {name: figure(one) for name, one in rows.items()}
        best = max(cells.values()) if is_best_bold else None
        columns.append({name: f'**{c}**' if c == best else c for name, c in cells.items()})
    lines = [[name, *(column.get(name, NOTHING) for column in columns)] for name in names]
    return table([title, *found], [line for line in lines if {*line[1:]} != {NOTHING}])


def details(found: Standings, order: Sequence[str]) -> str:
    """Show each sample by itself, all figures, contestants in this order."""
    head = ('', 'seeds', 'recall', 'precision', 'F1', '95 %', 'good points lost', 'AUC', 'seconds')
    return paragraphs(
        *(
            folded(sample, table(head, [(n, *figures(rows[n])) for n in order if n in rows]))
            for sample, rows in found.items()
        )
    )


def figures(standing: Standing) -> tuple[str, ...]:
    """Write the figures of one contestant on one sample."""
    whole, count = standing.whole, len(standing.records)
    return (
        str(count),
        percent(whole.recall.ratio),
        percent(whole.precision.ratio),
        number(whole.f1),
        interval(standing),
        _lost(standing),
        number(standing.auc, 4),
        f'{sum(record.seconds for record in standing.records) / count:.1f}',
    )


def interval(standing: Standing) -> str:
    """Write how far the F1 would vary between drives; of one seed, between its stretches."""
    several = len(standing.records) > 1
    low, high = f1_interval(standing.by_seed if several else standing.records[0].counts)
    return NOTHING if math.isnan(low) else f'{low:.3f} – {high:.3f}'


def targets(found: Standings, name: str, others: Sequence[str] = ()) -> str:
    """Show what the default chain reaches of what it is to reach beside others."""
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
                _lost(standing),
                str(len(standing.records)),
                'yes' if target.met(standing, rivals) else '**no**',
            )
        )
    head = ('preset', 'F1 to reach', 'lost at most', 'recall', 'precision', 'F1', '95 %')
    more = ('worst seed', 'good points lost', 'seeds', 'met')
    return table((*head, *more), rows) if rows else ''


def leader(found: Standings, ours: Collection[str], others: Collection[str]) -> str:
    """Say where others have a higher F1 than the best of ours, or that none has."""
    lines = []
    for sample, rows in found.items():
        mine = max((one for one in rows if one in ours), key=lambda n: f1_of(rows[n]), default=None)
        if mine is None:
            continue
        limit = f1_of(rows[mine]) + SIGNIFICANT
        better = [one for one in rows if one in others and f1_of(rows[one]) > limit]
        if better:
            listed = ', '.join(f'{one} {f1_of(rows[one]):.3f}' for one in better)
            lines.append(f'* {sample}: {mine} {f1_of(rows[mine]):.3f}; {listed}')
    return '\n'.join(lines) if lines else 'Nowhere in this run.'


def f1_of(standing: Standing) -> float:
    """Take the F1; 0 where nothing was rejected."""
    value = standing.whole.f1
    return 0.0 if math.isnan(value) else value


def _f1(standing: Standing) -> str:
    return number(f1_of(standing))


def _best(standing: Standing) -> str:
    return number(standing.best)


def _lost(standing: Standing) -> str:
    return percent(standing.whole.false_rejections.ratio)
