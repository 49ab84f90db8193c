# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What can be tuned of a detector: its threshold, and the settings to try.

A threshold is a parameter that divides a score and does nothing else to it, so that one run gives
what every value of it would reject. Where that holds only nearly (the smoother, the quadrics and
the default look again without what they rejected), the tuner runs again at the value it found.
"""

# ruff: noqa: PLC0415  declarations are read wherever parameters are, often without NumPy

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    import numpy as np
    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Reals

    ScoreOf = Callable[[Mapping[str, object]], Reals]
    Statistic = Callable[[ScoreOf, float], Reals]

Values = Mapping[str, object]  # of parameters, by their names
Dial = tuple[Values, ...]  # settings that exclude each other

# Preferred numbers, E24: about 10 % apart, and short to write.
SERIES: tuple[float, ...] = (1.0, 1.1, 1.2, 1.3, 1.5, 1.6, 1.8, 2.0, 2.2, 2.4, 2.7, 3.0)
SERIES += (3.3, 3.6, 3.9, 4.3, 4.7, 5.1, 5.6, 6.2, 6.8, 7.5, 8.2, 9.1)
NEIGHBOURS = (3, 5, 7, 10, 15, 20, 30, 40, 50, 60, 70)


@dataclass(frozen=True)
class Threshold:
    """The parameter that a score is divided by, directly or through a critical value.

    Attributes
    ----------
    name : of the parameter
    values : to choose from, from the one that rejects most to the one that rejects least
    critical : critical value of a parameter's value; ascends along ``values``
    statistic : from a function that gives the scores under other parameters, and the value of this
        one to be near: (N,) what the critical value is compared with, rejected where larger

    """

    name: str
    values: tuple[float, ...]
    critical: Callable[[float], float]
    statistic: Statistic

    def criticals(self) -> NDArray[np.float64]:
        """Return the critical values, ascending."""
        import numpy as np

        return np.array([self.critical(value) for value in self.values])


def decades(low: int, high: int) -> list[float]:
    """List the preferred numbers from 10^low to 10^high, ascending."""
    numbers = [float(f'{one}e{power}') for power in range(low, high) for one in SERIES]
    return [*numbers, float(f'1e{high}')]


def scaled(name: str, values: Iterable[float], critical: Callable[[float], float]) -> Threshold:
    """Make a threshold whose critical value divides the score."""

    def statistic(score_of: ScoreOf, near: float) -> Reals:
        # In double precision: the critical value of a wild threshold may be beyond float32.
        return score_of({name: near}).astype('float64') * critical(near)

    return Threshold(name, tuple(values), critical, statistic)


def plain(name: str, values: Iterable[float]) -> Threshold:
    """Make a threshold that is the critical value itself."""
    return scaled(name, values, float)


def significance(name: str) -> Threshold:
    """Make a threshold that is a two-sided probability."""
    values = (value for value in reversed(decades(-15, 0)) if value <= 0.1)  # noqa: PLR2004  a tenth of all is too much for any
    return scaled(name, values, _quantile)


def _quantile(probability: float) -> float:
    from scipy.special import ndtri

    return float(-ndtri(probability / 2))


def each(name: str, values: Iterable[object]) -> Dial:
    """Make a dial of the values of one parameter."""
    return tuple({name: value} for value in values)
