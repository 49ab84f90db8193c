# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What a detector declares of itself.

Everything else follows from the declaration: what ``chain`` may hold, the bits of a verdict, what
the tuner tries, what is judged in tiles, the tables and the colours.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    from numpy.typing import NDArray

    from lidar_outlier_filter.core.detectors.dials import Dial, Threshold
    from lidar_outlier_filter.core.detectors.scores import Scores
    from lidar_outlier_filter.core.detectors.seen import Seen
    from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
    from lidar_outlier_filter.parameters.declaration import Section
    from lidar_outlier_filter.parameters.filter import FilterParameters

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int64]
    Bools = NDArray[np.bool_]


class Tiled(Enum):
    """How a detector judges a cloud that is too large for one piece."""

    BY_LINE = 'each scan line by itself, whatever tiles it crosses'
    WITH_HALO = 'each tile with its halo, so that the verdict depends on the tiles'


@dataclass(frozen=True)
class Measured:
    """A detector that measures each point by its nearest neighbours, and then compares all.

    In tiles it gives the verdict of the cloud in one piece, bit for bit.

    Attributes
    ----------
    measure : of a neighbourhood
        Gives (N,) float64 in the order of the points.
    score : of the measures of all points
        The second argument gives their distances from the sensor, metres, when it is called.
    steps : int
        Steps to a neighbour that lead to all that the measure of a point depends on.
    by_place : bool
        Whether points that coincide are measured by the nearest other places with points.

    """

    measure: Callable[[Neighbourhood, FilterParameters], Floats]
    score: Callable[[Floats, Callable[[], Floats], FilterParameters], Scores]
    steps: int
    by_place: bool = False

    def detect(self, seen: Seen, parameters: FilterParameters) -> Scores:
        """Detect in one piece."""
        measured = self.measure(seen.neighbourhood, parameters)
        return self.score(measured, lambda: seen.points.range, parameters)


@dataclass(frozen=True)
class Reaching:
    """A detector that measures each point by what is near it, and says how far it looked.

    In tiles it gives the verdict of the cloud in one piece, bit for bit.

    Attributes
    ----------
    prepare : of all coordinates, metres, and of which of them there are
        Gives a number that the measure of every point depends on.
    measure : of coordinates (N, 3), metres, which of them are wanted, and this number
        Gives (N,) float64, and within what distance of each point all else is that it depends on.
        What it gives of points that are not wanted means nothing.
    score : of the measures of all points
    neighbours, steps : int
        What a measure depends on is within so many steps, each to one of so many nearest places.

    """

    prepare: Callable[[Floats, Ints, FilterParameters], float]
    measure: Callable[[Floats, Bools, float, FilterParameters], tuple[Floats, Floats]]
    score: Callable[[Floats, FilterParameters], Scores]
    neighbours: int
    steps: int


def _none(_parameters: FilterParameters) -> int:
    return 0


def _no_dials(_parameters: FilterParameters) -> list[Dial]:
    return []


@dataclass(frozen=True)
class Detector:
    """One test: it gives every point a score.

    Attributes
    ----------
    name : str
        In ``chain``; its parameters are named ``name.parameter``.
    bit : int
        In ``outlier_detectors`` of recorded clouds. It never changes.
    section : class of its parameters
    detect : of what it sees, and the parameters of the filter
    threshold : what the tuner sweeps
    dials : what the tuner tries beside it, which may depend on other parameters
    neighbours : length of the lists of neighbours that it asks for; 0: of none
    needs_lines : bool
        Whether it works along scan lines, so that points without lines cannot be judged.
    uses_lines : bool
        Whether it works along scan lines where there are some.
    tiled : how it judges in tiles; None: it must see all points at once
    colour : str
        '#rrggbb', in pictures.
    rejects : str
        Continues "a point is rejected that …".
    source : str
        Where it was published.

    """

    name: str
    bit: int
    section: type[Section]
    detect: Callable[[Seen, FilterParameters], Scores]
    threshold: Callable[[FilterParameters], Threshold]
    colour: str
    rejects: str
    source: str
    dials: Callable[[FilterParameters], list[Dial]] = _no_dials
    neighbours: Callable[[FilterParameters], int] = _none
    needs_lines: bool = False
    uses_lines: bool = False
    tiled: Tiled | Measured | Reaching | None = None
