# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of the detectors, each declared once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.declaration import Section, declare


@dataclass(frozen=True)
class AlphaBetaGamma(Section):
    """The moving fixed-interval α-β-γ smoother along each line segment."""

    before: int = declare(3, 'Points of the window in front of the tested one.', '', 0, 1000)
    after: int = declare(3, 'Points of the window behind the tested one.', '', 0, 1000)
    order: int = declare(
        1,
        'Motion along the line: 2 with acceleration (α-β-γ), 1 without (α-β).',
        '',
        1,
        2,
    )
    significance: float = declare(
        1e-6, 'Two-sided probability to reject a good point, for one test.', '', 1e-15, 0.5
    )
    sides: str = declare(
        'either',
        'both: the window around the point decides (the paper); either: a point that agrees with '
        'the window on one side is kept, so edges and corners stay.',
        choices=('both', 'either'),
    )
    test: str = declare(
        'each',
        'each: the worst coordinate; joint: all three at once; both: the stricter of the two.',
        choices=('each', 'joint', 'both'),
    )
    sigma: float = declare(
        0.0, 'Standard deviation of a coordinate; 0: estimated from each line.', 'm', 0.0, 100.0
    )
    sigma_field: str = declare(
        '',
        "Field with each point's own standard deviation, in the unit of the coordinates, from 1e-9 "
        'to 1e9 metres; empty: none.',
        fixed=True,
    )
    sigma_floor: float = declare(
        0.005, 'Least standard deviation that an estimate may give.', 'm', 1e-6, 100.0
    )
    sigma_part: int = declare(
        0,
        'Points of a part of a line whose standard deviation is estimated by itself, as noise may '
        'grow along a line; 0: one estimate for the line.',
        '',
        0,
        1_000_000,
    )
    min_window: int = declare(
        3, 'Fewest other points in a window; with fewer a point stays untested.', '', 3, 1000
    )
    passes: int = declare(
        30, 'Most repetitions without the rejected; the last rejects all that is left.', '', 1, 1000
    )
    engine: str = declare(
        'kernel',
        'kernel: compiled; filterpy: a Kalman filter with RTS smoother, slow but auditable.',
        choices=('kernel', 'filterpy'),
    )

    def check(self) -> None:
        """Refuse windows that are too short."""
        if self.min_window < self.order + 2:
            # With one point more than unknowns all of them fail alike: none is known to be wrong.
            must_be = f'at least order + 2 = {self.order + 2}'
            raise ParameterError('alpha_beta_gamma.min_window', must_be, self.min_window)
        got = f'{self.before} and {self.after}'
        if self.before + self.after < self.min_window:
            must_be = f'together at least min_window = {self.min_window}'
            raise ParameterError('alpha_beta_gamma.before and after', must_be, got)
        if self.sides == 'either' and max(self.before, self.after) < self.min_window:
            must_be = f'at most before or after, or there is no side to agree with ({got})'
            raise ParameterError('alpha_beta_gamma.min_window', must_be, self.min_window)


@dataclass(frozen=True)
class Quadric(Section):
    """Quadric surfaces through the neighbourhood."""

    window: str = declare(
        'section',
        'section: all points of a section of the cloud are tested against its surface; patch: each '
        'point against that of its own neighbours, slow.',
        choices=('section', 'patch'),
    )
    section: int = declare(
        64, 'Most points that a section judges; those around it support them.', '', 16, 10_000
    )
    k: int = declare(30, 'Neighbours in the patch around each point.', '', 10, 1000)
    significance: float = declare(
        1e-6, 'Two-sided probability to reject a good point, for one test.', '', 1e-15, 0.5
    )
    surfaces: int = declare(3, 'Most surfaces looked for in one window: 1 is the paper.', '', 1, 10)
    start: str = declare(
        'robust',
        'First surface: robust: of the half that agrees best; all: of all points (the paper).',
        choices=('robust', 'all'),
    )
    model: str = declare(
        'lowest',
        'lowest: a plane or a paraboloid where it will do; always: all ten parameters, of whatever '
        'the window holds (the paper; needs start: all and surfaces: 1).',
        choices=('lowest', 'always'),
    )
    min_points: int = declare(
        12, 'Fewest points that make a surface; with fewer a point stays untested.', '', 11, 1000
    )
    sigma_floor: float = declare(
        0.005, 'Least standard deviation that an estimate may give.', 'm', 1e-6, 100.0
    )

    def check(self) -> None:
        """Refuse a robust start of quadrics that nothing may lower."""
        if self.model == 'always' and (self.start, self.surfaces) != ('all', 1):
            got = f'start: {self.start} and surfaces: {self.surfaces}'
            raise ParameterError('quadric.model always', 'with start: all and surfaces: 1', got)


