# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""All kernels as Python runs them, where numpy checks each index: a program.

Every detector judges small clouds, with each of its choices, and explains its scores. An index that
leaves its array ends the program with an IndexError; the kernels of detectors that nothing has
called it writes, one on a line. Nothing is compiled: that takes far longer than to compute so
little.
"""

import pkgutil
import sys
import warnings
from collections.abc import Callable, Iterator
from functools import wraps
from importlib import import_module
from typing import Any

import numba

known: set[str] = set()
called: set[str] = set()


def not_compiling(**_options: object) -> Callable[[Any], Any]:
    """Take the place of numba.njit."""

    def take(function: Callable[..., object]) -> Callable[..., object]:
        name = f'{function.__module__}.{function.__name__}'
        known.add(name)

        @wraps(function)
        def run(*arguments: object) -> object:
            called.add(name)
            return function(*arguments)

        return run

    return take


if __name__ == '__main__':  # who collects tests imports this file, too
    numba.njit = not_compiling  # type: ignore[assignment]

import numpy as np  # noqa: E402  nothing may have asked for a kernel before

from helpers import scans, shapes  # noqa: E402
from lidar_outlier_filter import core  # noqa: E402
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput  # noqa: E402
from lidar_outlier_filter.core.detectors.registry import DETECTORS, explanations  # noqa: E402
from lidar_outlier_filter.core.engine.chain import Chain  # noqa: E402
from lidar_outlier_filter.core.points.points import Points  # noqa: E402
from lidar_outlier_filter.parameters.declaration import walk  # noqa: E402
from lidar_outlier_filter.parameters.filter import FilterParameters  # noqa: E402

SIZES = (1, 7, 48)  # points of clouds that nobody has scanned


def settings(name: str) -> Iterator[dict[str, object]]:
    """Give the defaults of a detector, and each other choice that it has."""
    yield {}
    for item in walk(DETECTORS[name].section, f'{name}.'):
        for choice in item.choices:
            if choice not in {item.default, 'filterpy'}:  # which calls no kernel of ours
                yield {item.name: choice}


def clouds() -> Iterator[Points]:
    """Make clouds of few points, of both kinds of scanners, with what makes neighbours odd."""
    for make in shapes.CLOUDS:
        for size in SIZES if make is shapes.stacks else SIZES[-1:]:
            xyz = make(np.random.default_rng(size))[:size]
            t = np.arange(size) * 1000
            yield Points(xyz, t, np.arange(size) // 20, np.ones(size, np.bool_))
    yield scans.sweep(1, 0.1, columns=40)
    yield scans.sweep(2, 0.3, 1.4, columns=24, staggered=True)
    yield scans.Drive(1, 0.1, 3, 40).points
    yield scans.Drive(2, 0.5, 4, 30).points


def main() -> None:
    """Judge."""
    warnings.simplefilter('ignore')  # numpy's: kernels divide by zero, and may overflow
    for module in pkgutil.walk_packages(core.__path__, f'{core.__name__}.'):
        import_module(module.name)
    made, why = list(clouds()), explanations()
    for name in DETECTORS:
        for values in settings(name):
            given = {'chain': [name], 'scores': True, **values}
            parameters = FilterParameters().changed(given)
            # Other choices judge what scanners have seen, and the oddest neighbours.
            for points in made[-7:] if values else made:
                Chain(parameters).judge(points)
                if name in why and len(points) > 1:
                    seen = DetectorInput(points, parameters, 20)
                    every = np.ones(len(points), np.bool_)
                    why[name].contributions(seen, parameters, every)
    left = (name for name in known - called if name.startswith(f'{core.__name__}.detectors.'))
    sys.stdout.writelines(f'{name}\n' for name in sorted(left))


if __name__ == '__main__':
    main()
