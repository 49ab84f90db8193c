# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""THE place of every parameter: name, type, default, unit, range and one sentence.

ROS declarations, ``config/defaults.yaml``, the table in the README and command-line help are made
from this file. A parameter of a detector is named ``detector.parameter``.
"""

from __future__ import annotations

import math
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.errors import ParameterError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

LARGEST = 2**63  # of ROS's whole numbers
TYPE_NAMES = {bool: 'true or false', int: 'a whole number', float: 'a number', str: 'a text'}


@dataclass(frozen=True)
class Parameter:
    """One parameter: what a user may know of it.

    ``low`` and ``high`` are inclusive and None where there is no limit; ``choices`` are the texts
    allowed, empty where any is. A ``fixed`` parameter shapes the stream and is set at the start
    only.
    """

    name: str
    default: Any
    text: str
    unit: str = ''
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    fixed: bool = False

    @property
    def range_text(self) -> str:
        """Say what is allowed, as in 'from 0 to 1 s'."""
        if self.choices:
            return 'one of ' + ', '.join(repr(choice) for choice in self.choices)
        unit = f' {self.unit}' if self.unit else ''
        if self.low is not None and self.high is not None:
            return f'from {self.low:g} to {self.high:g}{unit}'
        if self.low is not None:
            return f'at least {self.low:g}{unit}'
        if self.high is not None:
            return f'at most {self.high:g}{unit}'
        return TYPE_NAMES.get(type(self.default), 'a list of texts')

    def check(self, value: object) -> Any:
        """Return the value in the parameter's own type, or refuse it."""
        if isinstance(self.default, tuple):
            return self._check_list(value)
        wanted = type(self.default)
        if wanted is float and type(value) is int and abs(value) < LARGEST:
            value = float(value)
        if type(value) is not wanted:
            raise ParameterError(self.name, TYPE_NAMES[wanted], repr(value))
        if wanted is str:
            if self.choices and value not in self.choices:
                raise ParameterError(self.name, self.range_text, repr(value))
        elif wanted is not bool:
            self._check_range(value)
        return value

    def _check_range(self, value: Any) -> None:
        inside = abs(value) < LARGEST and math.isfinite(value)
        inside = inside and (self.low is None or value >= self.low)
        inside = inside and (self.high is None or value <= self.high)
        if not inside:
            raise ParameterError(self.name, self.range_text, repr(value))

    def _check_list(self, value: object) -> tuple[str, ...]:
        if isinstance(value, str) or not hasattr(value, '__iter__'):
            raise ParameterError(self.name, 'a list of texts', repr(value))
        values = tuple(value)
        wrong = [item for item in values if item not in self.choices]
        if wrong or not values or len(set(values)) < len(values):
            must_be = 'a list, without repetition, of ' + self.range_text
            raise ParameterError(self.name, must_be, repr(list(values)))
        return values


def _parameter(  # noqa: PLR0913  one line declares all that is known of a parameter
    default: Any,
    text: str,
    unit: str = '',
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
    *,
    fixed: bool = False,
) -> Any:
    """Declare a parameter as a field of one of the dataclasses below."""
    about = {'text': text, 'unit': unit, 'low': low, 'high': high, 'choices': choices}
    return field(default=default, metadata={**about, 'fixed': fixed})


@dataclass(frozen=True)
class AlphaBetaGamma:
    """The moving fixed-interval α-β-γ smoother along each line segment."""

    before: int = _parameter(3, 'Points of the window in front of the tested one.', '', 0, 1000)
    after: int = _parameter(3, 'Points of the window behind the tested one.', '', 0, 1000)
    order: int = _parameter(
        1,
        'Motion along the line: 2 with acceleration (α-β-γ), 1 without (α-β).',
        '',
        1,
        2,
    )
    significance: float = _parameter(
        1e-6, 'Two-sided probability to reject a good point, for one test.', '', 1e-15, 0.5
    )
    sides: str = _parameter(
        'either',
        'both: the window around the point decides (the paper); either: a point that agrees with '
        'the window on one side is kept, so edges and corners stay.',
        choices=('both', 'either'),
    )
    test: str = _parameter(
        'each',
        'each: the worst coordinate; joint: all three at once; both: the stricter of the two.',
        choices=('each', 'joint', 'both'),
    )
    sigma: float = _parameter(
        0.0, 'Standard deviation of a coordinate; 0: estimated from each line.', 'm', 0.0, 100.0
    )
    sigma_field: str = _parameter(
        '', "Field with each point's own standard deviation in metres; empty: none.", fixed=True
    )
    sigma_floor: float = _parameter(
        0.005, 'Least standard deviation that an estimate may give.', 'm', 1e-6, 100.0
    )
    min_window: int = _parameter(
        3, 'Fewest other points in a window; with fewer a point stays untested.', '', 3, 1000
    )
    passes: int = _parameter(
        30, 'Most repetitions without the rejected; the last rejects all that is left.', '', 1, 1000
    )
    engine: str = _parameter(
        'kernel',
        'kernel: compiled; filterpy: a Kalman filter with RTS smoother, slow but auditable.',
        choices=('kernel', 'filterpy'),
    )


