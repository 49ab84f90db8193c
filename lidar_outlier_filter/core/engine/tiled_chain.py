# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The chain on a cloud that is too large for one piece, with the answer of one piece.

Each detector goes over the whole cloud before the next one does, as in :class:`Chain`, in the way
that it declares:

``Tiled.BY_LINE``
    It judges each line by itself anyway: lines are taken some at a time.
``Measured``
    It measures each point by its nearest neighbours. In a tile with a halo, a point is measured
    right if no point beyond the halo could be one of them, or one of theirs; the few others, far
    from everything, are measured among just those neighbours, wherever they are. What is compared
    with all points (mean, median) is computed once all are measured.
``Reaching``
    The same, but it says itself how far away what the measure of each point depends on may be.
``Tiled.WITH_HALO``
    It is given a tile with its halo. Here, and only here, the verdict depends on the tiles: on
    their side alone, as tiles are aligned absolutely.

So for all but the last the scores are those of one piece, bit for bit, whatever the side.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from lidar_outlier_filter.core.detectors.declaration import Measured, Reaching, Tiled, resolve
from lidar_outlier_filter.core.detectors.distances import squared_k_distances
from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.engine.slow import watched
from lidar_outlier_filter.core.engine.tiles import ROUNDING, Tiles, distances_to_places
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.core.points import scan_lines
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.verdict import EXTRA, Verdict
from lidar_outlier_filter.errors import CloudError, ParameterError

if TYPE_CHECKING:
    from collections.abc import Callable

    from lidar_outlier_filter.annotations import Allocate, Bools, Floats, Ints
    from lidar_outlier_filter.core.detectors.declaration import Detector
    from lidar_outlier_filter.core.engine.slow import SaySlow
    from lidar_outlier_filter.parameters.filter import FilterParameters

HALO = 0.1  # of the side of a tile; of what is measured only the time depends on it
WIDEST = 4  # halo, in sides of a tile
MOST = 0.99  # of the points of a tile are to be measured in it
FAR_AT_ONCE = 10_000  # points
LINES_AT_ONCE = 1_000_000  # points, at least


