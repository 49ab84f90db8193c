# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The chain: detectors in their order, each on what the earlier ones left, or all on everything."""

from collections import Counter
from collections.abc import Callable, Container, Hashable, Iterator, Sequence
from typing import Any

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats, Ints
from lidar_outlier_filter.core.detectors.declaration import Detector
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.engine.slow import SaySlow, watched
from lidar_outlier_filter.core.kernels.threads import keep_memory
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.parameters.filter import FilterParameters

TILE_HALO = 0.1  # of the side of a tile: the eight tiles around it cover the halo


def along_lines(chain: Sequence[str]) -> str:
    """Name the detectors of a chain that need scan lines, as text; empty if there are none."""
    return ', '.join(name for name in chain if DETECTORS[name].lines == 'needs')


def uses_lines(chain: Sequence[str]) -> bool:
    """Return whether any detector of a chain works along scan lines where there are some."""
    return any(DETECTORS[name].lines != 'no' for name in chain)


class Chain:
    """The detectors of one set of parameters."""

    def __init__(self, parameters: FilterParameters, *, whole: bool = False) -> None:
        """Choose the detectors that ``parameters.chain`` names.

        ``whole`` says that what is judged is a whole cloud, no part of a stream.
        """
        keep_memory()
        self.parameters = parameters
        self.whole = whole
        self.passes = 0  # the most that a detector has needed
        # Blocks by how a detector judged, where it can choose.
        self.methods: Counter[str] = Counter()
        self.see: Callable[..., DetectorInput] = DetectorInput
        self.kept: dict[Hashable, Any] = {}  # by detectors, from one block to the next
        self.tile = 0.0  # side, metres, of the tiles of detectors that judge in tiles; 0: none does
        self.slow: SaySlow | None = None  # is called while a detector takes too long
        self.scaled = True  # whether all scores so far were statistics ÷ critical value, no more
        self._detectors = [DETECTORS[name] for name in parameters.chain]
        # The lists that all detectors share are as long as the longest that one asks for.
        self.neighbours = max(1, *(one.neighbours(parameters) for one in self._detectors))

    def judge(self, points: Points) -> Verdict:
        """Judge valid points that lie together in time; the verdict is in their order."""
        parameters = self.parameters
        verdict = Verdict.untested(len(points))
        where = np.arange(len(points))
        seen = self.see(points, parameters, self.neighbours, whole=self.whole, kept=self.kept)
        for detector in self._detectors:
            with watched(detector.name, parameters.max_delay, seen.points, self.slow):
                found = self._score(detector, seen)
            verdict.add(detector.bit, where, found)
            self.passes = max(self.passes, found.passes)
            self.scaled &= found.scaled
            if found.method:
                self.methods[found.method] += 1
            # No detector follows the last one: its remaining points are not needed.
            if parameters.vote == 0 and detector is not self._detectors[-1]:
                rejected = found.score > 1
                if rejected.any():
                    where, seen = where[~rejected], seen.without(rejected)
        verdict.settle(max(parameters.vote, 1))
        return verdict

    def say_methods(
        self,
        inform: Callable[[str], object],
        warn: Callable[[str], object],
        known: Container[str] = (),
    ) -> None:
        """Say how the default judged, but for known methods; warn where others would be better."""
        for method in self.methods:
            if method not in known:
                (warn if ', because ' in method else inform)(f'judged by {method}')

    def _score(self, detector: Detector, seen: DetectorInput) -> Scores:
        """Score what one detector sees."""
        if not self.tile or detector.large != 'tiles':
            return detector.detect(seen, self.parameters)

        def detect(some: Points) -> Scores:
            seen = self.see(some, self.parameters, self.neighbours, whole=self.whole)
            return detector.detect(seen, self.parameters)

        return detect_in_tiles(detect, seen.points, self.tile, self.parameters.max_points)


def detect_in_tiles(
    detect: Callable[[Points], Scores], points: Points, side: float, max_points: int
) -> Scores:
    """Score the points of each tile among those of the tile and its halo.

    Tiles are aligned absolutely: tile (i, j) holds the points with floor(x / side) = i and
    floor(y / side) = j. So they depend on the coordinates alone.

    Parameters
    ----------
    detect : scores some of the points, which keep their order
    points : N points
    side : of a tile, metres
    max_points : of a tile with its halo

    Raises
    ------
    CloudError
        If a tile with its halo holds more points.

    """
    result = Scores(np.full(len(points), np.nan), np.zeros(len(points), np.uint16))
    for indices, own in tiles(points.xyz, side):
        if len(indices) > max_points:
            must_be = f'at most max_points = {max_points}'
            raise CloudError('the number of points in a tile with its halo', must_be, len(indices))
        found = detect(points.take(indices))
        result.score[indices[own]] = found.score[own]
        if found.extra is not None and result.extra is not None:
            result.extra[indices[own]] = found.extra[own]
    return result


def tiles(xyz: Floats, side: float) -> Iterator[tuple[Ints, Bools]]:
    """Yield the points of each tile and its halo, ascending, and which are in the tile itself."""
    # Complex numbers are sorted by their real part, then by the other.
    keys = np.floor(xyz[:, 0] / side) + 1j * np.floor(xyz[:, 1] / side)
    corners, number = np.unique(keys, return_inverse=True)
    order = np.argsort(number, kind='stable')
    parts = np.split(order, np.searchsorted(number[order], np.arange(1, len(corners))))
    tile_at = {corner: tile for tile, corner in enumerate(corners.tolist())}
    steps = [i + 1j * j for i in (-1, 0, 1) for j in (-1, 0, 1)]
    for tile, corner in enumerate(corners.tolist()):
        beside = [tile_at[corner + step] for step in steps if corner + step in tile_at]
        near = np.sort(np.concatenate([parts[other] for other in beside]))
        inside = np.ones(len(near), np.bool_)
        for axis, low in enumerate((corner.real * side, corner.imag * side)):
            values = xyz[near, axis]
            inside &= (values >= low - TILE_HALO * side) & (values <= low + side + TILE_HALO * side)
        own = number[near] == tile
        yield near[inside], own[inside]
