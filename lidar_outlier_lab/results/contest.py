# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Everybody judges the same clouds in the same run, and each is counted alike."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import fmean
from time import process_time

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Progress
from lidar_outlier_filter.evaluation.confusion import (
    Confusion,
    Interval,
    curve,
    f1,
    f1_interval,
    tally,
)
from lidar_outlier_lab.results.contestants import Contestant
from lidar_outlier_lab.results.samples import Sample, simulated

STEPS = 100  # of a bar, for each cloud


@dataclass(frozen=True)
class Record:
    """How one contestant judged one sample.

    Attributes
    ----------
    sample, contestant : names
    seed : of the sample
    counts : (S, 4) int64
        Tally of each stretch.
    auc : area under the ROC curve; NaN where there is no score
    seconds : of the processor that it took, once
    best : F1 at the best threshold for this sample; NaN where there is no score

    """

    sample: str
    contestant: str
    seed: int
    counts: NDArray[np.int64]
    auc: float
    seconds: float
    best: float = math.nan


@dataclass(frozen=True)
class Standing:
    """One contestant on all seeds of one sample."""

    records: tuple[Record, ...]

    @property
    def by_seed(self) -> NDArray[np.int64]:
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

    def interval(self) -> Interval:
        """Say how far the F1 would vary between drives; of one seed, between its stretches."""
        counts = self.by_seed if len(self.records) > 1 else self.records[0].counts
        return f1_interval(counts)


Standings = dict[str, dict[str, Standing]]  # by sample, then by contestant


def compete(
    entries: Iterable[tuple[str, int, Sequence[Contestant]]],
    progress: Progress = lambda _done, _total, _what: None,
) -> list[Record]:
    """Let contestants judge what presets and seeds give.

    Parameters
    ----------
    entries : preset, seed, and who judges what they give; it is simulated once for each entry
    progress : is called before every step: how many of how many are done, and of what; it may leave

    """
    listed = list(entries)
    total, records = STEPS * len(listed), []
    for number, (preset, seed, contestants) in enumerate(listed):
        what, before = f'{preset}, seed {seed}', STEPS * number

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
