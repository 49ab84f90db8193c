# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""All that a report shows: points with scores, verdicts at every step, reasons, truth, counts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.report.keeping import Keeper
from lidar_outlier_filter.report.reasons import ExplainingChain
from lidar_outlier_filter.report.score_counts import ScoreCounts
from lidar_outlier_filter.report.shared_sight import SharedSight
from lidar_outlier_filter.report.sliders import choices, sliders
from lidar_outlier_filter.report.tally import Tally

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lidar_outlier_filter.annotations import Progress
    from lidar_outlier_filter.evaluation.labels import Codes
    from lidar_outlier_filter.parameters.filter import FilterParameters
    from lidar_outlier_filter.report.keeping import Kept
    from lidar_outlier_filter.report.reasons import Reason
    from lidar_outlier_filter.report.sliders import Slider
    from lidar_outlier_filter.report.sources import Source, SourceFacts


@dataclass(frozen=True)
class Gathered:
    """What a report is made from.

    Attributes
    ----------
    name : of the recording or file
    found : what was found of its clouds
    parameters : of the filter
    sliders : one for each detector
    tally : counts of all points
    kept : the points that can be drawn
    reasons : of some
    ways : how the default judged, for people
    codes : what the truth means
    has_frames : whether clouds follow each other in time

    """

    name: str
    found: SourceFacts
    parameters: FilterParameters
    sliders: tuple[Slider, ...]
    tally: Tally
    kept: Kept
    reasons: list[Reason]
    ways: tuple[str, ...]
    codes: Codes
    has_frames: bool


def gather(
    source: Source, codes: Codes, most: int, progress: Progress = lambda _done, _total, _text: None
) -> Gathered:
    """Judge all clouds, once, and at every step of every slider.

    Where a threshold only divides the score, the score says what each step rejects. Where it does
    not, or where a score is as near to a limit as rounding, the clouds are judged at that step.

    Parameters
    ----------
    source : of the clouds
    codes : what their truth means
    most : points that are kept to be drawn
    progress : is called with how many of how many clouds are judged, and how

    """
    possible = choices(source.parameters)
    tally, keeper = Tally(codes), Keeper(most)
    chain = ExplainingChain(source.parameters, possible)
    scores = ScoreCounts(possible[0].limits) if len(possible) == 1 else None
    for done, (_, cloud) in enumerate(source.judged([chain]), 1):
        progress(done, 0, 'judging')
        tally.add(cloud)
        if scores:
            scores.add(cloud, *tally.split(cloud))
        keeper.add(cloud, chain.reasons.of(cloud))
        chain.reasons.forget_before(cloud)
    kept = keeper.finish()
    tested = tally.all.points - tally.untested
    rejected = [scores.rejected()] if scores else list(chain.rejected.values())
    given = sliders(possible, rejected, tested)
    tally.open(given)
    known = scores if chain.scaled else None
    missing = [
        (number, step)
        for number, slider in enumerate(given)
        for step in range(len(slider.values))
        if not _is_known(number, step, slider, known, tally, kept)
    ]
    _judge_steps(source, given, missing, tally, kept, progress)
    return Gathered(
        source.name,
        source.found,
        source.parameters,
        given,
        tally,
        kept,
        keeper.reasons,
        tuple(sorted(chain.reasons.ways)),
        codes,
        source.has_frames,
    )


def _is_known(  # noqa: PLR0913  what it takes from, and writes to
    number: int, step: int, slider: Slider, scores: ScoreCounts | None, tally: Tally, kept: Kept
) -> bool:
    """Note what a step rejects, if the given settings or the scores say it; say whether they do."""
    which = int(slider.chosen[step])
    if step == slider.given:
        rejected = kept.rejected
    elif scores is not None and not scores.uncertain[which]:
        tally.put(number, step, *scores.over(which, slider.detector))
        rejected = kept.score.astype(np.float64) > slider.limits[step]
    else:
        return False
    kept.bits[:] |= rejected.astype(np.uint32) << np.uint32(slider.first + step)
    return True


def _judge_steps(  # noqa: PLR0913  what a second reading adds to
    source: Source,
    given: Sequence[Slider],
    missing: Sequence[tuple[int, int]],
    tally: Tally,
    kept: Kept,
    progress: Progress,
) -> None:
    """Judge the clouds at some steps; count, and write the bits of the points that are kept."""
    if not missing:
        return
    with_reasons = source.parameters.changed({'scores': True})
    chains = [Chain(given[one].changed(with_reasons, step)) for one, step in missing]
    sight = SharedSight()
    for chain in chains:
        chain.see = sight
    total = len(missing) * len(tally.clouds)
    for done, (number, cloud) in enumerate(source.judged(chains), 1):
        progress(done, total, 'judging at every step')
        slider, step = missing[number]
        tally.add_step(slider, step, cloud)
        first, last = np.searchsorted(kept.cloud, (cloud.number, cloud.number + 1))
        bit = np.uint32(1 << (given[slider].first + step))
        rejected = cloud.verdict.rejected[kept.index[first:last]]
        kept.bits[first:last][rejected] |= bit