@dataclass(frozen=True)
class Lof(Section):
    """Local outlier factor: density against that of the neighbours."""

    min_pts: int = declare(20, 'Neighbours that make the density; ties count too.', '', 1, 1000)
    threshold: float = declare(
        1.2, 'Rejected above this factor; lof2: above this difference.', '', 1e-6, 1e9
    )
    statistic: str = declare(
        'lof',
        'lof: the factor; lof2: its absolute difference from the median of all.',
        choices=('lof', 'lof2'),
    )


@dataclass(frozen=True)
class Sor(Section):
    """Distance to the nearest neighbours."""

    k: int = declare(20, 'Neighbours whose mean distance counts, the point left out.', '', 1, 1000)
    statistic: str = declare(
        'sor',
        'sor: mean distance against mean + multiplier × standard deviation of all; sor2: its '
        'absolute difference from the median against limit; radius: min_neighbors within radius.',
        choices=('sor', 'sor2', 'radius'),
    )
    multiplier: float = declare(2.0, 'Standard deviations above the mean of all.', '', 0.0, 1000.0)
    limit: float = declare(
        0.1, 'Largest absolute difference from the median (sor2).', 'm', 1e-6, 1e6
    )
    radius: float = declare(
        0.5, 'Radius in which min_neighbors others must be (radius).', 'm', 1e-6, 1e6
    )
    min_neighbors: int = declare(3, 'Fewest others within the radius (radius).', '', 1, 1000)
    range_scaled: bool = declare(
        default=False,
        text='Let the limit grow with the distance from the origin: sor, sor2: the limit × '
        'range_factor × range (DSOR); radius: at least range_factor × range (DROR).',
    )
    range_factor: float = declare(0.05, 'Growth of the limit with the range.', '1/m', 1e-9, 1e3)


@dataclass(frozen=True)
class Hierarchical(Section):
    """Clusters that a graph falls into when its long edges are cut."""

    global_confidence: float = declare(
        0.99,
        'Phase 1: edges of the spanning tree that are longer than this two-sided interval around '
        'the median allows are cut.',
        '',
        0.0,
        1.0 - 1e-9,
    )
    local_confidence: float = declare(
        0.95,
        'Phase 2: the same for the Gabriel graph of each cluster of phase 1.',
        '',
        0.0,
        1.0 - 1e-9,
    )
    min_cluster: int = declare(
        100,
        'Fewest points of a cluster that is kept; fewer points altogether stay untested.',
        '',
        1,
        1_000_000_000,
    )


