# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Sliders: for each detector of a chain some values of its threshold, the given one among them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.core.detectors.thresholds import threshold
from lidar_outlier_filter.errors import ParameterError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from lidar_outlier_filter.core.detectors.thresholds import Threshold
    from lidar_outlier_filter.parameters.filter import FilterParameters

BITS = 21  # of a point, for the steps of all sliders
WIDEST = 3.0  # the least critical value is the given one ÷ this
MOST_REJECTED = 0.5  # of the tested points: nobody wants to see more than that rejected


@dataclass(frozen=True)
class SliderValues:
    """The values that a threshold may have.

    Attributes
    ----------
    detector, name : the detector, and its parameter
    values : from the one that rejects most to the one that rejects least
    given : which of them the parameters hold
    limits : critical values of all ÷ that of the given one, ascending; not finite where that is 0

    """

    detector: str
    name: str
    values: tuple[float, ...]
    given: int
    limits: NDArray[np.float64]


@dataclass(frozen=True)
class Slider(SliderValues):
    """The steps of one threshold, chosen of its values.

    Attributes
    ----------
    chosen : which of the values its steps are
    first : the bit of the first step, in a point's bits

    """

    chosen: NDArray[np.intp]
    first: int

    def changed(self, parameters: FilterParameters, step: int) -> FilterParameters:
        """Return the parameters of a step."""
        return parameters.changed({self.name: self.values[step]})


def choices(parameters: FilterParameters) -> tuple[SliderValues, ...]:
    """List the values of the threshold of each detector of the chain."""
    chain = tuple(dict.fromkeys(parameters.chain))
    found = ((name, threshold(DETECTORS[name], parameters)) for name in chain[:BITS])
    return tuple(_choice(name, one, parameters) for name, one in found if one is not None)


def _choice(detector: str, threshold: Threshold, parameters: FilterParameters) -> SliderValues:
    given = float(parameters.flat()[threshold.name])
    middle = threshold.critical(given)
    others = [one for one in threshold.values if fits(parameters, threshold.name, one)]
    stricter = [one for one in others if threshold.critical(one) < middle]
    looser = [one for one in others if threshold.critical(one) > middle]
    values = (*stricter, given, *looser)
    limits = np.array([threshold.critical(value) for value in values])
    with np.errstate(divide='ignore', invalid='ignore'):
        limits = limits / middle
    return SliderValues(detector, threshold.name, values, len(stricter), limits)


def sliders(
    given: Sequence[SliderValues], rejected: Sequence[NDArray[np.int64]], tested: int
) -> tuple[Slider, ...]:
    """Make a slider of each choice, as far as the bits of a point suffice.

    Its steps follow the scores: each rejects other points than the one beside it, from half of the
    points, or a third of the critical value, to none.

    Parameters
    ----------
    given : the values to choose from
    rejected : how many points each of them would reject, about
    tested : how many points have a score

    """
    bits = BITS // max(len(given), 1)
    half = (bits - 1) // 2
    made: list[Slider] = []
    for number, (one, counts) in enumerate(zip(given, rejected, strict=True)):
        chosen = _steps(one, counts, tested, half)
        values = tuple(one.values[i] for i in chosen)
        at = int(np.searchsorted(chosen, one.given))
        limits = one.limits[chosen]
        made.append(Slider(one.detector, one.name, values, at, limits, chosen, number * bits))
    return tuple(made)


def _steps(
    one: SliderValues, rejected: NDArray[np.int64], tested: int, half: int
) -> NDArray[np.intp]:
    """Choose values with at most so many on either side of the given one, ascending."""
    stricter, looser = np.arange(one.given)[::-1], np.arange(one.given + 1, len(one.values))
    if not np.isfinite(one.limits[one.given]):
        # Of a critical value of 0 no score is a multiple.
        sides = [
            side[np.unique(np.linspace(0, len(side) - 1, half).astype(np.intp))]
            for side in (stricter, looser)
            if len(side)
        ]
    else:
        seen = (one.limits >= 1 / WIDEST) & (rejected <= MOST_REJECTED * tested)
        sides = [
            _spread(side, rejected, rejected[one.given], half)
            for side in (stricter[seen[stricter]], looser)
        ]
    return np.sort(np.concatenate([[one.given], *sides])).astype(np.intp)


def _spread(
    side: NDArray[np.intp], rejected: NDArray[np.int64], given: int, half: int
) -> NDArray[np.intp]:
    """Choose at most so many values, the nearest first, that differ by about the same factor."""
    counts = rejected[side]
    changed = np.flatnonzero(np.diff(counts, prepend=given))
    if len(changed) <= half:
        return side[changed]
    size = np.log1p(counts[changed])
    goals = np.linspace(np.log1p(given), size[-1], half + 1)[1:]
    nearest = np.abs(size[:, None] - goals).argmin(axis=0)
    chosen: NDArray[np.intp] = side[changed[np.unique(nearest)]]
    return chosen


def fits(parameters: FilterParameters, name: str, value: float) -> bool:
    """Return whether a parameter may have a value beside the others."""
    try:
        parameters.changed({name: value})
    except ParameterError:
        return False
    return True
