# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The installed detectors: those of this package, and those that other distributions add.

A distribution adds a detector by an entry point of the group ``lidar_outlier_filter.detectors``. A
declaration that is wrong is refused in one sentence and affects nothing else.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from importlib.metadata import Distribution, EntryPoint, distributions
from typing import Any

from lidar_outlier_filter.core.detectors.builtin import BUILTIN, DEFAULT
from lidar_outlier_filter.core.detectors.declaration import Detector
from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.declaration import BITS, Installed, Section, shown, walk

GROUP = 'lidar_outlier_filter.detectors'  # of entry points
LINES = ('no', 'uses', 'needs')
LARGE = ('files', 'tiles', 'no')


def find_detectors(reserved: Collection[str]) -> Installed:
    """Find all detectors; ``reserved`` names cannot be those of a section of parameters."""
    return add_plugins(entry_points(distributions()), reserved)


def entry_points(every: Iterable[Distribution]) -> Iterator[tuple[str, EntryPoint]]:
    """Yield the entry points of detectors, with the names of their distributions ('': none).

    A distribution that is found twice counts as first found.
    """
    names = set()
    for one in every:
        if GROUP not in (one.read_text('entry_points.txt') or ''):
            continue
        name = _name_of(one)
        if name not in names or not name:
            names.add(name)
            yield from ((name, point) for point in one.entry_points if point.group == GROUP)


def _name_of(distribution: Distribution) -> str:
    try:
        return str(distribution.metadata['Name'] or '')
    except Exception:  # noqa: BLE001  a reader of metadata may raise anything
        return ''


def add_plugins(points: Iterable[tuple[str, EntryPoint]], reserved: Collection[str]) -> Installed:
    """Load declarations beside the built-in ones, in the order of their distributions' names."""
    found = dict(BUILTIN)
    refused: dict[str, ParameterError] = {}
    for origin, point in sorted(points, key=lambda one: (one[0], one[1].name)):
        title = f'the detector {point.name} of {origin or "a distribution without a name"}'
        try:
            found[point.name] = _load(point, title, found, reserved)
        except ParameterError as err:
            # The name of a detector that is installed stays usable.
            refused.setdefault(title if point.name in found else point.name, err)
    ordered = sorted(found.items(), key=lambda item: item[1].bit)
    return Installed(dict(ordered), refused, (DEFAULT,))


def _load(
    point: EntryPoint, title: str, found: Mapping[str, Detector], reserved: Collection[str]
) -> Detector:
    """Load one declaration.

    Raises
    ------
    ParameterError
        If it cannot be imported, is not a valid declaration, or conflicts with another one.

    """
    try:
        one = point.load()
    except KeyboardInterrupt:
        raise
    except BaseException as err:
        got = f'{type(err).__name__}: {err}'
        raise ParameterError(title, 'a declaration that can be imported', got) from err
    if not isinstance(one, Detector):
        raise ParameterError(title, 'a Detector', shown(one))
    _check_fields(one, title)
    if one.name != point.name:
        raise ParameterError(f'the name of {title}', 'that of its entry point', repr(one.name))
    if one.name in {*reserved, *found}:
        raise ParameterError(f'the name of parameters of {title}', 'a new one', repr(one.name))
    free = [bit for bit in BITS if bit not in {other.bit for other in found.values()}]
    if one.bit not in free:
        must_be = f'a free one ({", ".join(map(str, free)) or "none is left"})'
        raise ParameterError(f'the bit of {title}', must_be, shown(one.bit))
    return one


def _check_fields(one: Any, title: str) -> None:
    for name, (is_right, must_be) in _FIELDS.items():
        value = getattr(one, name)
        if not is_right(value):
            raise ParameterError(f'{name} of {title}', must_be, shown(value))


def _is_function(value: Any) -> bool:
    return callable(value) or (isinstance(value, str) and ':' in value)


def _is_section(section: Any) -> bool:
    """Return whether an object is a class of parameters whose defaults are allowed."""
    is_class = isinstance(section, type) and issubclass(section, Section)
    try:
        for parameter in walk(section, ''):
            parameter.check(parameter.default)
        section().check()
        hash(section())
    except Exception:  # noqa: BLE001  the class is a plug-in's
        return False
    return is_class


_FIELDS: dict[str, tuple[Callable[[Any], bool], str]] = {
    'name': (lambda value: isinstance(value, str) and value.isidentifier(), 'an identifier'),
    'bit': (lambda value: type(value) is int, 'an integer'),
    'section': (_is_section, 'a frozen dataclass of declared parameters'),
    'score': (_is_function, "a function, or 'module:function'"),
    'rejects': (lambda value: isinstance(value, str), 'a string'),
    'neighbours': (callable, 'a function of the parameters'),
    'lines': (LINES.__contains__, f'one of {", ".join(LINES)}'),
    'columns': (callable, 'a function of the parameters'),
    'field': (callable, 'a function of the parameters'),
    'large': (LARGE.__contains__, f'one of {", ".join(LARGE)}'),
}
