# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The declaration of a detector: name, bit, parameters, score, and explanation of scores.

Declarations are read with parameters. They import no kernel: ``score`` is given by name.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from lidar_outlier_filter.core.annotations import Singles
    from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
    from lidar_outlier_filter.core.detectors.scores import Scores
    from lidar_outlier_filter.parameters.declaration import Section
    from lidar_outlier_filter.parameters.filter import FilterParameters


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
    field : function of the filter's parameters
        Name of the field that is ``points.field``; empty: none. One detector of a chain has one.
    large : str
        How it judges a cloud that is larger than memory. ``'files'``: in one piece, with its
        largest arrays in files; ``'tiles'``: each tile with a halo; ``'no'``: not at all.
    usual : float
        Share of the points that it rejects at most, as a rule: several times what it rejects in
        dry air. A node warns above it, as in heavy snow or where lines are misread.

    """

    name: str
    bit: int
    section: type[Section]
    score: str | Callable[[DetectorInput, FilterParameters], Scores]
    rejects: str
    neighbours: Callable[[FilterParameters], int] = lambda _: 0
    lines: Literal['no', 'uses', 'needs'] = 'no'
    columns: Callable[[FilterParameters], Collection[str]] = lambda _: ()
    field: Callable[[FilterParameters], str] = lambda _: ''
    large: Literal['files', 'tiles', 'no'] = 'no'
    usual: float = 1.0

    def detect(self, seen: DetectorInput, parameters: FilterParameters) -> Scores:
        """Score every point."""
        scores: Scores = resolve(self.score)(seen, parameters)
        return scores

    @property
    def lack(self) -> str:
        """What is missing where it could test no point."""
        if self.field is not Detector.field:
            return 'numbers in its field'
        return 'longer scan lines' if self.lines == 'needs' else 'more points'

    @property
    def home(self) -> str:
        """The package of its parameters, or their module if that is not in a package."""
        module = self.section.__module__
        return module.rpartition('.')[0] or module


class ReasonName(NamedTuple):
    """What a number in ``outlier_reason`` means: a name and a description."""

    name: str
    text: str


class Contributions(NamedTuple):
    """What features add to the scores of M points.

    Attributes
    ----------
    method : how they were judged, a name in ``METHODS`` of the explanation
    names : of the F features
    added : (F, M) float32
        To log-odds.

    """

    method: str
    names: tuple[str, ...]
    added: Singles


def resolve(named: Any) -> Any:
    """Return an object, which may be named: 'module:object'."""
    return _imported(named) if isinstance(named, str) else named


_imported = cache(resolve_name)
