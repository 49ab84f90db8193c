# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The installed detectors, as parameters know them: names, bits, and classes of parameters.

How they are found is registered by the package, as detectors belong to the rooms above.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lidar_outlier_filter.errors import ParameterError

BITS = tuple(1 << n for n in range(14))  # that a detector may have
MASK, MASKED = 'mask', 1 << 14  # of points on the own vehicle, which no detector sees
MASKED_REASON = 255  # in outlier_reason


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


FindDetectors = Callable[[Collection[str]], Installed]
_find: list[FindDetectors] = []


def register(find: FindDetectors) -> None:
    """Set the function that finds all detectors, of names that their sections cannot have."""
    _find[:] = [find]


def find(reserved: Collection[str]) -> Installed:
    """Find the detectors by the registered function."""
    return _find[0](reserved)
