# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Sliders: for each detector of a chain some values of its threshold, the given one among them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.errors import ParameterError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.parameters.filter import FilterParameters

BITS = 21  # of a point, for the steps of all sliders
MOST_STEPS = 21
WIDEST = 3.0  # the least and the largest critical value are the given one ÷ and × this


@dataclass(frozen=True)
class Slider:
    """The steps of one threshold.

    Attributes
    ----------
    detector, name : the detector, and its parameter
    values : from the one that rejects most to the one that rejects least
    given : which of them the parameters hold
    limits : critical values of all steps ÷ that of the given one, ascending
    first : the bit of the first step, in a point's bits

    """

    detector: str
    name: str
    values: tuple[float, ...]
    given: int
    limits: NDArray[np.float64]
    first: int

    def changed(self, parameters: FilterParameters, step: int) -> FilterParameters:
        """Return the parameters of a step."""
        return parameters.changed({self.name: self.values[step]})


def sliders(parameters: FilterParameters) -> tuple[Slider, ...]:
    """Make a slider for each detector of the chain, as far as the bits of a point suffice."""
    chain = tuple(dict.fromkeys(parameters.chain))
    bits = min(BITS // len(chain), MOST_STEPS) if len(chain) <= BITS else 1
    found: list[Slider] = []
    for detector in chain[:BITS]:
        found.append(_slider(detector, parameters, (bits - 1) // 2, len(found) * bits))
    return tuple(found)


def _slider(detector: str, parameters: FilterParameters, half: int, first: int) -> Slider:
    """Make one with at most so many steps on either side of the given value."""
    threshold = DETECTORS[detector].threshold(parameters)
    given = float(parameters.flat()[threshold.name])
    middle = threshold.critical(given)
    possible = [value for value in threshold.values if fits(parameters, threshold.name, value)]
    criticals = np.array([threshold.critical(value) for value in possible])
    factors = WIDEST ** (np.arange(1, half + 1) / max(half, 1))
    # No factor leads away from 0: its neighbours are those from 1 on.
    looser = _nearest(criticals, (middle or 1.0) * factors, criticals > middle)
    stricter = _nearest(criticals, (middle or 1.0) / factors, criticals < middle)
    values = [*(possible[i] for i in stricter), given, *(possible[i] for i in looser)]
    limits = np.array([threshold.critical(value) for value in values])
    with np.errstate(divide='ignore', invalid='ignore'):
        limits = limits / middle
    return Slider(detector, threshold.name, tuple(values), len(stricter), limits, first)


def _nearest(
    criticals: NDArray[np.float64], goals: NDArray[np.float64], allowed: NDArray[np.bool_]
) -> list[int]:
    """Find the critical values nearest to some goals, ascending, each once."""
    indices = np.flatnonzero(allowed)
    if len(indices) == 0:
        return []
    return sorted({int(indices[np.abs(criticals[indices] - goal).argmin()]) for goal in goals})


def fits(parameters: FilterParameters, name: str, value: float) -> bool:
    """Return whether a parameter may have a value beside the others."""
    try:
        parameters.changed({name: value})
    except ParameterError:
        return False
    return True