class TiledChain:
    """The detectors of one set of parameters, for clouds that are judged in tiles."""

    def __init__(
        self,
        cloud: Points,
        parameters: FilterParameters,
        side: float,
        allocate: Allocate = np.empty,
        progress: Callable[[int, int], object] = lambda _done, _total: None,
        slow: SaySlow | None = None,
    ) -> None:
        """Sort the valid points of a cloud, whose coordinates may be a file, into tiles.

        Parameters
        ----------
        cloud : N points, invalid ones among them
        parameters : of the filter
        side : of a tile, metres
        allocate : gives an array of a shape, in memory or in a file, for a copy of the coordinates
        progress : is called with how many of how many points are done, all detectors together
        slow : is called while a detector takes too long

        Raises
        ------
        ParameterError
            If a detector of the chain needs all points at once.

        """
        for name in parameters.chain:
            if DETECTORS[name].tiled is None:
                raise ParameterError('chain', f'without {name} where there are tiles', name)
        self._cloud, self._parameters, self._progress = cloud, parameters, progress
        self._slow = slow
        self._tiles = Tiles(cloud.xyz, cloud.valid, side, allocate)
        self._done = 0

    def judge(self) -> Verdict:
        """Judge the cloud; the verdict is in its order, invalid points are untested."""
        parameters, tiles = self._parameters, self._tiles
        verdict = Verdict.beforehand(self._cloud)
        left = np.ones(len(tiles.order), np.bool_)
        for name in parameters.chain:
            detector = DETECTORS[name]
            with watched(name, parameters.max_delay, self._cloud, self._slow):
                found = self._detect(detector, left)
            verdict.add(detector.bit, tiles.order[left], found.take(left))
            if parameters.vote == 0:
                left &= ~(found.score > 1)
        verdict.settle(max(parameters.vote, 1))
        return verdict

    def _detect(self, detector: Detector, left: Bools) -> Scores:
        """Run a detector over what is left of the whole cloud."""
        way = resolve(detector.tiled)
        if isinstance(way, Measured | Reaching):
            measure = _Measure(detector, way, self._parameters)
            measure.prepare(self._cloud.xyz, self._tiles.order[left])
            return self._by_measure(measure, left)
        if way is Tiled.BY_LINE:
            return self._by_line(detector.name, left)
        return self._by_tile(detector.name, left)

    def _by_line(self, name: str, left: Bools) -> Scores:
        """Run a detector over the lines, some at a time."""
        where = np.sort(self._tiles.order[left])
        chain = self._alone(name)
        lines = Points(
            np.empty((len(where), 0)), self._cloud.t[where], self._cloud.line[where], left[left]
        )
        order = where[scan_lines.order_by_line(lines)]
        line = self._cloud.line[order]
        ends = np.append(np.flatnonzero(line[1:] != line[:-1]) + 1, len(order))
        verdict = Verdict.untested(len(self._cloud))
        begin = 0
        for end in ends.tolist():
            if end - begin >= LINES_AT_ONCE or end == len(order):
                part = np.sort(order[begin:end])
                verdict.put(part, chain.judge(self._cloud.take(part)))
                self._advance(end - begin)
                begin = end
        return _scores(verdict.take(self._tiles.order))

    def _by_tile(self, name: str, left: Bools) -> Scores:
        """Run a detector in each tile with its halo."""
        tiles, chain = self._tiles, self._alone(name)
        verdict = Verdict.untested(len(left))
        for tile in range(len(tiles)):
            part = tiles.part(tile)
            if left[part].any():
                indices, _ = self._around(tile, HALO * tiles.side, left)
                own = (indices >= part.start) & (indices < part.stop)
                found = chain.judge(self._cloud.take(tiles.order[indices]))
                verdict.put(indices[own], found.take(own))
            self._advance(part.stop - part.start)
        return _scores(verdict)

    def _by_measure(self, measure: _Measure, left: Bools) -> Scores:
        """Measure all points, tile by tile, and then compare with the limit, which all make."""
        tiles = self._tiles
        measured, radius = np.empty(len(self._cloud)), np.full(len(left), np.nan)
        halo, far = HALO * tiles.side, [np.empty(0, np.int64)]
        for tile in range(len(tiles)):
            part = tiles.part(tile)
            if left[part].any():
                halo, others = self._measure_tile(measure, tile, halo, left, measured, radius)
                far.append(others)
            self._advance(part.stop - part.start)
        self._measure_far(measure, np.concatenate(far), left, measured, radius)
        where = np.sort(tiles.order[left])
        found = measure.score(measured[where], lambda: self._cloud.range[where])
        rank = np.searchsorted(where, tiles.order[left])
        score = np.full(len(left), np.nan)
        score[left] = found.score[rank]
        if found.extra is None:
            return Scores(score)
        extra = np.zeros(len(left), np.uint16)
        extra[left] = found.extra[rank]
        return Scores(score, extra)

    def _measure_tile(
        self,
        measure: _Measure,
        tile: int,
        halo: float,
        left: Bools,
        measured: Floats,
        radius: Floats,
    ) -> tuple[float, Ints]:
        """Measure the points of a tile that can be measured in it and a halo.

        Returns
        -------
        halo : float
            The width that it took for nearly all points.
        far : (n,) int64
            Indices of the few that depend on others beyond, and are not measured yet.

        """
        tiles = self._tiles
        part = tiles.part(tile)
        indices, box = self._around(tile, halo, left)
        while True:
            own = (indices >= part.start) & (indices < part.stop)
            values, reach, seen = measure.take(tiles.xyz[indices], own)
            inwards = _to_edges(tiles.xyz[indices], box)
            fine = reach < inwards
            # As far as most points reach, on either side.
            most = float(np.quantile(reach[own], MOST, method='lower'))
            wider = min(2 * most, WIDEST * tiles.side)
            if wider <= halo or fine[own].mean() >= MOST:
                break
            more, wider_box = tiles.around(tile, wider, left)
            if len(more) > self._parameters.max_points:
                break
            indices, box, halo = more, wider_box, wider
        measured[tiles.order[indices[own & fine]]] = values[own & fine]
        known = own & (seen < inwards)
        radius[indices[known]] = seen[known]
        return halo, indices[own & ~fine]

    def _measure_far(
        self, measure: _Measure, far: Ints, left: Bools, measured: Floats, radius: Floats
    ) -> None:
        """Measure points that lie far from others, or from most, among those they depend on."""
        for begin in range(0, len(far), FAR_AT_ONCE):
            some = far[begin : begin + FAR_AT_ONCE]
            closed = self._tiles.closure(some, measure.k, measure.steps, left, radius)
            own = np.isin(closed, some)
            values, _, _ = measure.take(self._tiles.xyz[closed], own)
            measured[self._tiles.order[closed[own]]] = values[own]

    def _around(self, tile: int, halo: float, left: Bools) -> tuple[Ints, Floats]:
        """Find the points in a tile and a halo, which is narrower where it holds too many."""
        indices, box = self._tiles.around(tile, halo, left)
        if len(indices) > self._parameters.max_points:
            indices, box = self._tiles.around(tile, HALO * self._tiles.side, left)
        if len(indices) > self._parameters.max_points:
            must_be = f'at most max_points = {self._parameters.max_points}'
            raise CloudError('the number of points in a tile with its halo', must_be, len(indices))
        return indices, box

    def _alone(self, name: str) -> Chain:
        return Chain(self._parameters.changed({'chain': (name,), 'vote': 0}))

    def _advance(self, count: int) -> None:
        self._done += count
        self._progress(self._done, len(self._tiles.order) * len(self._parameters.chain))


