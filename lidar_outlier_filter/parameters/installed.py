# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The detectors that are installed: those of this package and of others, by their entry points.

What a detector does is declared above this floor; here it has a name, a bit and its parameters.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING, Protocol

from lidar_outlier_filter.errors import FilterError, ParameterError

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping
    from importlib.metadata import EntryPoint

    from lidar_outlier_filter.parameters.declaration import Section

GROUP = 'lidar_outlier_filter.detectors'  # of entry points: declarations of detectors
BITS = tuple(1 << n for n in range(14))  # that a detector may have
MASK, MASKED = 'mask', 1 << 14  # of points on the own vehicle, which no detector sees
MASKED_REASON = 255  # in outlier_reason


class Declared(Protocol):
    """What of a declaration matters to the parameters."""

    @property
    def name(self) -> str:
        """In ``chain``."""

    @property
    def bit(self) -> int:
        """In ``outlier_detectors``."""

    @property
    def sections(self) -> Mapping[str, type[Section]]:
        """Its parameters, by the first part of their names."""

    @property
    def by_default(self) -> bool:
        """Whether it is the default chain."""


@dataclass(frozen=True)
class Installed:
    """All detectors that were found.

    Attributes
    ----------
    detectors : their declarations by name, in the order of their bits
    refused : a sentence for each that makes no sense, by the name of its entry point

    """

    detectors: dict[str, Declared]
    refused: dict[str, ParameterError]


def gather(points: Iterable[EntryPoint], reserved: Collection[str]) -> Installed:
    """Load declarations: this package's own first, then those of others by their names.

    One that makes no sense is refused, and costs nothing else. ``reserved`` are names that no
    section of parameters may have.

    Raises
    ------
    FilterError
        If none is of this package: it is not installed.

    """
    found: dict[str, Declared] = {}
    refused: dict[str, ParameterError] = {}
    for point in sorted(points, key=_order):
        try:
            found[point.name] = _load(point, found, reserved)
        except ParameterError as err:
            refused.setdefault(point.name, err)
    if not any(one.by_default for one in found.values()):
        must_be = "installed with the package (pip install '.' in the project)"
        raise FilterError('the detectors', must_be, 'none')
    ordered = sorted(found.items(), key=lambda item: item[1].bit)
    return Installed(dict(ordered), refused)


def _load(point: EntryPoint, found: Mapping[str, Declared], reserved: Collection[str]) -> Declared:
    """Load one declaration, and refuse what would disturb the others."""
    try:
        one: Declared = point.load()
        name, bit, sections = one.name, one.bit, dict(one.sections)
    except Exception as err:
        if _is_own(point):
            raise
        got = f'{type(err).__name__}: {err}'
        raise ParameterError(_said(point), 'a declaration that can be imported', got) from err
    if name != point.name:
        raise ParameterError(f'the name of {_said(point)}', 'that of its entry point', repr(name))
    taken = {*reserved, *chain.from_iterable(one.sections for one in found.values())}
    for section in sections:
        if section in taken:
            raise ParameterError(
                f'the name of parameters of {_said(point)}', 'a new one', repr(section)
            )
    free = [bit for bit in BITS if bit not in {one.bit for one in found.values()}]
    if bit not in free:
        raise ParameterError(
            f'the bit of {_said(point)}', f'one of {", ".join(map(str, free))}', bit
        )
    return one


def _is_own(point: EntryPoint) -> bool:
    return point.value.partition('.')[0] == GROUP.partition('.')[0]


def _order(point: EntryPoint) -> tuple[str, str]:
    """Sort own ones first: their distribution is not asked, whose metadata is read slowly."""
    return '' if _is_own(point) else _origin(point), point.name


def _said(point: EntryPoint) -> str:
    return f'the detector {point.name} of {_origin(point)}'


def _origin(point: EntryPoint) -> str:
    """Name the distribution that an entry point is of."""
    return point.dist.name if point.dist else 'an unknown distribution'