@dataclass(frozen=True)
class FilterParameters:
    """All parameters of the filter; make a changed copy with :meth:`changed`."""

    chain: tuple[str, ...] = _parameter(
        ('alpha_beta_gamma',), 'Detectors, in their order.', choices=('alpha_beta_gamma',)
    )
    time_field: str = _parameter(
        'auto', 'Field with the time of each point; auto: by its name.', fixed=True
    )
    time_unit: str = _parameter(
        'auto',
        'Unit of the time field; auto: by its type and size.',
        choices=('auto', 's', 'us', 'ns'),
        fixed=True,
    )
    time_reference: str = _parameter(
        'auto',
        'Whether the time field counts from the header stamp or is absolute; auto: by its size.',
        choices=('auto', 'stamp', 'absolute'),
        fixed=True,
    )
    points_per_second: float = _parameter(
        1e7,
        'Stands in for a missing time field: point i is i / points_per_second after the stamp. Too '
        'high does no harm, too low lets clouds overlap; 0: clouds without time are refused.',
        '1/s',
        0.0,
        1e9,
        fixed=True,
    )
    time_jump: float = _parameter(
        1.0,
        'A clock that goes back by more resets the stream; one that goes back by less is refused.',
        's',
        0.0,
        1e9,
        fixed=True,
    )
    line_source: str = _parameter(
        'auto',
        'What makes a scan line: a field (ring), each row, each message, or a wrap of the scan '
        'angle; auto: field, else row, else message.',
        choices=('auto', 'field', 'row', 'message', 'angle'),
        fixed=True,
    )
    line_field: str = _parameter(
        'auto', 'Field with the number of the line; auto: by its name.', fixed=True
    )
    angle_field: str = _parameter(
        '', 'Field with the scan angle; empty: the angle of the point in angle_plane.', fixed=True
    )
    angle_unit: str = _parameter(
        'rad', 'Unit of the angle field.', choices=('rad', 'deg'), fixed=True
    )
    angle_plane: str = _parameter(
        'yz',
        "Plane in which a profile scanner's mirror turns, in the frame of the cloud.",
        choices=('xy', 'yz', 'zx'),
        fixed=True,
    )
    gap_factor: float = _parameter(
        1.5,
        "A segment ends where the next shot is later than this many of the line's intervals.",
        '',
        1.0,
        1e6,
    )
    block: float = _parameter(
        0.1,
        'Length of the stretches of sensor time that are judged together.',
        's',
        1e-3,
        60.0,
        fixed=True,
    )
    halo: float = _parameter(
        0.01, 'Stretch before and after a block that is seen with it.', 's', 0.0, 60.0, fixed=True
    )
    lateness: float = _parameter(
        0.0,
        'How much older than the newest point a point may be that still arrives.',
        's',
        0.0,
        60.0,
        fixed=True,
    )
    max_delay: float = _parameter(
        1.0, 'Longest time a live cloud waits for its answer.', 's', 1e-3, 600.0, fixed=True
    )
    max_points: int = _parameter(
        50_000_000,
        'Most points held at once; a cloud beyond is refused.',
        '',
        1,
        2_000_000_000,
        fixed=True,
    )
    keep_organized: bool = _parameter(
        default=False,
        text='Keep the shape of organised clouds: rejected points become NaN in the cleaned cloud.',
    )
    scores: bool = _parameter(
        default=False,
        text='Add outlier_score (float32) and outlier_detectors (uint16) to both clouds.',
    )
    alpha_beta_gamma: AlphaBetaGamma = AlphaBetaGamma()

    def __post_init__(self) -> None:
        """Refuse what cannot be: each parameter by itself, then together."""
        for parameter in describe():
            parameter.check(_value(self, parameter.name))
        _check_together(self)

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
    wait = parameters.block + parameters.halo + parameters.lateness
    if parameters.max_delay < wait:
        must_be = f'at least block + halo + lateness = {wait:g} s'
        raise ParameterError('max_delay', must_be, f'{parameters.max_delay:g} s')


def _walk(cls: type, prefix: str) -> Iterator[Parameter]:
    for item in fields(cls):
        if is_dataclass(item.default) and not isinstance(item.default, type):
            yield from _walk(type(item.default), f'{prefix}{item.name}.')
        elif item.default is not MISSING:
            yield Parameter(prefix + item.name, item.default, **item.metadata)


def describe() -> tuple[Parameter, ...]:
    """List every parameter, in the order of declaration."""
    return tuple(_walk(FilterParameters, ''))
