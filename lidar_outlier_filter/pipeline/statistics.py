# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What a filter counts: clouds, points and what became of them."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from lidar_outlier_filter.core.detectors.registry import bits, reasons
from lidar_outlier_filter.core.verdict import Verdict

MAX_REASONS = 50  # far more than there are
OTHER_REASONS = 'other reasons'


class CountsByReason(Counter[str]):
    """Counts by reason. Reasons may quote a message, so all beyond a limit are counted as one."""

    def note(self, what: str) -> None:
        """Count a reason once more."""
        self[what if what in self or len(self) < MAX_REASONS else OTHER_REASONS] += 1


@dataclass
class Statistics:
    """Counts since the start.

    Attributes
    ----------
    messages, points : clouds returned, and their points
    invalid : missing returns (NaN, Inf, 0 0 0), which stay in the cleaned clouds
    dropped : missing returns that are in no cloud, under ``missing: drop``
    untested : valid points that no detector could test; they stay too
    rejected : points by the detector that rejected them; points on the own vehicle by ``mask``
    reasons : points by the feature that counted most against them, where scores are published
    undecided : points by the detector that could not test them
    outliers : points in the outlier clouds
    bypassed : clouds that were not filtered, by reason; their points are counted as points only
    degraded : clouds that came while only line detectors judged
    refused : clouds refused; refusals counts them by reason
    poses : poses refused, by reason
    without_pose : clouds with points that were judged in their own frame, without poses
    resets : times the clock was set back
    passes : maximum passes over a block, each without the points rejected before
    failures : blocks that a detector raised an error in
    methods : blocks by method of the default
    lines : how scan lines were decided, in words; empty where they are used as they are

    """

    messages: int = 0
    points: int = 0
    invalid: int = 0
    dropped: int = 0
    untested: int = 0
    outliers: int = 0
    rejected: Counter[str] = field(default_factory=Counter)
    reasons: Counter[str] = field(default_factory=Counter)
    undecided: Counter[str] = field(default_factory=Counter)
    bypassed: Counter[str] = field(default_factory=Counter)
    refusals: CountsByReason = field(default_factory=CountsByReason)
    poses: CountsByReason = field(default_factory=CountsByReason)
    degraded: int = 0
    without_pose: int = 0
    resets: int = 0
    passes: int = 0
    failures: int = 0
    methods: Counter[str] = field(default_factory=Counter)
    lines: str = ''

    @property
    def refused(self) -> int:
        """Count the clouds refused, whatever the reason."""
        return sum(self.refusals.values())

    def count_bypassed(self, points: int, reason: str) -> None:
        """Add a cloud that was not filtered."""
        self.messages += 1
        self.points += points
        self.bypassed[reason] += 1

    def count(self, verdict: Verdict, valid: int) -> None:
        """Add a finished cloud."""
        total = len(verdict)
        masked = int(np.count_nonzero(verdict.masked))
        self.messages += 1
        self.points += total
        self.invalid += total - valid - masked
        self.untested += valid + masked - int(np.count_nonzero(~np.isnan(verdict.score)))
        self.outliers += int(np.count_nonzero(verdict.rejected))
        for counter, found in (
            (self.rejected, verdict.detectors),
            (self.undecided, verdict.undecided),
        ):
            there = int(np.bitwise_or.reduce(found, initial=0))  # few bits are, mostly one or none
            for name, bit in bits().items():
                if there & bit:
                    counter[name] += int(np.count_nonzero(found & bit))
        for number, count in enumerate(np.bincount(verdict.reason).tolist()):
            if number and count:
                self.reasons[reasons()[number].name] += count
