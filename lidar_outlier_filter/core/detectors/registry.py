# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The detectors that are installed, and what follows from all their declarations together."""

from collections.abc import Mapping
from functools import cache
from itertools import chain
from typing import Any

from lidar_outlier_filter.core.detectors.declaration import Detector, ReasonName, resolve
from lidar_outlier_filter.core.detectors.plugins import EXPLANATIONS
from lidar_outlier_filter.parameters.declaration import (
    MASK,
    MASKED,
    MASKED_REASON,
    OFF,
    SHADOW_REASON,
)
from lidar_outlier_filter.parameters.filter import FilterParameters, installed

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


def read_field(parameters: FilterParameters) -> str:
    """Return the field that a detector of the chain reads by its name; empty: none does."""
    names = (DETECTORS[name].field(parameters) for name in parameters.chain)
    return next(filter(None, names), '')


@cache
def explanations() -> Mapping[str, Any]:
    """Return the modules of :data:`.EXPLANATIONS` by the names of their detectors."""
    return {name: resolve(EXPLANATIONS[name]) for name in DETECTORS if name in EXPLANATIONS}


@cache
def reasons() -> Mapping[int, ReasonName]:
    """Return what the numbers in ``outlier_reason`` mean."""
    every = [one.REASONS.items() for one in explanations().values()]
    vehicle = ReasonName(MASK, 'on the own vehicle')
    shadow = ReasonName('mask_shadow', 'in the shadow of the own vehicle')
    known = dict(chain.from_iterable(every))
    return {**known, SHADOW_REASON: shadow, MASKED_REASON: vehicle}


def table() -> str:
    """Write the table of the detectors for the documentation, in Markdown."""
    lines = ['| detector | bit | a point is rejected that … |', '| --- ' * 3 + '|']
    lines += [f'| `{one.name}` | {one.bit} | {one.rejects} |' for one in DETECTORS.values()]
    return '\n'.join(lines) + '\n'
