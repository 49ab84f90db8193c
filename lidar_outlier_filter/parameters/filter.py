# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters without a section; all parameters together, how they are checked and changed.

ROS declarations, ``config/defaults.yaml``, the tables of the pages and what ``--set`` takes are
made from this file, from :mod:`.node`, and from what the installed detectors declare (ours in
``core/detectors/builtin.py``). Their parameters are named ``detector.parameter``.
"""

# ruff: noqa: RUF009  the defaults made by calls are frozen

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cache
from typing import Any, TypeVar

from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.declaration import (
    OFF,
    Installed,
    Parameter,
    Section,
    declare,
    did_you_mean,
    shown,
    walk,
)
from lidar_outlier_filter.parameters.node import HealthLimits, LoadParameters, MotionParameters

WITHOUT_EFFECT = ('threads', 'save_to')  # parameters that do not change outputs

OneSection = TypeVar('OneSection', bound=Section)


def _default_chain() -> tuple[str, ...]:
    return installed().default


@dataclass(frozen=True)
class FilterParameters:
    """All parameters of the filter; make a changed copy with :meth:`changed`.

    Attributes
    ----------
    of_detectors : tuple of sections
        Detector sections that differ from the defaults; read them with :meth:`of`.

    """

    inputs: tuple[str, ...] = declare(
        ('points',),
        'Topics of the sensors; each is split into its /cleaned and /outliers.',
        fixed=True,
    )
    input_type: str = declare(
        'PointCloud2',
        'Type of their messages (sensor_msgs), which the outputs have, too; recordings say it '
        'themselves.',
        choices=('PointCloud2', 'LaserScan', 'MultiEchoLaserScan'),
        fixed=True,
    )
    chain: tuple[str, ...] = declare(
        _default_chain,
        'Detectors, in their order.',  # the choices: every detector that is installed
    )
    vote: int = declare(
        0,
        'Number of detectors that must agree, each testing all points; 0: one is enough, and each '
        'tests the points that the earlier ones kept.',
        '',
        0,
        16,
    )
    threads: int = declare(0, 'Threads for the spatial detectors; 0: all cores.', '', 0, 256)
    time_field: str = declare(
        'auto', 'Field with the time of each point; auto: by its name.', fixed=True
    )
    time_unit: str = declare(
        'auto',
        'Unit of the time field; auto: by its type and size, and the interval from point to point.',
        choices=('auto', 's', 'ms', 'us', 'ns'),
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
        'Replaces a missing time field: point i is i / points_per_second after the stamp. Too high '
        'is harmless, too low makes clouds overlap; 0: clouds without time are refused.',
        '1/s',
        0.0,
        1e9,
        fixed=True,
    )
    time_jump: float = declare(
        1.0,
        'A larger step back in sensor time, or any in /clock, resets the stream; a smaller one '
        'refuses clouds.',
        's',
        0.0,
        1e9,
        fixed=True,
    )
    line_source: str = declare(
        'auto',
        'What makes a scan line: a field (ring), each row, each message, or each turn of the scan '
        'angle. auto: the field or rows that behave like lines, else the turns of the mirror, from '
        'time and geometry; without any, messages.',
        choices=('auto', 'field', 'row', 'message', 'angle'),
        fixed=True,
    )
    line_rate: float = declare(
        0.0,
        "Turns per second of a profile scanner's mirror; 0: from time and geometry.",
        '1/s',
        0.0,
        10_000.0,
        fixed=True,
    )
    line_field: str = declare(
        'auto', 'Field with the number of the line; auto: by its name.', fixed=True
    )
    sigma_field: str = declare(
        '',
        'Field with the standard deviation of each point, in the unit of the coordinates, from '
        '1e-9 to 1e9 metres; empty: none.',
        fixed=True,
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
        'Points judged together. time: stretches of sensor time. message: each message, with the '
        'halo before it only; each is published at once. auto: message if one of the first three '
        'messages spans at least a quarter of block, as one sweep does; otherwise time.',
        choices=('time', 'message', 'auto'),
        fixed=True,
    )
    block: float = declare(
        0.1,
        'Length of a block: an interval of sensor time whose points are judged together.',
        's',
        1e-3,
        60.0,
        fixed=True,
    )
    halo: float = declare(
        0.01,
        'Time before and after a block that is used with it.',
        's',
        0.0,
        60.0,
        fixed=True,
    )
    lateness: float = declare(
        0.0,
        'Maximum time by which a point may arrive later than newer ones.',
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
        'Maximum buffered points; further clouds are refused.',
        '',
        1,
        2_000_000_000,
        fixed=True,
    )
    keep_organized: bool = declare(
        default=False,
        text='Keep the shape of organised clouds: rejected points become NaN in the cleaned cloud.',
    )
    missing: str = declare(
        'keep',
        'Missing returns (NaN, Inf, 0 0 0): keep, in the cleaned cloud; drop: they are in neither '
        'cloud, and counted. keep_organized keeps them in organised clouds.',
        choices=('keep', 'drop'),
    )
    mask: str = declare(
        OFF,
        'File with the mask of the own vehicle, from the command mask: its points are outliers '
        "that detectors do not use; 'off': no mask.",
        fixed=True,
    )
    mask_tolerance: float = declare(0.1, 'Tolerance of the ranges in the mask.', 'm', 0.0, 10.0)
    mask_shadow: bool = declare(
        default=False,
        text='Mask points behind the own vehicle, too, which its sensor cannot see.',
    )
    scores: bool = declare(
        default=False,
        text='Add outlier_score (float32), outlier_detectors (uint16), '
        'outlier_detector_number (uint8, for viewers) and outlier_reason (uint8) to both clouds.',
    )
    save_to: str = declare(
        '', 'File that ~/save_parameters writes; empty: one named after the node, in ROS_HOME.'
    )
    motion: MotionParameters = MotionParameters()
    load: LoadParameters = LoadParameters()
    health: HealthLimits = HealthLimits()
    of_detectors: tuple[Section, ...] = field(default_factory=tuple)

    def __post_init__(self) -> None:
        """Refuse what cannot be: each parameter by itself, then together."""
        for parameter in describe():
            parameter.check(self.value(parameter.name))
        for section in self.of_detectors:
            section.check()
        _check_together(self)
        self.motion.check(len(self.inputs))

    def changed(self, values: Mapping[str, object]) -> FilterParameters:
        """Return a validated copy with the flat, dotted names in ``values`` set; all or nothing.

        Raises
        ------
        ParameterError
            If a name is unknown, or a value makes no sense.

        Examples
        --------
        >>> from lidar_outlier_filter.parameters.filter import FilterParameters
        >>> faster = FilterParameters().changed({'chain': ['lof'], 'max_delay': 0.5})
        >>> faster.chain, faster.max_delay
        (('lof',), 0.5)

        """
        for name in _named(values):
            if name in installed().refused:
                raise installed().refused[name]
        known = {parameter.name: parameter for parameter in describe()}
        top: dict[str, Any] = {}
        sections: dict[str, dict[str, Any]] = {}
        for name, value in values.items():
            if name not in known:
                meant = did_you_mean([name], known)
                must_be = 'a known one' if meant else 'one of ' + ', '.join(sorted(known))
                raise ParameterError('a parameter', must_be, shown(name) + meant)
            section, _, leaf = name.rpartition('.')
            (sections.setdefault(section, {}) if section else top)[leaf] = known[name].check(value)
        own = {}
        for name, one in _sections().items():
            mine: Any = self.of(one)  # a frozen dataclass, as all sections are
            changed = replace(mine, **sections.pop(name, {}))
            if changed != one():
                own[name] = changed
        for name, leaves in sections.items():
            top[name] = replace(getattr(self, name), **leaves)
        return replace(self, **top, of_detectors=tuple(own.values()))

    def of(self, section: type[OneSection]) -> OneSection:
        """Return the parameters of a detector, by their class.

        Raises
        ------
        ParameterError
            If no detector that is installed declares them.

        """
        for one in self.of_detectors:
            if type(one) is section:
                return one
        if section not in _sections().values():
            raise ParameterError('a section of parameters', 'of a detector', section.__name__)
        return section()

    def value(self, name: str) -> Any:
        """Return one value by its flat, dotted name."""
        section, _, leaf = name.rpartition('.')
        if not section:
            return getattr(self, leaf)
        own = _sections().get(section)
        return getattr(self.of(own) if own else getattr(self, section), leaf)

    def flat(self) -> dict[str, Any]:
        """All values by their flat, dotted names, in the order of declaration.

        Examples
        --------
        >>> from lidar_outlier_filter.parameters.filter import FilterParameters
        >>> FilterParameters().flat()['chain']
        ('boosted_trees',)

        """
        return {parameter.name: self.value(parameter.name) for parameter in describe()}


def _named(values: Mapping[str, object]) -> set[str]:
    """Return what may be detectors' names: in those of parameters, and in the chain."""
    chain = values.get('chain')
    names = [*values, *(chain if isinstance(chain, list | tuple) else ())]
    return {name.partition('.')[0] for name in names if isinstance(name, str)}


