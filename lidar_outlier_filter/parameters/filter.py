# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""THE place of every parameter: name, type, default, unit, range and one sentence.

ROS declarations, ``config/defaults.yaml``, the table in the README and command-line help are made
from this file, and from those of the detectors and of the node, which are parts of it. A parameter
of a detector is named ``detector.parameter``.
"""

# ruff: noqa: RUF009  the defaults that are called for are frozen

from __future__ import annotations

from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.declaration import Parameter, declare, did_you_mean, walk
from lidar_outlier_filter.parameters.detectors import (
    AlphaBetaGamma,
    Elevation,
    Evidence,
    Hierarchical,
    Lof,
    Quadric,
    Sor,
    SpinningWeights,
    Weights,
)
from lidar_outlier_filter.parameters.node import HealthLimits, LoadParameters, MotionParameters

if TYPE_CHECKING:
    from collections.abc import Mapping


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
        'What makes a scan line: a field (ring), each row, each message, or each turn of the scan '
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
    motion: MotionParameters = MotionParameters()
    load: LoadParameters = LoadParameters()
    health: HealthLimits = HealthLimits()

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
                meant = did_you_mean([name], known)
                must_be = 'a known one' if meant else 'one of ' + ', '.join(sorted(known))
                raise ParameterError('a parameter', must_be, repr(name) + meant)
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
