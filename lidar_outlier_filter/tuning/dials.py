# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""THE table of what can be tuned: for each detector its threshold, and the settings to try.

A threshold is a parameter that divides a score and does nothing else to it, so that one run tells
what every value of it would reject. Where that holds only nearly (the smoother, the quadrics and
the witnesses look again without what they rejected), the tuner runs again at the value it found.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import ndtri

from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.filter import describe

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from lidar_outlier_filter.parameters.filter import FilterParameters

    Floats = NDArray[np.floating]
    Values = Mapping[str, object]
    ScoreOf = Callable[[Values], Floats]
    Statistic = Callable[[ScoreOf, float], Floats]

# Preferred numbers, E24: about 10 % apart, and short to write.
SERIES: tuple[float, ...] = (1.0, 1.1, 1.2, 1.3, 1.5, 1.6, 1.8, 2.0, 2.2, 2.4, 2.7, 3.0)
SERIES += (3.3, 3.6, 3.9, 4.3, 4.7, 5.1, 5.6, 6.2, 6.8, 7.5, 8.2, 9.1)
NEIGHBOURS = (3, 5, 7, 10, 15, 20, 30, 40, 50, 60, 70)
WINDOWS = (3, 4, 5, 7, 10, 15)


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
        return np.array([self.critical(value) for value in self.values])


Dial = tuple['Values', ...]  # settings that exclude each other


def decades(low: int, high: int) -> list[float]:
    """List the preferred numbers from 10^low to 10^high, ascending."""
    numbers = [float(f'{one}e{power}') for power in range(low, high) for one in SERIES]
    return [*numbers, float(f'1e{high}')]


def _scaled(name: str, critical: Callable[[float], float]) -> Statistic:
    def statistic(score_of: ScoreOf, near: float) -> Floats:
        # In double precision: the critical value of a wild threshold may be beyond float32.
        return score_of({name: near}).astype(np.float64) * critical(near)

    return statistic


def _plain(name: str, values: Iterable[float]) -> Threshold:
    """Make a threshold that is the critical value itself."""
    return Threshold(name, tuple(values), float, _scaled(name, float))


def _significance(name: str) -> Threshold:
    """Make a threshold that is a two-sided probability."""
    values = tuple(value for value in reversed(decades(-15, 0)) if value <= 0.1)  # noqa: PLR2004  a tenth of all is too much for any

    def critical(value: float) -> float:
        return float(-ndtri(value / 2))

    return Threshold(name, values, critical, _scaled(name, critical))


def _multiplier(name: str) -> Threshold:
    """Make SOR's threshold: d is compared with μ + m σ of its block, so two runs tell all m."""

    def statistic(score_of: ScoreOf, _near: float) -> Floats:
        at_0 = score_of({name: 0.0}).astype(np.float64)  # d / μ
        at_1 = score_of({name: 1.0}).astype(np.float64)  # d / (μ + σ)
        with np.errstate(divide='ignore', invalid='ignore'):
            spread = at_0 / at_1 - 1  # σ / μ
            return (at_0 - 1) / spread

    return Threshold(name, (0.0, *decades(-1, 3)), float, statistic)


def _radius(parameters: FilterParameters) -> Threshold:
    name = 'sor.radius'
    plain = _plain(name, decades(-3, 3))
    if not parameters.sor.range_scaled:
        return plain

    def statistic(score_of: ScoreOf, _near: float) -> Floats:
        # Rejected beyond the larger of radius and range_factor × range: beyond both.
        smallest = next(item.low for item in describe() if item.name == name)
        beyond = score_of({name: smallest, 'sor.range_scaled': True}) > 1
        distance = score_of({name: 1.0, 'sor.range_scaled': False})
        return np.where(beyond, distance, 0.0)

    return Threshold(name, plain.values, float, statistic)


def _lof(parameters: FilterParameters) -> Threshold:
    if parameters.lof.statistic == 'lof2':
        return _plain('lof.threshold', decades(-3, 3))
    # A factor of 1 is that of a good point: what counts is how much it is more.
    return _plain('lof.threshold', (round(1 + more, 6) for more in decades(-2, 3)))


def _sor(parameters: FilterParameters) -> Threshold:
    if parameters.sor.statistic == 'radius':
        return _radius(parameters)
    if parameters.sor.statistic == 'sor2':
        return _plain('sor.limit', decades(-4, 3))
    return _multiplier('sor.multiplier')


def _smallest_cluster(name: str) -> Threshold:
    """Make a threshold that is divided by the size of a cluster: the largest rejects most."""
    values = tuple(dict.fromkeys(int(value) for value in reversed(decades(0, 4))))

    def critical(value: float) -> float:
        return 1 / value

    return Threshold(name, values, critical, _scaled(name, critical))


def _evidence(_parameters: FilterParameters) -> Threshold:
    # A part of a sum of logarithms: even steps.
    return _plain('evidence.threshold', (round(0.02 * n, 2) for n in range(5, 151)))


def _each(name: str, values: Iterable[object]) -> Dial:
    return tuple({name: value} for value in values)


def _smoother_dials(_parameters: FilterParameters) -> list[Dial]:
    name = 'alpha_beta_gamma.'
    return [
        tuple({f'{name}before': n, f'{name}after': n} for n in WINDOWS),
        # The least that makes a prediction.
        tuple({f'{name}order': n, f'{name}min_window': n + 2} for n in (1, 2)),
        _each(f'{name}sides', ('either', 'both')),
    ]


