# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""THE place of every parameter: name, type, default, unit, range and one sentence.

ROS declarations, ``config/defaults.yaml``, the table in the README and command-line help are made
from this file. A parameter of a detector is named ``detector.parameter``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.node_parameters import Health, Load, Motion
from lidar_outlier_filter.parameter import Parameter, declare, walk

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True)
class AlphaBetaGamma:
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
        '', "Field with each point's own standard deviation in metres; empty: none.", fixed=True
    )
    sigma_floor: float = declare(
        0.005, 'Least standard deviation that an estimate may give.', 'm', 1e-6, 100.0
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


@dataclass(frozen=True)
class Quadric:
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
    min_points: int = declare(
        12, 'Fewest points that make a surface; with fewer a point stays untested.', '', 11, 1000
    )
    sigma_floor: float = declare(
        0.005, 'Least standard deviation that an estimate may give.', 'm', 1e-6, 100.0
    )


@dataclass(frozen=True)
class Lof:
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
class Sor:
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
class Hierarchical:
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
class Elevation:
    """Elevation against the mean of the neighbours on the map."""

    k: int = declare(
        30, 'Neighbours in x and y whose mean elevation counts; ties count too.', '', 1, 1000
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
class Evidence:
    """Witnesses, weighed."""

    sensor: str = declare(
        'auto',
        'Whose weights count, evidence_profile or evidence_spinning; auto: spinning where lines '
        'are measured at the same time.',
        choices=('auto', 'profile', 'spinning'),
    )
    threshold: float = declare(
        1.0, "Rejected above this many times the sensor's own threshold.", '', 1e-6, 1e6
    )


def _weight(default: float, text: str) -> Any:
    return declare(default, text, '', 0.0, 1000.0)


@dataclass(frozen=True)
class Weights:
    """What the word of each witness weighs, for a profile scanner."""

    threshold: float = declare(17.0, 'Rejected above this weighted sum.', '', 1e-6, 1e6)
    passes: int = declare(
        2, 'How often the witnesses are heard, each time without the rejected.', '', 1, 10
    )
    spacing: float = _weight(2.8, 'Distance to 3 neighbours against what the sensor leads to.')
    step: float = _weight(1.8, 'Distance along the line against the usual.')
    lonely: float = _weight(2.6, 'Distance to 5 neighbours against the usual.')
    amid: float = _weight(4.8, 'Density at the neighbours against that around: not at an edge.')
    along: float = _weight(3.4, 'Difference from the line against the median.')
    surface: float = _weight(1.6, 'Standard deviations from an even surface all around.')
    alone: float = _weight(1.5, 'Few neighbours of other lines.')
    slanted: bool = declare(
        default=True,
        text='Reject straight, slanted groups that touch nothing, too: arms of barriers.',
    )


@dataclass(frozen=True)
class SpinningWeights(Weights):
    """The same for a spinning sensor."""

    threshold: float = declare(10.3, 'Rejected above this weighted sum.', '', 1e-6, 1e6)
    passes: int = declare(
        1, 'How often the witnesses are heard, each time without the rejected.', '', 1, 10
    )
    spacing: float = _weight(2.5, 'Distance to 3 neighbours against a part of the range.')
    step: float = _weight(1.5, 'Distance along the line against the usual.')
    lonely: float = _weight(1.0, 'Distance to 5 neighbours against the usual.')
    amid: float = _weight(1.3, 'Density at the neighbours against that around: not at an edge.')
    along: float = _weight(0.3, 'Difference from the line against the median.')
    surface: float = _weight(0.3, 'Standard deviations from an even surface all around.')
    alone: float = _weight(0.0, 'Few neighbours of other lines.')
    slanted: bool = declare(
        default=False,
        text='Reject straight, slanted groups that touch nothing, too: arms of barriers.',
    )


@dataclass(frozen=True)
class FilterParameters:
    """All parameters of the filter; make a changed copy with :meth:`changed`."""

    inputs: tuple[str, ...] = declare(
        ('points',),
        'Topics of the sensors; the answers to each go to its /cleaned and /outliers.',
        fixed=True,
    )
    chain: tuple[str, ...] = declare(
        ('evidence',),
        'Detectors, in their order.',
        choices=(
            'alpha_beta_gamma',
            'quadric',
            'lof',
            'sor',
            'hierarchical',
            'elevation',
            'evidence',
        ),
    )
    vote: int = declare(
        0,
        'Detectors that must agree, each of which sees all points; 0: one is enough, and each sees '
        'what the earlier ones left.',
        '',
        0,
        16,
    )
    threads: int = declare(
        0, 'Threads for the spatial detectors; 0: as many as there are cores.', '', 0, 256
    )
    time_field: str = declare(
        'auto', 'Field with the time of each point; auto: by its name.', fixed=True
    )
    time_unit: str = declare(
        'auto',
        'Unit of the time field; auto: by its type and size.',
        choices=('auto', 's', 'us', 'ns'),
        fixed=True,
    )
    time_reference: str = declare(
        'auto',
        'Whether the time field counts from the header stamp or is absolute; auto: by its size.',
        choices=('auto', 'stamp', 'absolute'),
        fixed=True,
    )
    points_per_second: float = declare(
        1e7,
        'Stands in for a missing time field: point i is i / points_per_second after the stamp. Too '
        'high does no harm, too low lets clouds overlap; 0: clouds without time are refused.',
        '1/s',
        0.0,
        1e9,
        fixed=True,
    )
    time_jump: float = declare(
        1.0,
        'A clock that goes back by more resets the stream; one that goes back by less is refused.',
        's',
        0.0,
        1e9,
        fixed=True,
    )
    line_source: str = declare(
        'auto',
        'What makes a scan line: a field (ring), each row, each message, or a wrap of the scan '
        'angle; auto: field, else row, else message.',
        choices=('auto', 'field', 'row', 'message', 'angle'),
        fixed=True,
    )
    line_field: str = declare(
        'auto', 'Field with the number of the line; auto: by its name.', fixed=True
    )
    angle_field: str = declare(
        '', 'Field with the scan angle; empty: the angle of the point in angle_plane.', fixed=True
    )
    angle_unit: str = declare('rad', 'Unit of the angle field.', choices=('rad', 'deg'), fixed=True)
    angle_plane: str = declare(
        'yz',
        "Plane in which a profile scanner's mirror turns, in the frame of the cloud.",
        choices=('xy', 'yz', 'zx'),
        fixed=True,
    )
    gap_factor: float = declare(
        1.5,
        "A segment ends where the next shot is later than this many of the line's intervals.",
        '',
        1.0,
        1e6,
    )
    blocks: str = declare(
        'time',
        'What is judged together: stretches of sensor time; or each message, with the halo before '
        'it only, which is answered at once (one sweep per message).',
        choices=('time', 'message'),
        fixed=True,
    )
    block: float = declare(
        0.1,
        'Length of the stretches of sensor time that are judged together.',
        's',
        1e-3,
        60.0,
        fixed=True,
    )
    halo: float = declare(
        0.01, 'Stretch before and after a block that is seen with it.', 's', 0.0, 60.0, fixed=True
    )
    lateness: float = declare(
        0.0,
        'How much older than the newest point a point may be that still arrives.',
        's',
        0.0,
        60.0,
        fixed=True,
    )
    max_delay: float = declare(
        1.0, 'Longest time a live cloud waits; under use_sim_time by /clock.', 's', 1e-3, 600.0
    )
    max_points: int = declare(
        50_000_000,
        'Most points held at once; a cloud beyond is refused.',
        '',
        1,
        2_000_000_000,
        fixed=True,
    )
    keep_organized: bool = declare(
        default=False,
        text='Keep the shape of organised clouds: rejected points become NaN in the cleaned cloud.',
    )
    scores: bool = declare(
        default=False,
        text='Add outlier_score (float32) and outlier_detectors (uint16) to both clouds.',
    )
    save_to: str = declare(
        '',
        'File that ~/save_parameters writes; empty: one named after the node, in ROS_HOME.',
    )
    alpha_beta_gamma: AlphaBetaGamma = AlphaBetaGamma()
    quadric: Quadric = Quadric()
    lof: Lof = Lof()
    sor: Sor = Sor()
    hierarchical: Hierarchical = Hierarchical()
    elevation: Elevation = Elevation()
    evidence: Evidence = Evidence()
    evidence_profile: Weights = Weights()
    evidence_spinning: SpinningWeights = SpinningWeights()
    motion: Motion = Motion()  # noqa: RUF009  frozen
    load: Load = Load()  # noqa: RUF009  frozen
    health: Health = Health()  # noqa: RUF009  frozen

    def __post_init__(self) -> None:
        """Refuse what cannot be: each parameter by itself, then together."""
        for parameter in describe():
            parameter.check(_value(self, parameter.name))
        _check_together(self)
        self.health.check()
        self.motion.check(len(self.inputs))

    def changed(self, values: Mapping[str, object]) -> FilterParameters:
        """Return a validated copy with the flat, dotted names in ``values`` set; all or nothing."""
        known = {parameter.name: parameter for parameter in describe()}
        top: dict[str, Any] = {}
        sections: dict[str, dict[str, Any]] = {}
        for name, value in values.items():
            if name not in known:
                raise ParameterError(
                    'a parameter', 'one of ' + ', '.join(sorted(known)), repr(name)
                )
            section, _, leaf = name.rpartition('.')
            (sections.setdefault(section, {}) if section else top)[leaf] = known[name].check(value)
        for section, leaves in sections.items():
            top[section] = replace(getattr(self, section), **leaves)
        return replace(self, **top)

    def flat(self) -> dict[str, Any]:
        """All values by their flat, dotted names, in the order of declaration."""
        return {parameter.name: _value(self, parameter.name) for parameter in describe()}


# The smoother as in Leslar, Wang and Hu (2010): each point is tested once, in a window around it.
PAPER: Mapping[str, object] = MappingProxyType(
    {
        'chain': ['alpha_beta_gamma'],
        'alpha_beta_gamma.sides': 'both',
        'alpha_beta_gamma.order': 2,
        'alpha_beta_gamma.before': 5,
        'alpha_beta_gamma.after': 5,
        'alpha_beta_gamma.min_window': 4,
        'alpha_beta_gamma.significance': 0.001,
        'alpha_beta_gamma.passes': 1,
    }
)


def _value(parameters: object, name: str) -> Any:
    for part in name.split('.'):
        parameters = getattr(parameters, part)
    return parameters


def _check_together(parameters: FilterParameters) -> None:
    """Refuse settings that make sense alone but not with each other."""
    detector = parameters.alpha_beta_gamma
    if detector.min_window < detector.order + 2:
        # With one point more than unknowns all of them fail alike: none can be told to be wrong.
        must_be = f'at least order + 2 = {detector.order + 2}'
        raise ParameterError('alpha_beta_gamma.min_window', must_be, detector.min_window)
    got = f'{detector.before} and {detector.after}'
    if detector.before + detector.after < detector.min_window:
        must_be = f'together at least min_window = {detector.min_window}'
        raise ParameterError('alpha_beta_gamma.before and after', must_be, got)
    if detector.sides == 'either' and max(detector.before, detector.after) < detector.min_window:
        must_be = f'before or after, or there is no side to agree with ({got})'
        raise ParameterError(
            'alpha_beta_gamma.min_window', f'at most {must_be}', detector.min_window
        )
    if 0 < parameters.points_per_second < 1:
        raise ParameterError('points_per_second', '0 or at least 1', parameters.points_per_second)
    if parameters.time_jump < parameters.lateness:
        # A cloud that is late, as it may be, would reset the stream.
        must_be = f'at least lateness = {parameters.lateness:g} s'
        raise ParameterError('time_jump', must_be, f'{parameters.time_jump:g} s')
    if parameters.vote > len(parameters.chain):
        must_be = f'at most the {len(parameters.chain)} of the chain'
        raise ParameterError('vote', must_be, parameters.vote)
    wait = parameters.block + parameters.halo + parameters.lateness
    if parameters.max_delay < wait and parameters.blocks == 'time':
        must_be = f'at least block + halo + lateness = {wait:g} s'
        raise ParameterError('max_delay', must_be, f'{parameters.max_delay:g} s')


def describe() -> tuple[Parameter, ...]:
    """List every parameter, in the order of declaration."""
    return tuple(walk(FilterParameters, ''))
