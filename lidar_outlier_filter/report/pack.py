# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Sixteen bytes a point: four words that the page hands to the GPU as they are.

Words 0 and 1: x, y and z in steps of the frame's box, 21 bits each. Word 2, from the lowest bit:
score × 256 (10 bits, ``UNTESTED`` without), intensity (7), strongest reason (7, its index in
:func:`reason_names`, from 1; 0 without), number of the first detector that rejects it (4, 0: none),
truth (2). Word 3: the steps of the sliders that reject it (21 bits), then the rank of its scan line
in the frame (11, modulo).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.detectors.registry import reasons
from lidar_outlier_filter.messages.cloud import first_numbers
from lidar_outlier_filter.report.keeping import table
from lidar_outlier_filter.report.sliders import BITS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Words
    from lidar_outlier_filter.report.frames import Frames
    from lidar_outlier_filter.report.gather import Gathered

WORDS = 4
STEPS = (1 << 21) - 1  # of a box, on each axis
SCORE_UNIT = 256
UNTESTED = 1023
INTENSITIES = 127
NO_TRUTH, GOOD, BAD = range(3)
LINES = 1 << 11
DARKEST, BRIGHTEST = 2, 98  # percentiles of the intensity that the colours span
ROW = 20  # numbers of a point with reasons: see `reasons`
MOST_REASONS = 127  # that have a number in the words


@dataclass(frozen=True)
class Packed:
    """The points of a report as bytes.

    Attributes
    ----------
    points : (N, 4) uint32, frame by frame
    origin, step : (F, 3) float64, metres: the box of each frame
    reasons : (R, 20) float32, the points with reasons in the order of the points
    intensity : least and largest that the colours span

    """

    points: Words
    origin: NDArray[np.float64]
    step: NDArray[np.float64]
    reasons: NDArray[np.float32]
    intensity: tuple[float, float]


@dataclass(frozen=True)
class Fields:
    """What the words of N points say: each as a number that fits its bits.

    Attributes
    ----------
    position : (N, 3) uint64, steps of the box
    score, brightness, reason, detector, truth : (N,) uint32, of word 2
    bits, rank : (N,) uint32, of word 3

    """

    position: NDArray[np.uint64]
    score: Words
    brightness: Words
    reason: Words
    detector: Words
    truth: Words
    bits: Words
    rank: Words

    def words(self) -> Words:
        """Lay them out, (N, 4)."""
        x, y, z = self.position.astype(np.uint32).T
        words = np.empty((len(self.position), WORDS), np.uint32)
        words[:, 0] = x | (y << np.uint32(21))
        words[:, 1] = (y >> np.uint32(11)) | (z << np.uint32(10))
        words[:, 2] = self.score
        words[:, 2] |= self.brightness << np.uint32(10)
        words[:, 2] |= self.reason << np.uint32(17)
        words[:, 2] |= self.detector << np.uint32(24)
        words[:, 2] |= self.truth << np.uint32(28)
        words[:, 3] = self.bits | (self.rank << np.uint32(BITS))
        return words


@cache
def reason_names() -> list[str]:
    """List the names of the reasons, in the order of their numbers in the words."""
    return [one.name for one in reasons().values()][:MOST_REASONS]


def reason_texts() -> list[str]:
    """Say in words what they mean, in the same order."""
    return [one.text for one in reasons().values()][:MOST_REASONS]


@cache
def reason_numbers() -> Words:
    """Return the number in the words, from 1, of each number in ``outlier_reason``; 0: none."""
    found = np.zeros(256, np.uint32)
    found[list(reasons())[:MOST_REASONS]] = np.arange(1, len(reason_names()) + 1)
    return found


def pack(gathered: Gathered, frames: Frames) -> Packed:
    """Pack the kept points, in the order of their frames."""
    kept = gathered.kept.take(frames.order)
    number = np.repeat(np.arange(len(frames)), np.diff(frames.first))
    origin, step = _boxes(kept.xyz, frames)
    limits = span(kept.intensity)
    fields = Fields(
        position=np.rint((kept.xyz - origin[number]) / step[number]).astype(np.uint64),
        score=scores(kept.score),
        brightness=brightness(kept.intensity, limits),
        reason=reason_numbers()[kept.strongest],
        detector=numbers(kept.detectors),
        truth=_truth(gathered, kept.code),
        bits=kept.bits,
        rank=_ranks(kept.line, frames),
    )
    return Packed(fields.words(), origin, step, _reasons(gathered, frames), limits)


