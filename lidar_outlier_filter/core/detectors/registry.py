# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""THE list of the detectors: those of the package, and those that a program registers.

To add one of your own, declare it and its parameters, and register it before the parameters are
read. Then the node, replay, ``clean`` and the tuner know it as they know the others.
"""

from __future__ import annotations

from contextlib import contextmanager
from types import MappingProxyType
from typing import TYPE_CHECKING

from lidar_outlier_filter.core.detectors import elevation, lof, sor
from lidar_outlier_filter.core.detectors.alpha_beta_gamma import declaration as alpha_beta_gamma
from lidar_outlier_filter.core.detectors.evidence import declaration as evidence
from lidar_outlier_filter.core.detectors.hierarchical import declaration as hierarchical
from lidar_outlier_filter.core.detectors.quadric import declaration as quadric
from lidar_outlier_filter.core.verdict import ALL
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.parameters.filter import add_section, remove_section

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from lidar_outlier_filter.core.detectors.declaration import Detector

_BUILT_IN = (
    alpha_beta_gamma.DETECTOR,
    quadric.DETECTOR,
    lof.DETECTOR,
    sor.DETECTOR,
    hierarchical.DETECTOR,
    elevation.DETECTOR,
    evidence.DETECTOR,
)
_detectors = {detector.name: detector for detector in _BUILT_IN}
_bits = {detector.name: detector.bit for detector in _BUILT_IN}

# By name, in the order of their bits; what is registered later is seen in them.
DETECTORS: Mapping[str, Detector] = MappingProxyType(_detectors)
BITS: Mapping[str, int] = MappingProxyType(_bits)


def register(detector: Detector) -> None:
    """Add a detector that does not come with the package.

    Raises
    ------
    FilterError
        If its name or its bit is taken, or its bit is none of those for detectors.

    """
    free = [1 << n for n in range(ALL.bit_length()) if 1 << n not in _bits.values()]
    if detector.bit not in free:
        must_be = 'one of ' + ', '.join(str(bit) for bit in free)
        raise FilterError(f'the bit of {detector.name}', must_be, detector.bit)
    add_section(detector.name, detector.section)
    _detectors[detector.name] = detector
    _bits[detector.name] = detector.bit


def unregister(name: str) -> None:
    """Take away a detector that was registered."""
    remove_section(name)
    del _detectors[name], _bits[name]


@contextmanager
def registered(detector: Detector) -> Iterator[None]:
    """Register a detector for a while, as in a test."""
    register(detector)
    try:
        yield
    finally:
        unregister(detector.name)


def table() -> str:
    """Write the table of the detectors for the documentation, in Markdown."""
    lines = ['| detector | bit | a point is rejected that … | source |', '| --- ' * 4 + '|']
    lines += [f'| `{one.name}` | {one.bit} | {one.rejects} | {one.source} |' for one in _BUILT_IN]
    return '\n'.join(lines) + '\n'
