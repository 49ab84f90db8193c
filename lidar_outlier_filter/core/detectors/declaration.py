# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What a detector declares of itself.

Everything else follows from the declaration: what ``chain`` may hold, the bits of a verdict, what
is read of a cloud, what is compiled, what the tuner tries, what is judged in tiles, the reasons,
the tables and the colours. It is read wherever parameters are: so its functions import what
computes when they are called.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from lidar_outlier_filter.annotations import Bools, Floats, Ints
    from lidar_outlier_filter.core.detectors.dials import Dial, Threshold
    from lidar_outlier_filter.core.detectors.explanation import Explanation
    from lidar_outlier_filter.core.detectors.scores import Scores
    from lidar_outlier_filter.core.detectors.seen import Seen
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
class Kernels:
    """What it takes to compile a detector.

    Attributes
    ----------
    seconds : int
        Of a processor, about, beside those of the kernels that all detectors share.
    parts : names of packages or modules beside the declaration, and the seconds of their kernels
        Where not all clouds need the same; the first one that a module is in counts.
    by_sensor : of the parameters of the filter
        Whether each kind of sensor has kernels of its own.
    more : parameters whose kernels ``compile`` makes too, beside those of the defaults

    """

    seconds: int = 0
    parts: Sequence[tuple[str, int]] = ()
    by_sensor: Callable[[FilterParameters], bool] = lambda _: False
    more: Sequence[Mapping[str, object]] = ()


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
    colour : str
        '#rrggbb', in pictures.
    rejects : str
        Continues "a point is rejected that …".
    source : str
        Where it was published.
    dials : what the tuner tries beside it, which may depend on other parameters
    neighbours : length of the lists of neighbours that it asks for; 0: of none
    needs_lines : bool
        Whether it works along scan lines, so that points without lines cannot be judged.
    uses_lines : bool
        Whether it works along scan lines where there are some.
    wants_rings : of the parameters
        Whether the rings of a cloud without scan lines are to be recovered for it.
    columns : what else it reads of a cloud, in the chain: ``intensity``; set: ``sigma``
        With the parameter that names the field; empty: its usual names.
    tiled : how it judges in tiles; None: it must see all points at once
    kernels : what it takes to compile it
    extra : names of bits beside its own, which say more of a rejected point
    explain : gives what explains its scores; None: nothing does
    further : parameters in sections of other names
    by_default : bool
        Whether it is the default chain.

    """

    name: str
    bit: int
    section: type[Section]
    detect: Callable[[Seen, FilterParameters], Scores]
    threshold: Callable[[FilterParameters], Threshold]
    colour: str
    rejects: str
    source: str
    dials: Callable[[FilterParameters], list[Dial]] = lambda _: []
    neighbours: Callable[[FilterParameters], int] = lambda _: 0
    needs_lines: bool = False
    uses_lines: bool = False
    wants_rings: Callable[[FilterParameters], bool] = lambda _: False
    columns: Mapping[Literal['sigma', 'intensity'], str] = field(default_factory=dict)
    tiled: Tiled | Measured | Reaching | None = None
    kernels: Kernels = Kernels()
    extra: Mapping[int, str] = field(default_factory=dict)
    explain: Callable[[], Explanation] | None = None
    further: Mapping[str, type[Section]] = field(default_factory=dict)
    by_default: bool = False

    @property
    def sections(self) -> dict[str, type[Section]]:
        """All its parameters, by the first part of their names."""
        return {self.name: self.section, **self.further}

    @property
    def home(self) -> str:
        """The package of its parameters, or the module where that is of none."""
        module = self.section.__module__
        return module.rpartition('.')[0] or module
