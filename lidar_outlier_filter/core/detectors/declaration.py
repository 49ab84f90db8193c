# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The declaration of a detector: its name, bit, parameters, score, and what it needs of a cloud.

Declarations are read wherever parameters are, so they import no kernel: ``score`` is named.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import cache
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from lidar_outlier_filter.annotations import Bools, Floats, Ints
    from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
    from lidar_outlier_filter.core.detectors.scores import Scores
    from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
    from lidar_outlier_filter.parameters.declaration import Section
    from lidar_outlier_filter.parameters.filter import FilterParameters


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

    def detect(self, seen: DetectorInput, parameters: FilterParameters) -> Scores:
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
        Gives what the measure of every point depends on, besides what is near it.
    measure : of coordinates (N, 3), metres, which of them are wanted, and what was prepared
        Gives (N,) float64, and within what distance of each point all else is that it depends on.
        What it gives of points that are not wanted means nothing.
    score : of the measures of all points
    reach : of nothing
        Gives two numbers, of neighbours and of steps: what a measure depends on is within so many
        steps, each to one of so many nearest places.

    """

    prepare: Callable[[Floats, Ints, FilterParameters], Any]
    measure: Callable[[Floats, Bools, Any, FilterParameters], tuple[Floats, Floats]]
    score: Callable[[Floats, FilterParameters], Scores]
    reach: Callable[[], tuple[int, int]]


@dataclass(frozen=True)
class Detector:
    """The declaration of one detector.

    Attributes
    ----------
    name : str
        As in ``chain``; its parameters are named ``name.parameter``.
    bit : int
        In ``outlier_detectors`` of recorded clouds. It never changes.
    section : class of its parameters
        The tuner sweeps the first that is a float, unless :mod:`.thresholds` names another.
    score : function of a :class:`.DetectorInput` and the filter's parameters
        Returns :class:`.Scores`. Or its name, 'module:function', which is imported on first use.
    rejects : str
        Completes "a point is rejected that …".
    neighbours : function of the filter's parameters
        Length of the neighbour lists that ``score`` needs; 0: none.
    lines : str
        ``'needs'`` scan lines: points without cannot be judged; ``'uses'`` them where known;
        ``'no'``.
    columns : function of the filter's parameters
        What else it reads of a cloud: ``'intensity'``; ``'ring'``: rings are recovered if needed.
    tiled : how it judges a cloud in tiles, or the name of that, 'module:object'
        None: it must see all points at once.

    """

    name: str
    bit: int
    section: type[Section]
    score: str | Callable[[DetectorInput, FilterParameters], Scores]
    rejects: str
    neighbours: Callable[[FilterParameters], int] = lambda _: 0
    lines: Literal['no', 'uses', 'needs'] = 'no'
    columns: Callable[[FilterParameters], Collection[str]] = lambda _: ()
    tiled: Tiled | Measured | Reaching | str | None = None

    def detect(self, seen: DetectorInput, parameters: FilterParameters) -> Scores:
        """Score every point."""
        scores: Scores = resolve(self.score)(seen, parameters)
        return scores

    @property
    def sections(self) -> dict[str, type[Section]]:
        """All its parameters, by the first part of their names."""
        return {self.name: self.section, **self.section.further}

    @property
    def home(self) -> str:
        """The package of its parameters, or their module if that is not in a package."""
        module = self.section.__module__
        return module.rpartition('.')[0] or module


def resolve(named: Any) -> Any:
    """Return an object, which may be named: 'module:object'."""
    return _imported(named) if isinstance(named, str) else named


_imported = cache(resolve_name)