def _check_together(parameters: FilterParameters) -> None:
    """Refuse settings that make sense alone but not with each other."""
    if 0 < parameters.points_per_second < 1:
        raise ParameterError('points_per_second', '0 or at least 1', parameters.points_per_second)
    if parameters.time_jump < parameters.lateness:
        # A cloud that is late, as it may be, would reset the stream.
        must_be = f'at least lateness = {parameters.lateness:g} s'
        raise ParameterError('time_jump', must_be, f'{parameters.time_jump:g} s')
    if not parameters.mask:
        raise ParameterError('mask', "a file, or 'off'", repr(parameters.mask))
    if parameters.mask != OFF and len(parameters.inputs) > 1:
        must_be = f"'{OFF}' with several inputs, each of which sees the vehicle from elsewhere"
        raise ParameterError('mask', must_be, repr(parameters.mask))
    if parameters.mask_shadow and parameters.mask == OFF:
        raise ParameterError('mask_shadow', 'false without a mask', 'true')
    if parameters.vote > len(parameters.chain):
        must_be = f'at most the {len(parameters.chain)} of the chain'
        raise ParameterError('vote', must_be, parameters.vote)
    names = {installed().detectors[name].field(parameters) for name in parameters.chain} - {''}
    if len(names) > 1:
        raise ParameterError('chain', 'of detectors that read one field', ', '.join(sorted(names)))
    wait = parameters.block + parameters.halo + parameters.lateness
    if parameters.max_delay < wait and parameters.blocks != 'message':
        must_be = f'at least block + halo + lateness = {wait:g} s'
        raise ParameterError('max_delay', must_be, f'{parameters.max_delay:g} s')


