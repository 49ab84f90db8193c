# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The detectors that are installed, and what follows from all their declarations together."""

from __future__ import annotations

from functools import cache
from itertools import chain
from typing import TYPE_CHECKING

from lidar_outlier_filter.core.detectors.builtin import EXPLANATIONS
from lidar_outlier_filter.core.detectors.declaration import ReasonName, resolve
from lidar_outlier_filter.parameters.declaration import MASK, MASKED, MASKED_REASON, OFF
from lidar_outlier_filter.parameters.filter import installed

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lidar_outlier_filter.core.detectors.declaration import Detector, Explanation
    from lidar_outlier_filter.parameters.filter import FilterParameters

# By name, in the order of their bits.
DETECTORS: Mapping[str, Detector] = installed().detectors


def bits() -> Mapping[str, int]:
    """Return the bits of what rejects points: of each detector, and of the mask."""
    return {**{name: one.bit for name, one in DETECTORS.items()}, MASK: MASKED}


def rejecting(parameters: FilterParameters) -> tuple[str, ...]:
    """Name what rejects points: the detectors of the chain, and the mask, where it is on."""
    return parameters.chain if parameters.mask == OFF else (*parameters.chain, MASK)


def reads(parameters: FilterParameters, column: str) -> bool:
    """Return whether a detector of the chain reads a column: 'intensity', 'ring'."""
    return any(column in DETECTORS[name].columns(parameters) for name in parameters.chain)


@cache
def explanations() -> Mapping[str, Explanation]:
    """Return the explanations of scores, by the names of detectors that have one."""
    return {name: resolve(EXPLANATIONS[name]) for name in DETECTORS if name in EXPLANATIONS}


@cache
def reasons() -> Mapping[int, ReasonName]:
    """Return what the numbers in ``outlier_reason`` mean."""
    every = [one.reasons.items() for one in explanations().values()]
    vehicle = ReasonName(MASK, 'on the own vehicle')
    return {**dict(chain.from_iterable(every)), MASKED_REASON: vehicle}


def table() -> str:
    """Write the table of the detectors for the documentation, in Markdown."""
    lines = ['| detector | bit | a point is rejected that … |', '| --- ' * 3 + '|']
    lines += [f'| `{one.name}` | {one.bit} | {one.rejects} |' for one in DETECTORS.values()]
    return '\n'.join(lines) + '\n'
