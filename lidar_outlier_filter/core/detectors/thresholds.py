# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Thresholds: the parameter of each detector that its score is divided by.

It changes nothing else of the score, so that one run gives what every value would reject. Where
that holds only nearly (the smoother and the quadrics repeat without the rejected points), the tuner
runs again at the value it found.
"""

# ruff: noqa: PLC0415  completion of the command line reads this without NumPy

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from lidar_outlier_filter.parameters.declaration import walk

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    import numpy as np
    from numpy.typing import NDArray

    from lidar_outlier_filter.core.annotations import Reals
    from lidar_outlier_filter.core.detectors.declaration import Detector
    from lidar_outlier_filter.parameters.declaration import Parameter
    from lidar_outlier_filter.parameters.filter import FilterParameters

    ScoreOf = Callable[[Mapping[str, object]], Reals]
    Statistic = Callable[[ScoreOf, float], Reals]

# Preferred numbers, E24: about 10 % apart, and short to write.
SERIES: tuple[float, ...] = (1.0, 1.1, 1.2, 1.3, 1.5, 1.6, 1.8, 2.0, 2.2, 2.4, 2.7, 3.0)
SERIES += (3.3, 3.6, 3.9, 4.3, 4.7, 5.1, 5.6, 6.2, 6.8, 7.5, 8.2, 9.1)
SMALLEST_RADIUS = 1e-6  # that sor.radius may be


@dataclass(frozen=True)
class Threshold:
    """The parameter that a score is divided by, directly or through a critical value.

    Attributes
    ----------
    name : of the parameter
    values : to choose from, from the one that rejects most to the one that rejects least
    critical : critical value of a parameter's value; ascends along ``values``
    statistic : called with a function that returns the scores under given parameters, and a value
        of this one; returns (N,) numbers, rejected where above the critical value

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


def threshold(detector: Detector, parameters: FilterParameters) -> Threshold | None:
    """Return the threshold of a detector: by default the first of its parameters that is a float.

    None if it has no such parameter.
    """
    if detector.name in _THRESHOLDS:
        return _THRESHOLDS[detector.name](parameters)
    for one in walk(detector.section, f'{detector.name}.'):
        if isinstance(one.default, float):
            values = [value for value in decades(-6, 6) if _is_allowed(one, value)]
            return plain(one.name, sorted({*values, one.default}))
    return None


def _is_allowed(parameter: Parameter, value: float) -> bool:
    low, high = parameter.low, parameter.high
    return (low is None or value >= low) and (high is None or value <= high) and value > 0


def _elevation(parameters: FilterParameters) -> Threshold:
    if parameters.value('elevation.against') == 'ground':
        return plain('elevation.height', decades(-1, 4))
    return plain('elevation.multiplier', decades(-1, 3))


def _hierarchical(_parameters: FilterParameters) -> Threshold:
    # Divided by the size of a cluster: the largest rejects most.
    values = dict.fromkeys(int(value) for value in reversed(decades(0, 4)))
    return scaled('hierarchical.min_cluster', values, lambda value: 1 / value)


def _lof(parameters: FilterParameters) -> Threshold:
    if parameters.value('lof.statistic') == 'lof2':
        return plain('lof.threshold', decades(-3, 3))
    # The factor of an inlier is 1: values are spaced by their excess over it.
    return plain('lof.threshold', (round(1 + more, 6) for more in decades(-2, 3)))


def _sor(parameters: FilterParameters) -> Threshold:
    statistic = parameters.value('sor.statistic')
    if statistic == 'sor2':
        return plain('sor.limit', decades(-4, 3))
    if statistic == 'sor':
        return Threshold('sor.multiplier', (0.0, *decades(-1, 3)), float, _deviations)
    if not parameters.value('sor.range_scaled'):
        return plain('sor.radius', decades(-3, 3))
    return Threshold('sor.radius', tuple(decades(-3, 3)), float, _distance_if_beyond)


def _deviations(score_of: ScoreOf, _near: float) -> Reals:
    """Return m of d = μ + m σ: two runs give it."""
    import numpy as np

    at_0 = score_of({'sor.multiplier': 0.0}).astype(np.float64)  # d / μ
    at_1 = score_of({'sor.multiplier': 1.0}).astype(np.float64)  # d / (μ + σ)
    with np.errstate(divide='ignore', invalid='ignore'):
        spread = at_0 / at_1 - 1  # σ / μ
        result: Reals = (at_0 - 1) / spread
    return result


def _distance_if_beyond(score_of: ScoreOf, _near: float) -> Reals:
    """Return distances: rejected beyond the larger of radius and range_factor × range."""
    import numpy as np

    beyond = score_of({'sor.radius': SMALLEST_RADIUS, 'sor.range_scaled': True}) > 1
    return np.where(beyond, score_of({'sor.radius': 1.0, 'sor.range_scaled': False}), 0.0)


def _inverse(name: str, values: Iterable[float]) -> Threshold:
    """Make a threshold that the score is proportional to; ``values`` ascend."""
    return scaled(name, reversed([*values]), lambda value: 1 / value)


_THRESHOLDS: dict[str, Callable[[FilterParameters], Threshold]] = {
    'alpha_beta_gamma': lambda _: significance('alpha_beta_gamma.significance'),
    # Compared with a sum of logarithms: even steps.
    'boosted_trees': lambda _: plain('boosted_trees.threshold', [n / 50 for n in range(5, 151)]),
    'dual_return': lambda _: plain(
        'dual_return.distance_ratio', (round(1 + more, 6) for more in decades(-3, 1))
    ),
    'elevation': _elevation,
    'field_range': lambda _: _inverse('field_range.max_range', decades(-3, 3)),
    'hierarchical': _hierarchical,
    'lof': _lof,
    'mixed_pixels': lambda _: plain('mixed_pixels.threshold', [n / 50 for n in range(5, 151)]),
    'quadric': lambda _: significance('quadric.significance'),
    'ring_outlier': lambda _: _inverse('ring_outlier.object_length_threshold', decades(-3, 3)),
    'scan_shadows': lambda _: _inverse('scan_shadows.min_angle', [*range(1, 90)]),
    'sor': _sor,
}