_finders: list[Callable[[Collection[str]], Installed]] = []


def register(find: Callable[[Collection[str]], Installed]) -> None:
    """Set the function that finds all detectors; its argument: forbidden names of sections.

    The package calls it, because the detectors' subpackage imports this one.
    """
    _finders[:] = [find]


@cache
def installed() -> Installed:
    """Find the detectors that are installed, once in a process."""
    return _finders[0]([item.name for item in fields(FilterParameters)])


@cache
def _sections() -> dict[str, type[Section]]:
    """Return the parameters of all detectors, by the first part of their names."""
    return {name: one.section for name, one in installed().detectors.items()}


@cache
def describe() -> tuple[Parameter, ...]:
    """List every parameter: those of no section, of detectors, and of other sections.

    Examples
    --------
    >>> from lidar_outlier_filter.parameters.filter import describe
    >>> next(one.unit for one in describe() if one.name == 'max_delay')
    's'

    """
    found = list(walk(FilterParameters, ''))
    alone = [one for one in found if '.' not in one.name]
    for name, section in _sections().items():
        alone += walk(section, f'{name}.')
    alone += [one for one in found if '.' in one.name]
    choices = tuple(installed().detectors)
    return tuple(replace(one, choices=choices) if one.name == 'chain' else one for one in alone)