class _Measure:
    """How a detector measures points by their nearest neighbours, and how far away these may be."""

    def __init__(
        self, detector: Detector, way: Measured | Reaching, parameters: FilterParameters
    ) -> None:
        if isinstance(way, Reaching):
            self.k, self.steps = way.reach()
        else:
            self.k, self.steps = detector.neighbours(parameters), way.steps
        self._way, self._parameters = way, parameters
        self._prepared: Any = None

    def prepare(self, xyz: Floats, where: Ints) -> None:
        """Look at all points that there are, where the measure depends on them."""
        if isinstance(self._way, Reaching):
            self._prepared = self._way.prepare(xyz, where, self._parameters)

    def take(self, xyz: Floats, own: Bools) -> tuple[Floats, Floats, Floats]:
        """Measure points, at least the own ones among them.

        Say how far each depends on others, and how far its k-th neighbour is; NaN: not known.
        """
        way, parameters = self._way, self._parameters
        if isinstance(way, Reaching):
            values, reach = way.measure(xyz, own, self._prepared, parameters)
            return values, reach * ROUNDING, np.full(len(xyz), np.nan)
        hood = Neighbourhood(xyz, self.k, parameters.threads)
        values, radius = way.measure(hood, parameters), self._radius(hood, way)
        return values, radius * (2**way.steps - 1), radius

    def score(self, measured: Floats, range_m: Callable[[], Floats]) -> Scores:
        if isinstance(self._way, Reaching):
            return self._way.score(measured, self._parameters)
        return self._way.score(measured, range_m, self._parameters)

    def _radius(self, hood: Neighbourhood, way: Measured) -> Floats:
        """Return the distance D of each point to its k-th nearest other, or a little more.

        The measure of p depends on nothing farther away than (2**steps - 1) D(p): around a
        neighbour o of p, within D(p) + D(p), there are p and the other neighbours of p, so
        D(o) <= 2 D(p); and so on with each step. Points that are not seen can only make D smaller.
        """
        if len(hood) <= self.k:
            return np.full(len(hood), np.inf)
        distance = np.empty(len(hood))
        distance[hood.order] = np.sqrt(squared_k_distances(hood, self.k))
        if way.by_place and not distance.all():
            # Coincident points are measured by the next places with points.
            points = np.empty((len(hood), 3))
            points[hood.order] = hood.xyz
            distance = distances_to_places(points, points, self.k)[:, self.k]
        return distance * ROUNDING


def _scores(verdict: Verdict) -> Scores:
    """Return what one detector found."""
    extra = verdict.detectors & np.uint16(EXTRA)
    return Scores(verdict.score.astype(np.float64), extra, reason=verdict.reason)


def _to_edges(xyz: Floats, box: Floats) -> Floats:
    """Return how far each point is from the nearest edge of a box in x and y."""
    x, y = xyz[:, 0], xyz[:, 1]
    across = np.minimum(x - box[0, 0], box[1, 0] - x)
    inwards = np.minimum(across, np.minimum(y - box[0, 1], box[1, 1] - y))
    # Differences of large coordinates are rounded.
    edges: Floats = inwards - 4 * np.spacing(np.abs(box).max())
    return edges