@dataclass(frozen=True)
class Elevation(Section):
    """Elevation against the mean of the neighbours on the map."""

    k: int = declare(30, 'Neighbours whose mean elevation counts; ties count too.', '', 1, 1000)
    neighbours: str = declare(
        'map',
        'map: the nearest in x and y (the paper); space: the nearest in x, y and z.',
        choices=('map', 'space'),
    )
    multiplier: float = declare(
        3.0, 'Standard deviations of all differences that one may differ.', '', 1e-6, 1000.0
    )
    sides: str = declare(
        'both',
        'Points that are rejected: low or high ones, or both; low is the formula of the paper.',
        choices=('both', 'low', 'high'),
    )
    gap: float = declare(
        5.0,
        'Empty stretch of elevations that sets points above or below apart; 0: none does.',
        'm',
        0.0,
        1e6,
    )
    share: float = declare(
        0.001, 'Most of the points that are taken off as set apart, on each side.', '', 0.0, 0.4
    )
    sigma_floor: float = declare(
        0.005, 'Least standard deviation that an estimate may give.', 'm', 1e-6, 100.0
    )


@dataclass(frozen=True)
class Evidence(Section):
    """Features, weighed."""

    sensor: str = declare(
        'auto',
        'Whose weights count, evidence_profile or evidence_spinning; auto: spinning where lines '
        'are measured at the same time; survey: none, the cloud is judged without scan lines.',
        choices=('auto', 'profile', 'spinning', 'survey'),
    )
    threshold: float = declare(
        1.0, "Rejected above this many times the sensor's own threshold.", '', 1e-6, 1e6
    )


@dataclass(frozen=True)
class DetectorSections:
    """THE table of the detectors' parameters: each section has the name of its detector."""

    alpha_beta_gamma: AlphaBetaGamma = AlphaBetaGamma()
    quadric: Quadric = Quadric()
    lof: Lof = Lof()
    sor: Sor = Sor()
    hierarchical: Hierarchical = Hierarchical()
    elevation: Elevation = Elevation()
    evidence: Evidence = Evidence()


# What each feature compares, in the order in which the tables show them.
_FEATURES = {
    'spacing': 'Distance to 3 neighbours against what the sensor leads to.',
    'step': 'Distance along the line against the usual.',
    'lonely': 'Distance to 5 neighbours against the usual.',
    'amid': 'Density at the neighbours against that around: not at an edge.',
    'along': 'Difference from the line against the median.',
    'surface': 'Standard deviations from an even surface all around.',
    'alone': 'Few neighbours of other lines.',
    'company': 'From the second pass on: more than a third of the neighbours rejected.',
}


def _weight(name: str, default: float) -> Any:
    return declare(default, _FEATURES[name], '', 0.0, 1000.0)


def _statistic(default: float) -> Any:
    return declare(default, 'Rejected above this weighted sum.', '', 1e-6, 1e6)


def _passes(default: int) -> Any:
    text = 'How often the features are computed, each time without the rejected.'
    return declare(default, text, '', 1, 10)


def _slanted(*, default: bool) -> Any:
    text = 'Reject straight, slanted groups that touch nothing, too: arms of barriers.'
    return declare(default=default, text=text)


@dataclass(frozen=True)
class Weights:
    """Weight of each feature, for a profile scanner."""

    threshold: float = _statistic(18.0)
    passes: int = _passes(6)
    spacing: float = _weight('spacing', 2.8)
    step: float = _weight('step', 1.8)
    lonely: float = _weight('lonely', 2.6)
    amid: float = _weight('amid', 4.8)
    along: float = _weight('along', 3.4)
    surface: float = _weight('surface', 1.6)
    alone: float = _weight('alone', 1.5)
    company: float = _weight('company', 9.0)
    slanted: bool = _slanted(default=True)


@dataclass(frozen=True)
class SpinningWeights(Weights):
    """The same for a spinning sensor."""

    threshold: float = _statistic(10.3)
    passes: int = _passes(2)
    spacing: float = _weight('spacing', 2.5)
    step: float = _weight('step', 1.5)
    lonely: float = _weight('lonely', 1.0)
    amid: float = _weight('amid', 1.3)
    along: float = _weight('along', 0.3)
    surface: float = _weight('surface', 0.3)
    alone: float = _weight('alone', 0.0)
    company: float = _weight('company', 3.0)
    slanted: bool = _slanted(default=False)