def _quadric_dials(parameters: FilterParameters) -> list[Dial]:
    surfaces = _each('quadric.surfaces', (1, 3))
    if parameters.flat()['quadric.window'] == 'patch':
        return [_each('quadric.k', (15, 20, 30, 50)), surfaces]
    return [_each('quadric.section', (32, 64, 128, 256)), surfaces]


def _lof_dials(_parameters: FilterParameters) -> list[Dial]:
    return [_each('lof.min_pts', NEIGHBOURS)]


def _sor_dials(parameters: FilterParameters) -> list[Dial]:
    kind = parameters.sor.statistic
    name = 'sor.min_neighbors' if kind == 'radius' else 'sor.k'
    dials = [_each(name, (1, 2, *NEIGHBOURS[:4]) if kind == 'radius' else NEIGHBOURS)]
    # Under sor2 the limit is multiplied by it, and is searched itself.
    if parameters.sor.range_scaled and kind != 'sor2':
        dials.append(_each('sor.range_factor', (0.005, 0.01, 0.02, 0.03, 0.05, 0.1, 0.2)))
    return dials


def _hierarchical_dials(_parameters: FilterParameters) -> list[Dial]:
    name = 'hierarchical.'
    return [
        _each(f'{name}global_confidence', (0.9, 0.99, 0.999)),
        _each(f'{name}local_confidence', (0.8, 0.95, 0.99)),
    ]


def _elevation_dials(_parameters: FilterParameters) -> list[Dial]:
    return [_each('elevation.k', (10, 20, 30, 60))]


# Each detector's threshold and dials, which may depend on its other parameters.
TABLE: dict[
    str,
    tuple[
        Callable[[FilterParameters], Threshold],
        Callable[[FilterParameters], list[Dial]],
    ],
] = {
    'alpha_beta_gamma': (
        lambda _: _significance('alpha_beta_gamma.significance'),
        _smoother_dials,
    ),
    'quadric': (lambda _: _significance('quadric.significance'), _quadric_dials),
    'lof': (_lof, _lof_dials),
    'sor': (_sor, _sor_dials),
    'hierarchical': (
        lambda _: _smallest_cluster('hierarchical.min_cluster'),
        _hierarchical_dials,
    ),
    'elevation': (lambda _: _plain('elevation.multiplier', decades(-1, 3)), _elevation_dials),
    'evidence': (_evidence, lambda _: []),  # its weights are those of a regression
}


@dataclass(frozen=True)
class Search:
    """What to search for one detector.

    Attributes
    ----------
    detector : its name
    threshold : swept for every setting
    settings : parameters to set, all combinations that make sense

    """

    detector: str
    threshold: Threshold
    settings: tuple[Values, ...]


def searches(
    parameters: FilterParameters,
    wanted: Mapping[str, Sequence[object]] | None = None,
    kept: Iterable[str] = (),
) -> list[Search]:
    """List what to search for each detector of the chain.

    Parameters
    ----------
    parameters : what holds for all that is not searched
    wanted : values to try, by parameter, instead of or beside those of the table
    kept : parameters to leave as they are

    Raises
    ------
    ParameterError
        If a parameter is not one of a detector of the chain, or none of its values makes sense.

    """
    wanted, kept = dict(wanted or {}), set(kept)
    known = {item.name: item for item in describe()}
    for name in (*wanted, *kept):
        if name not in known or name.partition('.')[0] not in parameters.chain:
            must_be = f'those of {", ".join(parameters.chain)}'
            raise ParameterError('the parameters to search', must_be, repr(name))
    checked = {
        name: tuple(known[name].check(value) for value in values) for name, values in wanted.items()
    }
    for name in kept:
        checked[name] = (parameters.flat()[name],)
    found = []
    for detector in parameters.chain:
        mine = {n: v for n, v in checked.items() if n.partition('.')[0] == detector}
        threshold, dials = _of_detector(detector, parameters, mine)
        settings = tuple(_combinations(dials, parameters, detector))
        if not settings:
            raise ParameterError(f'the settings of {detector}', 'possible together', 'none')
        found.append(Search(detector, threshold, settings))
    return found


def _of_detector(
    detector: str, parameters: FilterParameters, wanted: Mapping[str, tuple[Any, ...]]
) -> tuple[Threshold, list[Dial]]:
    """Take a detector's row of the table, with what a user wants instead."""
    make_threshold, make_dials = TABLE[detector]
    threshold = make_threshold(parameters)
    others = dict(wanted)
    if threshold.name in others:
        values = sorted(others.pop(threshold.name), key=threshold.critical)
        threshold = replace(threshold, values=tuple(values))
    dials = [
        dial
        for dial in make_dials(parameters)
        if not any(name in others for setting in dial for name in setting)
    ]
    return threshold, dials + [_each(name, values) for name, values in others.items()]


def _combinations(
    dials: Sequence[Dial], parameters: FilterParameters, detector: str
) -> Iterable[Values]:
    """Yield the settings, one of each dial, that the parameters allow together."""
    for chosen in product(*dials):
        setting = {name: value for part in chosen for name, value in part.items()}
        try:
            parameters.changed({**setting, 'chain': [detector], 'vote': 0})
        except ParameterError:
            continue
        yield setting
