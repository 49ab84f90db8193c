# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The search space of a chain: the threshold of each detector, and the settings to try with it."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.core.detectors.thresholds import Threshold
from lidar_outlier_filter.core.detectors.thresholds import threshold as find_threshold
from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.filter import FilterParameters, describe

Values = Mapping[str, Any]  # of parameters, by their names
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

    """
    requested, flat = dict(requested or {}), parameters.flat()
    known = {item.name: item for item in describe()}
    kept = {name: flat.get(name) for name in kept}
    for name in (*requested, *kept):
        if name not in known or name.partition('.')[0] not in parameters.chain:
            must_be = f'those of {", ".join(parameters.chain)}'
            raise ParameterError('the parameters to search', must_be, repr(name))
        if known[name].fixed:  # the points are read once
            must_be = 'those that can change after the start'
            raise ParameterError('the parameters to search', must_be, repr(name))
    if both := requested.keys() & kept:
        raise ParameterError(both.pop(), 'searched or kept', 'both')
    tried = {name: tuple(map(known[name].check, values)) for name, values in requested.items()}
    tried |= {name: (value,) for name, value in kept.items()}
    return [_search(detector, parameters, tried) for detector in parameters.chain]


def _search(detector: str, parameters: FilterParameters, tried: Mapping[str, Any]) -> Search:
    """List what to search for one detector, with the values that a user wants instead."""
    threshold = find_threshold(DETECTORS[detector], parameters)
    if threshold is None:
        raise ParameterError(f'a parameter of {detector}', 'a float, to be swept', 'none')
    tried = {name: one for name, one in tried.items() if name.partition('.')[0] == detector}
    if threshold.name in tried:
        values = sorted(tried.pop(threshold.name), key=threshold.critical)
        threshold = replace(threshold, values=tuple(values))
    grids = [grid for grid in _grids(detector, parameters) if not tried.keys() & grid[0].keys()]
    grids += [_each(name, values) for name, values in tried.items()]
    settings = []
    for chosen in product(*grids):
        setting = {name: value for part in chosen for name, value in part.items()}
        try:
            parameters.changed({**setting, 'chain': [detector], 'vote': 0})
        except ParameterError:
            continue
        settings.append(setting)
    if not settings:
        raise ParameterError(f'the settings of {detector}', 'possible together', 'none')
    return Search(detector, threshold, tuple(settings))


def _each(name: str, values: Iterable[object]) -> Grid:
    """Make a grid of the values of one parameter."""
    return tuple({name: value} for value in values)


def _grids(detector: str, parameters: FilterParameters) -> list[Grid]:
    """List what is tried with each threshold; nothing for trees, whose weights are trained."""
    value = parameters.value
    to_ground, patch = value('elevation.against') == 'ground', value('quadric.window') == 'patch'
    radius = value('sor.statistic') == 'radius'
    # Under sor2 the limit is multiplied by range_factor, and is searched itself.
    scaled = value('sor.range_scaled') and value('sor.statistic') != 'sor2'
    found: dict[str, list[Grid]] = {
        'alpha_beta_gamma': [
            tuple(
                {'alpha_beta_gamma.before': n, 'alpha_beta_gamma.after': n}
                for n in (3, 4, 5, 7, 10, 15)
            ),
            _each('alpha_beta_gamma.order', (1, 2)),
            _each('alpha_beta_gamma.sides', ('either', 'both')),
        ],
        'elevation': [
            _each('elevation.depth_counts', (10, 20, 50, 100))
            if to_ground
            else _each('elevation.k', (10, 20, 30, 60))
        ],
        'hierarchical': [
            _each('hierarchical.global_confidence', (0.9, 0.99, 0.999)),
            _each('hierarchical.local_confidence', (0.8, 0.95, 0.99)),
        ],
        'lof': [_each('lof.min_pts', NEIGHBOURS)],
        'quadric': [
            _each('quadric.k', (15, 20, 30, 50))
            if patch
            else _each('quadric.section', (32, 64, 128, 256)),
            _each('quadric.surfaces', (1, 3)),
        ],
        'sor': [
            _each('sor.min_neighbors', (1, 2, *NEIGHBOURS[:4]))
            if radius
            else _each('sor.k', NEIGHBOURS),
            *(
                [_each('sor.range_factor', (0.005, 0.01, 0.02, 0.03, 0.05, 0.1, 0.2))]
                * bool(scaled)
            ),
        ],
    }
    return found.get(detector, [])
