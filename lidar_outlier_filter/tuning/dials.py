# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What to search for a chain: the thresholds and dials that its detectors declare."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.core.detectors.dials import each
from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.filter import describe

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from lidar_outlier_filter.core.detectors.dials import Dial, Threshold, Values
    from lidar_outlier_filter.parameters.filter import FilterParameters


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
    wanted : values to try, by parameter, instead of or beside those declared
    kept : parameters to leave as they are

    Raises
    ------
    ParameterError
        If a parameter is not one of a detector of the chain, shapes the points that are read, or is
        both searched and kept; or if none of its values makes sense.

    """
    wanted, kept = dict(wanted or {}), set(kept)
    known = {item.name: item for item in describe()}
    for name in (*wanted, *kept):
        if name not in known or name.partition('.')[0] not in parameters.chain:
            must_be = f'those of {", ".join(parameters.chain)}'
            raise ParameterError('the parameters to search', must_be, repr(name))
    for name in wanted:
        # The points are read once.
        if known[name].fixed:
            must_be = 'those that can change after the start'
            raise ParameterError('the parameters to search', must_be, repr(name))
        if name in kept:
            raise ParameterError(name, 'searched or kept', 'both')
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
    """Take what a detector declares, with what a user wants instead."""
    declared = DETECTORS[detector]
    threshold = declared.threshold(parameters)
    others = dict(wanted)
    if threshold.name in others:
        values = sorted(others.pop(threshold.name), key=threshold.critical)
        threshold = replace(threshold, values=tuple(values))
    dials = [
        dial
        for dial in declared.dials(parameters)
        if not any(name in others for setting in dial for name in setting)
    ]
    return threshold, dials + [each(name, values) for name, values in others.items()]


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