def _boxes(
    xyz: NDArray[np.float64], frames: Frames
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    if len(frames) == 0:
        return np.empty((0, 3)), np.empty((0, 3))
    origin = np.minimum.reduceat(xyz, frames.first[:-1])
    return origin, _step(np.maximum.reduceat(xyz, frames.first[:-1]) - origin)


def box(xyz: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Find the origin and the step of the box around some points, metres."""
    origin = xyz.min(axis=0)
    return origin, _step(xyz.max(axis=0) - origin)


def _step(size: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.maximum(size / STEPS, 1e-9)


def span(intensity: NDArray[np.float32]) -> tuple[float, float]:
    """Find the intensities between which colours change; both 0 where none is known."""
    known = intensity[np.isfinite(intensity)]
    if len(known) == 0:
        return 0.0, 0.0
    low, high = np.percentile(known, [DARKEST, BRIGHTEST]).tolist()
    return low, high


def brightness(intensity: NDArray[np.float32], limits: tuple[float, float]) -> Words:
    """Count the steps of each intensity between two limits."""
    low, high = limits
    if not np.isfinite(intensity).any():
        return np.zeros(len(intensity), np.uint32)
    scaled = np.clip((np.nan_to_num(intensity, nan=low) - low) / max(high - low, 1e-9), 0.0, 1.0)
    steps: Words = np.rint(scaled * INTENSITIES).astype(np.uint32)
    return steps


def numbers(detectors: NDArray[np.uint16]) -> Words:
    """Give the number of the first detector that rejects each point, 0 where none does."""
    first: Words = np.minimum(first_numbers(detectors), 15).astype(np.uint32)
    return first


def scores(score: NDArray[np.float32]) -> Words:
    """Count the steps of each score."""
    known = np.nan_to_num(score.astype(np.float64), nan=0.0, posinf=1e9)
    steps = np.minimum(np.rint(known * SCORE_UNIT), UNTESTED - 1).astype(np.uint32)
    return np.where(np.isnan(score), np.uint32(UNTESTED), steps)


def _truth(gathered: Gathered, code: NDArray[np.int32]) -> Words:
    if not gathered.tally.has_truth:
        return np.zeros(len(code), np.uint32)
    wide = code.astype(np.int64)
    truth = np.where(gathered.codes.bad(wide), BAD, GOOD)
    counted = gathered.codes.counted(wide) & (code >= 0)
    return np.where(counted, truth, NO_TRUTH).astype(np.uint32)


def _ranks(line: NDArray[np.int64], frames: Frames) -> Words:
    ranks = np.empty(len(line), np.uint32)
    for first, last in zip(frames.first[:-1], frames.first[1:], strict=True):
        ranks[first:last] = np.unique(line[first:last], return_inverse=True)[1] % LINES
    return ranks


def _reasons(gathered: Gathered, frames: Frames) -> NDArray[np.float32]:
    """Lay out the points with reasons, a row each.

    Score, seconds after the frame's start, scan line, intensity; then the numbers of the features,
    then what each adds to the log-odds.
    """
    kept = gathered.kept.take(frames.order)
    features, added = table(gathered.reasons)
    which = np.flatnonzero(kept.reason >= 0)
    rows = np.zeros((len(which), ROW), np.float32)
    start = np.repeat(frames.start, np.diff(frames.first))
    rows[:, 0] = kept.score[which]
    rows[:, 1] = (kept.t[which] - start[which]) * 1e-9
    rows[:, 2] = kept.line[which]
    rows[:, 3] = kept.intensity[which]
    rows[:, 4:12] = features[kept.reason[which]]
    rows[:, 12:] = added[kept.reason[which]]
    return rows
