# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The chain: detectors in their order, each on what the earlier ones left, or all on everything."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core import scan_lines as scanlines
from lidar_outlier_filter.core import threads as pool
from lidar_outlier_filter.core.detectors import elevation, lof, sor
from lidar_outlier_filter.core.detectors.alpha_beta_gamma import detector as alpha_beta_gamma
from lidar_outlier_filter.core.detectors.evidence import detector as evidence
from lidar_outlier_filter.core.detectors.hierarchical import detector as hierarchical
from lidar_outlier_filter.core.detectors.quadric import detector as quadric
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.core.points import Points
from lidar_outlier_filter.core.verdict import BITS, SECOND_PHASE, Verdict

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from lidar_outlier_filter.parameters.filter import FilterParameters

    Detect = Callable[['_Seen', FilterParameters], '_Told']


SECOND = 2  # phase of the hierarchical detector
POINTS_AT_ONCE = 1 << 15  # that a thread takes at once, or a line: some milliseconds
TEMPORAL = ('alpha_beta_gamma',)  # detectors that look along the line only: fast
ALONG_LINES = (*TEMPORAL, 'evidence')  # detectors that need scan lines


def along_lines(chain: Sequence[str]) -> str:
    """List those detectors of a chain that need scan lines, for people; empty: none does."""
    return ', '.join(name for name in chain if name in ALONG_LINES)


class _Seen:
    """The points that a detector sees, and their one neighbourhood, made when first asked for."""

    def __init__(
        self,
        where: NDArray[np.intp],
        points: Points,
        parameters: FilterParameters,
        neighbourhood: Neighbourhood | None = None,
    ) -> None:
        self.where = where  # their places among all
        self.points = points
        self._parameters = parameters
        self._neighbourhood = neighbourhood

    @property
    def neighbourhood(self) -> Neighbourhood:
        if self._neighbourhood is None:
            most = _most_neighbours(self._parameters)
            self._neighbourhood = Neighbourhood(self.points.xyz, most, self._parameters.threads)
        return self._neighbourhood

    def without(self, rejected: NDArray[np.bool_]) -> _Seen:
        if not rejected.any():
            return self
        left = np.flatnonzero(~rejected)
        near = self._neighbourhood
        near = None if near is None else near.without(rejected)
        return _Seen(self.where[left], self.points.take(left), self._parameters, near)


class _Told(NamedTuple):
    """The scores of a detector, and which of them its second phase rejected, if it has one."""

    score: NDArray[np.float64]
    second: NDArray[np.bool_] | None = None


class Chain:
    """The detectors of one set of parameters."""

    def __init__(self, parameters: FilterParameters) -> None:
        """Choose the detectors that ``parameters.chain`` names."""
        self.parameters = parameters
        self.passes = 0  # the most that the smoother has needed
        self._detectors: dict[str, Detect] = {
            'alpha_beta_gamma': self._alpha_beta_gamma,
            'quadric': _quadric,
            'lof': _lof,
            'sor': _sor,
            'hierarchical': _hierarchical,
            'elevation': _elevation,
            'evidence': _evidence,
        }

    def judge(self, points: Points) -> Verdict:
        """Judge valid points that lie together in time; the verdict is in their order."""
        parameters = self.parameters
        verdict = Verdict.untested(len(points))
        seen = _Seen(np.arange(len(points)), points, parameters)
        for number, name in enumerate(parameters.chain, 1):
            told = self._detectors[name](seen, parameters)
            verdict.add(BITS[name], seen.where, told.score)
            if told.second is not None:
                verdict.detectors[seen.where[told.second]] |= SECOND_PHASE
            # Behind the last one nobody looks at what is left.
            if parameters.vote == 0 and number < len(parameters.chain):
                seen = seen.without(told.score > 1)
        verdict.settle(max(parameters.vote, 1))
        return verdict

    def compile(self) -> None:
        """Run every detector once on a few points, so that its kernels are ready."""
        count = 128  # enough for each detector of the defaults to judge them
        xyz = np.zeros((count, 3))
        xyz[:, 0] = np.arange(count)
        xyz[count // 2, 2] = 10.0
        t = np.arange(count) * 1000
        line, valid = np.zeros(count, np.int64), np.ones(count, np.bool_)
        for order in (np.arange(count), np.arange(count)[::-1]):
            self.judge(Points(xyz, t, line, valid).take(order))
        self.passes = 0

    def _alpha_beta_gamma(self, seen: _Seen, parameters: FilterParameters) -> _Told:
        """Run the smoother along the lines, and give the answer in the points' own order."""
        points = seen.points
        order = scanlines.order_by_line(points)
        # A profile scanner's points come in this order: a copy less.
        unchanged = scanlines.is_unchanged(order)
        ordered = points if unchanged else points.take(order)
        first = scanlines.line_starts(ordered.line)
        told = np.empty(len(points))

        def judge(begin: int, end: int) -> int:
            part = slice(first[begin], first[end])
            mine = ordered.take(part)
            lines = scanlines.find_lines(mine, parameters.gap_factor)
            outcome = alpha_beta_gamma.detect(mine, lines, parameters.alpha_beta_gamma)
            told[part if unchanged else order[part]] = outcome.score
            return outcome.passes

        # Lines know nothing of each other.
        count = len(first) - 1
        chunk = max(1, -(-count * POINTS_AT_ONCE // max(len(points), 1)))
        self.passes = max(self.passes, *pool.run(judge, count, chunk, parameters.threads), 0)
        return _Told(told)


def _quadric(seen: _Seen, parameters: FilterParameters) -> _Told:
    sigma = seen.points.sigma
    variance = None if sigma is None else sigma**2
    return _Told(quadric.detect(seen.neighbourhood, parameters.quadric, variance))


def _lof(seen: _Seen, parameters: FilterParameters) -> _Told:
    return _Told(lof.detect(seen.neighbourhood, parameters.lof))


def _sor(seen: _Seen, parameters: FilterParameters) -> _Told:
    return _Told(sor.detect(seen.neighbourhood, parameters.sor, seen.points.range))


def _hierarchical(seen: _Seen, parameters: FilterParameters) -> _Told:
    outcome = hierarchical.detect(seen.points.xyz, parameters.hierarchical, parameters.threads)
    return _Told(outcome.score, outcome.phase == SECOND)


def _elevation(seen: _Seen, parameters: FilterParameters) -> _Told:
    return _Told(elevation.detect(seen.points.xyz, parameters.elevation, parameters.threads))


def _evidence(seen: _Seen, parameters: FilterParameters) -> _Told:
    return _Told(evidence.detect(seen.neighbourhood, seen.points, parameters))


def _most_neighbours(parameters: FilterParameters) -> int:
    """Return the longest list of neighbours that a detector of the chain will ask for."""
    lengths = {
        'quadric': quadric.neighbours(parameters.quadric),
        'lof': lof.neighbours(parameters.lof),
        'sor': sor.neighbours(parameters.sor),
        'evidence': evidence.neighbours(),
    }
    return max(lengths.get(name, 1) for name in parameters.chain)
