# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How a detector explains its scores: what each feature adds, and the strongest as a number."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

    from lidar_outlier_filter.annotations import Bools, Singles
    from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
    from lidar_outlier_filter.parameters.filter import FilterParameters


class ReasonName(NamedTuple):
    """What a number in ``outlier_reason`` means: a name, and a few words for people."""

    name: str
    text: str


class Contributions(NamedTuple):
    """What features add to the scores of M points.

    Attributes
    ----------
    way : how they were judged, of ``Explanation.ways``
    names : of the F features
    added : (F, M) float32
        To log-odds; to the score itself where the way is one of ``Explanation.of_score``.
    average : (M,) float32
        To what it is added.

    """

    way: str
    names: tuple[str, ...]
    added: Singles
    average: Singles


@dataclass(frozen=True)
class Explanation:
    """What explains the scores of a detector.

    Attributes
    ----------
    reasons : what the numbers mean that it gives as ``Scores.reason``, from 1 to 255
        They are none of those of other detectors, and never change their meaning.
    ways : the ways in which it judges, for people; of each its features, with a few words
    of_score : those whose features add up to the score; those of others add up to log-odds
    choose : of what it sees, by which parameters: the way in which it will judge
    explain : of what it saw, by which parameters, and of which points

    """

    reasons: Mapping[int, ReasonName]
    ways: Mapping[str, Mapping[str, str]]
    of_score: Collection[str]
    choose: Callable[[DetectorInput, FilterParameters], str]
    explain: Callable[[DetectorInput, FilterParameters, Bools], Contributions]
