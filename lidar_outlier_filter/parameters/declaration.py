# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What a parameter is: its declaration as a field of a dataclass, and the check of a value."""

import errno
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from difflib import get_close_matches
from pathlib import Path
from reprlib import Repr
from typing import Any

from lidar_outlier_filter.errors import ParameterError

_SHORT = Repr()
_SHORT.maxlevel, _SHORT.maxlist, _SHORT.maxtuple, _SHORT.maxdict = 3, 30, 30, 10
_SHORT.maxstring = _SHORT.maxother = 100
_SHORT.maxlong = 500
LARGEST = 2**63  # of ROS's whole numbers
OFF = 'off'
BITS = tuple(1 << n for n in range(14))  # that a detector may have
MASK, MASKED = 'mask', 1 << 14  # of points on the own vehicle, which no detector sees
MASKED_REASON, SHADOW_REASON = 255, 254  # in outlier_reason
TYPE_NAMES = {bool: 'true or false', int: 'a whole number', float: 'a number', str: 'a string'}


@dataclass(frozen=True)
class Parameter:
    """One parameter, as users see it.

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
        return TYPE_NAMES.get(type(self.default), 'a list of strings')

    def check(self, value: object) -> Any:
        """Return the value in the parameter's own type, or refuse it."""
        if isinstance(self.default, tuple):
            return self._check_list(value)
        expected = type(self.default)
        if expected is float and type(value) is int and abs(value) < LARGEST:
            value = float(value)
        if value is False and self.default == OFF:  # what YAML makes of the word
            value = OFF
        if type(value) is not expected:
            raise ParameterError(self.name, TYPE_NAMES[expected], shown(value))
        if expected is str:
            self._check_text(value)
            if self.choices and value not in self.choices:
                got = shown(value) + did_you_mean([value], self.choices)
                raise ParameterError(self.name, self.range_text, got)
        elif expected is not bool:
            self._check_range(value)
        return value

    def _check_text(self, value: object) -> None:
        """Refuse what ROS can neither hold nor send: its texts are UTF-8, and end at a NUL."""
        # JSON may name half a pair of UTF-16.
        if isinstance(value, str) and any(
            one == '\0' or '\ud800' <= one <= '\udfff' for one in value
        ):
            raise ParameterError(self.name, 'a Unicode string without NUL', shown(value))

    def _check_range(self, value: Any) -> None:
        inside = abs(value) < LARGEST and math.isfinite(value)
        inside = inside and (self.low is None or value >= self.low)
        inside = inside and (self.high is None or value <= self.high)
        if not inside:
            raise ParameterError(self.name, self.range_text, shown(value))

    def _check_list(self, value: object) -> tuple[str, ...]:
        if not isinstance(value, list | tuple):
            raise ParameterError(self.name, 'a list of strings', shown(value))
        values = tuple(value)
        for item in values:
            self._check_text(item)
        known = self.choices or [item for item in values if isinstance(item, str) and item]
        right = all(item in known for item in values)
        if not right or not values or len(set(values)) < len(values):
            must_be = 'a list, without repetition, of '
            must_be += self.range_text if self.choices else 'texts'
            unknown = [item for item in values if item not in self.choices]
            got = shown(list(values)) + did_you_mean(unknown, self.choices)
            raise ParameterError(self.name, must_be, got)
        return values


def shown(value: object) -> str:
    """Write a value as Python does, shortened if it is long."""
    return _SHORT.repr(value)


def did_you_mean(unknown: Iterable[object], known: Iterable[str]) -> str:
    """Name what was probably meant by the unknown texts, in brackets; empty if nothing is near."""
    names, meant = list(known), list[str]()
    for text in (one for one in unknown if isinstance(one, str)):
        ends = [name for name in names if name.endswith(f'.{text}')]
        meant += ends or get_close_matches(text, names, 1)
    return f' (did you mean {", ".join(map(repr, meant))}?)' if meant else ''


def declare(  # noqa: PLR0913  one line declares all that is known of a parameter
    default: Any,
    text: str,
    unit: str = '',
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
    *,
    fixed: bool = False,
) -> Any:
    """Declare a parameter as a field of a dataclass; a default may be a function that gives it."""
    about = {'text': text, 'unit': unit, 'low': low, 'high': high, 'choices': choices}
    if callable(default):
        return field(default_factory=default, metadata={**about, 'fixed': fixed})
    return field(default=default, metadata={**about, 'fixed': fixed})


class Section:
    """Parameters of one detector: a frozen dataclass of fields that :func:`declare` made."""

    def check(self) -> None:
        """Refuse settings that make sense alone but not with each other."""


def walk(cls: type, prefix: str) -> Iterator[Parameter]:
    """Yield the parameters of a dataclass in the order of declaration, those of sections last."""
    sections = []
    for item in fields(cls):
        if is_dataclass(item.default) and not isinstance(item.default, type):
            sections.append((type(item.default), f'{prefix}{item.name}.'))
        elif item.metadata:
            factory = item.default_factory
            default = item.default if factory is MISSING else factory()
            yield Parameter(prefix + item.name, default, **item.metadata)
    for section, name in sections:
        yield from walk(section, name)


def read_small(path: Path, largest: int) -> bytes:
    """Read a file, but at most one byte more than ``largest``.

    Raises
    ------
    OSError
        If it cannot be read, or is a pipe or device, which could block.

    """
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise OSError(errno.EINVAL, 'not a regular file')
    with path.open('rb') as stream:
        return stream.read(largest + 1)


@dataclass(frozen=True)
class Installed:
    """All detectors that were found.

    Attributes
    ----------
    detectors : their declarations (:class:`.Detector`) by name, in the order of their bits
    refused : why a declaration was refused, by the name of its entry point
    default : the default chain

    """

    detectors: dict[str, Any]
    refused: Mapping[str, ParameterError]
    default: tuple[str, ...]
