# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The search space of a chain: the threshold of each detector, and the settings to try with it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.core.detectors.thresholds import threshold as find_threshold
from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.filter import describe

if TYPE_CHECKING:
    from lidar_outlier_filter.core.detectors.thresholds import Threshold
    from lidar_outlier_filter.parameters.filter import FilterParameters

Values = Mapping[str, object]  # of parameters, by their names
Grid = tuple[Values, ...]  # settings that exclude each other
NEIGHBOURS = (3, 5, 7, 10, 15, 20, 30, 40, 50, 60, 70)


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
    requested: Mapping[str, Sequence[object]] | None = None,
    kept: Iterable[str] = (),
) -> list[Search]:
    """List what to search for each detector of the chain.

    Parameters
    ----------
    parameters : what holds for all that is not searched
    requested : values to try, by parameter, instead of or beside those declared
    kept : parameters to leave as they are

    Raises
    ------
    ParameterError
        If a parameter is not one of a detector of the chain, shapes the points that are read, or is
        both searched and kept; or if none of its values makes sense.

    """
    requested, kept = dict(requested or {}), set(kept)
    known = {item.name: item for item in describe()}
    for name in (*requested, *kept):
        if name not in known or name.partition('.')[0] not in parameters.chain:
            must_be = f'those of {", ".join(parameters.chain)}'
            raise ParameterError('the parameters to search', must_be, repr(name))
    for name in requested:
        # The points are read once.
        if known[name].fixed:
            must_be = 'those that can change after the start'
            raise ParameterError('the parameters to search', must_be, repr(name))
        if name in kept:
            raise ParameterError(name, 'searched or kept', 'both')
    checked = {
        name: tuple(known[name].check(value) for value in values)
        for name, values in requested.items()
    }
    for name in kept:
        checked[name] = (parameters.flat()[name],)
    found = []
    for detector in parameters.chain:
        mine = {n: v for n, v in checked.items() if n.partition('.')[0] == detector}
        threshold, grids = _of_detector(detector, parameters, mine)
        settings = tuple(_combinations(grids, parameters, detector))
        if not settings:
            raise ParameterError(f'the settings of {detector}', 'possible together', 'none')
        found.append(Search(detector, threshold, settings))
    return found


def _of_detector(
    detector: str, parameters: FilterParameters, requested: Mapping[str, tuple[Any, ...]]
) -> tuple[Threshold, list[Grid]]:
    """Return the threshold and the grids of a detector, with the values that a user wants instead.

    Raises
    ------
    ParameterError
        If the detector has no threshold.

    """
    threshold = find_threshold(DETECTORS[detector], parameters)
    if threshold is None:
        raise ParameterError(f'a parameter of {detector}', 'a float, to be swept', 'none')
    others = dict(requested)
    if threshold.name in others:
        values = sorted(others.pop(threshold.name), key=threshold.critical)
        threshold = replace(threshold, values=tuple(values))
    grids = [
        grid
        for grid in _GRIDS.get(detector, _nothing)(parameters)
        if not any(name in others for setting in grid for name in setting)
    ]
    return threshold, grids + [_each(name, values) for name, values in others.items()]


def _combinations(
    grids: Sequence[Grid], parameters: FilterParameters, detector: str
) -> Iterable[Values]:
    """Yield the settings, one of each grid, that the parameters allow together."""
    for chosen in product(*grids):
        setting = {name: value for part in chosen for name, value in part.items()}
        try:
            parameters.changed({**setting, 'chain': [detector], 'vote': 0})
        except ParameterError:
            continue
        yield setting


def _each(name: str, values: Iterable[object]) -> Grid:
    """Make a grid of the values of one parameter."""
    return tuple({name: value} for value in values)


def _nothing(_parameters: FilterParameters) -> list[Grid]:
    return []


def _alpha_beta_gamma(_parameters: FilterParameters) -> list[Grid]:
    name = 'alpha_beta_gamma.'
    return [
        tuple({f'{name}before': n, f'{name}after': n} for n in (3, 4, 5, 7, 10, 15)),
        _each(f'{name}order', (1, 2)),
        _each(f'{name}sides', ('either', 'both')),
    ]


def _elevation(parameters: FilterParameters) -> list[Grid]:
    if parameters.value('elevation.against') == 'ground':
        return [_each('elevation.depth_counts', (10, 20, 50, 100))]
    return [_each('elevation.k', (10, 20, 30, 60))]


def _hierarchical(_parameters: FilterParameters) -> list[Grid]:
    return [
        _each('hierarchical.global_confidence', (0.9, 0.99, 0.999)),
        _each('hierarchical.local_confidence', (0.8, 0.95, 0.99)),
    ]


def _quadric(parameters: FilterParameters) -> list[Grid]:
    surfaces = _each('quadric.surfaces', (1, 3))
    if parameters.value('quadric.window') == 'patch':
        return [_each('quadric.k', (15, 20, 30, 50)), surfaces]
    return [_each('quadric.section', (32, 64, 128, 256)), surfaces]


def _sor(parameters: FilterParameters) -> list[Grid]:
    statistic = parameters.value('sor.statistic')
    name = 'sor.min_neighbors' if statistic == 'radius' else 'sor.k'
    grids = [_each(name, (1, 2, *NEIGHBOURS[:4]) if statistic == 'radius' else NEIGHBOURS)]
    # Under sor2 the limit is multiplied by it, and is searched itself.
    if parameters.value('sor.range_scaled') and statistic != 'sor2':
        grids.append(_each('sor.range_factor', (0.005, 0.01, 0.02, 0.03, 0.05, 0.1, 0.2)))
    return grids


# The weights of boosted_trees are trained, not searched.
_GRIDS: dict[str, Callable[[FilterParameters], list[Grid]]] = {
    'alpha_beta_gamma': _alpha_beta_gamma,
    'elevation': _elevation,
    'hierarchical': _hierarchical,
    'lof': lambda _: [_each('lof.min_pts', NEIGHBOURS)],
    'quadric': _quadric,
    'sor': _sor,
}
