# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""All that a report shows: points with scores, verdicts at every step, reasons, truth, counts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.judging.chain import Chain
from lidar_outlier_filter.report.keeping import Keeper
from lidar_outlier_filter.report.reasons import ExplainingChain
from lidar_outlier_filter.report.sliders import sliders
from lidar_outlier_filter.report.tally import Tally

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Progress
    from lidar_outlier_filter.evaluation.labels import Codes
    from lidar_outlier_filter.parameters.filter import FilterParameters
    from lidar_outlier_filter.report.keeping import Kept
    from lidar_outlier_filter.report.reasons import Reason
    from lidar_outlier_filter.report.sliders import Slider
    from lidar_outlier_filter.report.sources import ReportCloud, Source, SourceFacts


ROUNDING = 3e-7  # of a score in single precision, relative: what is nearer to a limit is uncertain


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
    given = sliders(source.parameters)
    tally, keeper, chain = Tally(given, codes), Keeper(most), ExplainingChain(source.parameters)
    steps = _Steps(given)
    for done, (_, cloud) in enumerate(source.judged([chain]), 1):
        progress(done, 0, 'judging')
        tally.add(cloud)
        bits = steps.of_scores(cloud, tally)
        keeper.add(cloud, bits, chain.reasons.of(cloud))
        chain.reasons.forget_before(cloud)
    kept = keeper.finish()
    scaled = chain.scaled and len(source.parameters.chain) == 1
    missing = steps.missing(scaled=scaled)
    for slider, step in missing:
        tally.at[slider][step].clear()
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


class _Steps:
    """Finds what each step rejects from the scores of the given parameters, where these say it."""

    def __init__(self, given: Sequence[Slider]) -> None:
        self._sliders = given
        self._uncertain: set[tuple[int, int]] = set()

    def of_scores(self, cloud: ReportCloud, tally: Tally) -> NDArray[np.uint32]:
        """Count what each step rejects of a cloud; return the bits of its points."""
        score, verdict = cloud.verdict.score.astype(np.float64), cloud.verdict
        bits = np.zeros(len(score), np.uint32)
        for number, slider in enumerate(self._sliders):
            for step, limit in enumerate(slider.limits.tolist()):
                if step == slider.given:
                    rejected = verdict.rejected
                else:
                    rejected = score > limit
                    if bool((np.abs(score - limit) <= ROUNDING * limit).any()):
                        self._uncertain.add((number, step))
                tally.add_step(number, step, cloud, rejected)
                bits |= rejected.astype(np.uint32) << np.uint32(slider.first + step)
        return bits

    def missing(self, *, scaled: bool) -> list[tuple[int, int]]:
        """List the steps that the scores do not say: slider and step."""
        if scaled:
            return sorted(self._uncertain)
        return [
            (number, step)
            for number, slider in enumerate(self._sliders)
            for step in range(len(slider.values))
            if step != slider.given
        ]


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
    chains = [Chain(given[one].changed(source.parameters, step)) for one, step in missing]
    total = len(missing) * len(tally.clouds)
    for done, (number, cloud) in enumerate(source.judged(chains), 1):
        progress(done, total, 'judging at every step')
        slider, step = missing[number]
        tally.add_step(slider, step, cloud, cloud.verdict.rejected)
        first, last = np.searchsorted(kept.cloud, (cloud.number, cloud.number + 1))
        bit = np.uint32(1 << (given[slider].first + step))
        mine = kept.bits[first:last]
        rejected = cloud.verdict.rejected[kept.index[first:last]]
        kept.bits[first:last] = np.where(rejected, mine | bit, mine & ~bit)
