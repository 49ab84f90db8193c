# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The quadric detector as textbook loops: the slow twin that the fast one is compared with.

Nothing of the package is imported here, so that no mistake can be shared. Equation numbers are
those of Leslar, Wang and Hu, "A comparison of two new methods of outlier detection for mobile
terrestrial lidar data" (2010), section 2.2. Points are (3,) arrays.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from math import ceil, inf, nan, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f, t

Floats = NDArray[np.float64]
Members = list[int]

RUN, SHARE, CONCENTRATIONS, BLUNT = 16, 0.3, 2, 0.01
PASSES, ADJUSTMENTS, CONVERGED, MIN_VARIANCE, SINGULAR = 30, 10, 1e-6, 0.01, 1e-12
GAP, CURVED, THICK, LIKE, TIGHT, PART = 4.0, 0.25, 0.2, 2.0, 1.5, 0.25
MARGIN, ENOUGH, SMALLEST, RIM = 0.25, 1.5, 2.0**-20, 3
PLANE, PARABOLOID, QUADRIC = 4, 7, 10


@dataclass
class Rules:
    """Significance of a test, least standard deviation in metres, and the other parameters."""

    significance: float = 1e-6
    floor: float = 0.005
    fewest: int = 12
    surfaces: int = 3
    always: bool = False


@dataclass
class Plane:
    """Axes (rows: normal, middle, long), mean and moments of weighted points."""

    axes: Floats
    mean: Floats
    moments: Floats
    weight: float


@dataclass
class Step:
    """Solution of (29): δa, its cofactor Q, and the weighted squares before and after."""

    change: Floats
    cofactor: Floats
    before: float
    after: float


@dataclass
class Fit:
    """A surface fitted to some points, and what it says of all: v, σ², slope, B Q Bᵀ."""

    size: int
    kept: Members
    residual: Floats
    sigma2: Floats
    slope: Floats
    lever: Floats
    a: Floats
    test: Floats


# Models -------------------------------------------------------------------------------------------


def row(p: Floats, r: float) -> Floats:
    """B (23), its columns so ordered that the first 4 and 7 are models too; products times r."""
    x, y, z = p
    return np.array([1, x, y, z, x * x, r * x * y, y * y, r * x * z, r * y * z, z * z])


def gradient(a: Floats, p: Floats, r: float) -> Floats:
    """Return A (25)-(27)."""
    x, y, z = p
    return np.array(
        [
            a[1] + 2 * a[4] * x + r * a[5] * y + r * a[7] * z,
            a[2] + 2 * a[6] * y + r * a[5] * x + r * a[8] * z,
            a[3] + 2 * a[9] * z + r * a[7] * x + r * a[8] * y,
        ]
    )


def fit_plane(points: Floats, weights: Floats) -> Plane:
    """Plane of the least weighted squares of distances."""
    mean = sum(w * p for w, p in zip(weights, points, strict=True)) / sum(weights)
    moments = sum(w * np.outer(p - mean, p - mean) for w, p in zip(weights, points, strict=True))
    values, vectors = np.linalg.eigh(moments)
    return Plane(vectors.T, mean, np.maximum(values, 0), float(sum(weights)))


def is_plane(plane: Plane, floor: float) -> bool:
    """Return a plane from a line."""
    return bool(plane.moments[1] > floor**2 * plane.weight)


def heights(plane: Plane, points: Floats) -> Floats:
    """Distances of points from a plane, with sign."""
    return np.array([plane.axes[0] @ (p - plane.mean) for p in points])


def measure_plane(plane: Plane, points: Floats, variance: Floats) -> Fit:
    """Residuals, variances and levers under a plane: height and two tilts, uncorrelated."""
    _, middle, long = plane.axes
    lever = [
        1 / plane.weight
        + (middle @ (p - plane.mean)) ** 2 / plane.moments[1]
        + (long @ (p - plane.mean)) ** 2 / plane.moments[2]
        for p in points
    ]
    return Fit(
        PLANE,
        [],
        heights(plane, points),
        variance,
        np.ones(len(points)),
        np.array(lever),
        np.zeros(10),
        np.zeros(0),
    )


class Frame:
    """Points in the frame of a plane: x along, y across, z up; the models above a plane."""

    def __init__(self, plane: Plane, points: Floats, variance: Floats) -> None:
        """Turn points and variances."""
        turn = plane.axes[::-1]
        self.root = sqrt(2)
        self.points = np.array([turn @ (p - plane.mean) for p in points])
        self.variance = variance
        self.rows = np.array([row(p, self.root) for p in self.points])

    def spread(self, a: Floats, kept: Members) -> tuple[Floats, Floats]:
        """Slopes, and variances (30), which are held at a hundredth of their mean."""
        steep = [gradient(a, p, self.root) for p in self.points]
        sigma2 = np.array([d * (g @ g) for g, d in zip(steep, self.variance, strict=True)])
        least = MIN_VARIANCE * np.mean(sigma2[kept])
        return np.array([sqrt(g @ g) for g in steep]), np.maximum(sigma2, least)

    def step(self, a: Floats, weights: Floats, size: int) -> Step | None:
        """Solve (29) under aᵀ δa = 0; None if it is ambiguous."""
        rows = self.rows[:, :size]
        normal = sum(w * np.outer(b, b) for w, b in zip(weights, rows, strict=True))
        largest = max(np.diag(normal))
        bordered = np.zeros((size + 1, size + 1))
        bordered[:size, :size] = normal
        bordered[:size, size] = bordered[size, :size] = a[:size] * largest
        if np.linalg.cond(bordered) > 0.1 / SINGULAR:
            return None
        cofactor = np.asarray(np.linalg.inv(bordered)[:size, :size], np.float64)
        slope = normal @ a[:size]
        change = -cofactor @ slope
        before = a[:size] @ slope
        return Step(change, cofactor, before, max(before + slope @ change, 0.0))

    def adjust(self, a: Floats, kept: Members, size: int) -> Fit | None:
        """Adjust from a until it stands."""
        a = a.copy()
        solution = None
        for _ in range(ADJUSTMENTS):
            _, sigma2 = self.spread(a, kept)
            weights = np.array([1 / s if i in kept else 0.0 for i, s in enumerate(sigma2)])
            solution = self.step(a, weights, size)
            if solution is None:
                return None
            a[:size] += solution.change
            a /= sqrt(a @ a)
            if max(abs(solution.change)) < CONVERGED:
                break
        assert solution is not None
        slope, sigma2 = self.spread(a, kept)
        lever = np.array([b[:size] @ solution.cofactor @ b[:size] for b in self.rows])
        return Fit(size, kept, self.rows @ a, sigma2, slope, lever, a, np.zeros(0))

    def algebraic(self, kept: Members) -> tuple[Floats, float]:
        """Eigenvector of the least eigenvalue (19), and the gap to the second."""
        _, vectors = np.linalg.eigh(self.rows[kept].T @ self.rows[kept])
        far = []
        for a in vectors.T[:2]:
            slope, _ = self.spread(a, kept)
            far.append(sum((self.rows[kept] @ a) ** 2) / sum(slope[kept] ** 2))
        # Of points exactly on a plane the best is z² = 0, which has no slope: there is no gap.
        with np.errstate(divide='ignore', invalid='ignore'):
            return vectors[:, 0], far[1] / far[0]


# Tests --------------------------------------------------------------------------------------------


@dataclass
class Growth:
    """Least standard deviation; noise and freedom of the first surface, if they hold this one."""

    floor: float
    noise: float = inf
    freedom: int = 0


def scores_of(fit: Fit, rules: Rules, growth: Growth) -> Floats | None:
    """T (31) ÷ its critical value, of all points."""
    kept = fit.kept
    freedom = len(kept) - (fit.size - 1)
    if freedom < 1:
        return None
    squares = sum(fit.residual[i] ** 2 / fit.sigma2[i] for i in kept) / freedom
    if growth.freedom:
        unit = sum(fit.slope[i] ** 2 / fit.sigma2[i] for i in kept) / len(kept)
        least = growth.noise**2 * unit
        squares = min(max(squares, least), TIGHT**2 * least)
        freedom += growth.freedom
    if freedom < 2:
        return None
    apart = not rules.always and not growth.freedom
    scores = []
    for i, v in enumerate(fit.residual):
        if i in kept and apart:
            # σ̂0 without the point's own part
            degrees, q = freedom - 1, fit.sigma2[i] - fit.lever[i]
            variance = max(squares * freedom * q - v**2, 0.0) / degrees
        else:
            degrees, q = freedom, fit.sigma2[i] + (-1 if i in kept else 1) * fit.lever[i]
            variance = squares * q
        variance = max(variance, (growth.floor * fit.slope[i]) ** 2)
        statistic = sqrt(v**2 / variance) if v else 0.0
        scores.append(statistic / two_sided(rules.significance, degrees))
    return np.array(scores)


def deviation(fit: Fit) -> float:
    """Return the standard deviation of the kept points' distances."""
    squares = sum((fit.residual[i] / fit.slope[i]) ** 2 for i in fit.kept if fit.slope[i] > 0)
    return sqrt(squares / max(len(fit.kept) - (fit.size - 1), 1))


def is_better(before: float, after: float, freedom: int, rules: Rules) -> bool:
    """F test of three more parameters."""
    if freedom < 1:
        return False
    ratio = three_more(rules.significance, freedom)
    return bool((before - after) / 3 > ratio * after / freedom)


@cache
def two_sided(significance: float, freedom: int) -> float:
    """Quantile of t that is exceeded, to either side, with this probability."""
    return float(t.isf(significance / 2, freedom))


@cache
def three_more(significance: float, freedom: int) -> float:
    """Quantile of F, for three more parameters, that is exceeded with this probability."""
    return float(f.isf(significance, 3, freedom))


def is_flat(fit: Fit) -> bool:
    """Whether three of four points are close to the surface against its radius."""
    bend = 2 * sqrt(sum(fit.a[4:] ** 2))
    curved = sum(abs(fit.residual[i]) * bend > CURVED * fit.slope[i] ** 2 for i in fit.kept)
    return bool(4 * curved <= len(fit.kept))


# Growth -------------------------------------------------------------------------------------------


class Window:
    """The points of a window, centred and scaled."""

    def __init__(self, points: Floats, variance: Floats | None, rules: Rules) -> None:
        """Centre and scale; unit variances by default."""
        mean = sum(p - points[0] for p in points) / len(points)
        self.points = np.array([(p - points[0]) - mean for p in points])
        self.scale = sqrt(sum(p @ p for p in self.points) / len(points))
        if self.scale > 0:
            self.points /= self.scale
        self.variance = np.ones(len(points)) if variance is None else variance
        self.rules = rules
        self.frame: Frame | None = None

    def judge(self) -> list[float]:
        """Score all points."""
        n, rules = len(self.points), self.rules
        if not self.scale > 0:
            return [nan] * n
        floor = rules.floor / self.scale
        score = np.full(n, inf)
        left = list(range(n))
        noise, freedom = inf, 0
        for number in range(rules.surfaces):
            start = self.begin(left, floor) if len(left) >= rules.fewest else []
            if not start:
                break
            if number:
                fit = self.grow_another(start, left, Growth(floor, noise, freedom))
            else:
                fit = self.grow(start, left, Growth(floor))
                if fit is not None:
                    noise = max(deviation(fit), floor)
                    freedom = len(fit.kept) - (fit.size - 1)
            if fit is None or (not rules.always and noise > max(THICK, floor)):
                break
            score = np.minimum(score, fit.test)
            left = [i for i in range(n) if score[i] > 1]
        undecided = len(left) == n if rules.always else 3 * len(left) > n
        return [nan] * n if undecided else list(score)

    def begin(self, left: Members, floor: float) -> Members:
        """Choose the points that a surface begins with."""
        if self.rules.always:
            return left
        rank = min(len(left), max(self.rules.fewest, ceil(SHARE * len(left)))) - 1
        suggestions = [left]
        for k in range(0, len(left), RUN):
            run = left[k : k + RUN]
            if 2 * len(run) >= RUN:
                far = abs(heights(self.plane(run), self.points))
                reach = sorted(far[run])[len(run) // 2]
                suggestions.append([i for i in run if far[i] <= reach])
        best, chosen = inf, None
        for some in suggestions:
            plane = self.plane(some)
            near = sorted(abs(heights(plane, self.points[left])))[rank]
            if is_plane(plane, floor) and max(near, BLUNT * floor) < best:
                best, chosen = max(near, BLUNT * floor), plane
        if chosen is None:
            return []
        some = []
        for _ in range(CONCENTRATIONS):
            far = abs(heights(chosen, self.points))
            reach = sorted(far[left])[rank]
            some = [i for i in left if far[i] <= reach]
            chosen = self.plane(some)
        return some

    def plane(self, some: Members) -> Plane:
        """Plane of some points with unit weights."""
        return fit_plane(self.points[some], np.ones(len(some)))

    def grow(self, start: Members, left: Members, growth: Growth) -> Fit | None:
        """Grow a surface and raise its model as far as it pays."""
        if self.rules.always:
            self.frame = Frame(self.plane(start), self.points, self.variance)
            return self.grow_quadric(start, left, growth)
        plane = self.settle(start, left, PLANE, np.zeros(10), growth)
        if plane is None or deviation(plane) <= growth.floor:
            return plane
        bent = self.bend(plane)
        if bent is None:
            return plane
        paraboloid = self.settle(bent[0], left, PARABOLOID, bent[1], growth)
        if paraboloid is None:
            return plane
        if deviation(paraboloid) <= growth.floor:
            return paraboloid
        return self.rise(paraboloid, left, growth)

    def grow_quadric(self, start: Members, left: Members, growth: Growth) -> Fit | None:
        """Grow a quadric from the algebraic start; None if it is ambiguous."""
        assert self.frame is not None
        a, gap = self.frame.algebraic(start)
        if not gap > GAP and not self.rules.always:
            return None
        quadric = self.settle(start, left, QUADRIC, a, growth)
        if self.rules.always:
            return quadric
        return quadric if quadric is not None and is_flat(quadric) else None

    def rise(self, paraboloid: Fit, left: Members, growth: Growth) -> Fit:
        """Raise a paraboloid to a quadric, if it pays."""
        assert self.frame is not None
        kept = paraboloid.kept
        weights = np.zeros(len(self.points))
        weights[kept] = 1 / paraboloid.sigma2[kept]
        solution = self.frame.step(paraboloid.a, weights, QUADRIC)
        if solution is None or not is_better(
            solution.before, solution.after, len(kept) - 9, self.rules
        ):
            return paraboloid
        return self.grow_quadric(kept, left, growth) or paraboloid

    def grow_another(self, start: Members, left: Members, growth: Growth) -> Fit | None:
        """Grow one more surface, which is to be like the first."""
        for tried in (Growth(growth.floor), growth):
            fit = self.grow(start, left, tried)
            enough = fit is not None and len(fit.kept) >= PART * len(left)
            if fit is not None and enough and deviation(fit) <= LIKE * growth.noise:
                return fit
        return None

    def settle(
        self, kept: Members, left: Members, size: int, a: Floats, growth: Growth
    ) -> Fit | None:
        """Fit and test until nothing changes."""
        fit = None
        for number in range(PASSES):
            fit = self.fit(kept, size, a, growth.floor)
            scores = None if fit is None else scores_of(fit, self.rules, growth)
            if fit is None or scores is None:
                return None
            fit.test, a = scores, fit.a
            following = [i for i in left if scores[i] <= 1 and (i in kept or number < PASSES // 2)]
            if following == kept:
                return fit
            if len(following) < max(self.rules.fewest, size + 1):
                return None
            kept = following
        return fit

    def fit(self, kept: Members, size: int, a: Floats, floor: float) -> Fit | None:
        """Fit the model to some points."""
        if size != PLANE:
            assert self.frame is not None
            return self.frame.adjust(a, kept, size)
        plane = fit_plane(self.points[kept], 1 / self.variance[kept])
        if not is_plane(plane, floor):
            return None
        fit = measure_plane(plane, self.points, self.variance)
        fit.kept = kept
        self.frame = Frame(plane, self.points, self.variance)
        return fit

    def bend(self, plane: Fit) -> tuple[Members, Floats] | None:
        """Fit a paraboloid to all kept points, and to the best half; None if it is no better."""
        assert self.frame is not None
        up = np.eye(10)[3]
        kept, rules = plane.kept, self.rules
        half = (len(kept) + 1) // 2
        weights = np.zeros(len(self.points))
        weights[kept] = 1 / plane.sigma2[kept]
        solution = self.frame.step(up, weights, PARABOLOID)
        if solution is None:
            return None
        bent = is_better(solution.before, solution.after, len(kept) - 6, rules)
        a = up + np.append(solution.change, np.zeros(3))
        some = kept
        before = sum(sorted(plane.residual[kept] ** 2 / plane.sigma2[kept])[:half])
        after = inf
        for number in range(CONCENTRATIONS + 1):
            far = (self.frame.rows @ a) ** 2 / plane.sigma2
            reach = sorted(far[kept])[half - 1]
            some = [i for i in kept if far[i] <= reach]
            after = sum(sorted(far[kept])[:half])
            if number == CONCENTRATIONS:
                break
            weights = np.zeros(len(self.points))
            weights[some] = 1 / plane.sigma2[some]
            solution = self.frame.step(up, weights, PARABOLOID)
            if solution is None:
                return None
            a = up + np.append(solution.change, np.zeros(3))
        bent = bent or is_better(before, after, half - 6, rules)
        return (some, a / sqrt(a @ a)) if bent else None


def judge(points: Any, rules: Rules, variance: Any = None) -> list[float]:
    """Score the points (n, 3) of one window, whose variances are (n,) or None."""
    positions = np.asarray(points, float)
    if len(positions) < rules.fewest:
        return [nan] * len(positions)
    return Window(positions, variance, rules).judge()


# Windows ------------------------------------------------------------------------------------------


def section_window(points: Floats, first: int, last: int, section: int) -> Members:
    """Points of the window of the core ``first`` to ``last``, not included."""
    low, high = points[first:last].min(axis=0), points[first:last].max(axis=0)
    most = max(points.max(axis=0) - points.min(axis=0))
    extent = max(high - low)
    margin = MARGIN * extent if extent > 0 else SMALLEST * most
    enough = min(len(points), max(section, int(ENOUGH * (last - first))))
    while True:
        found = [
            i for i, p in enumerate(points) if all(low - margin <= p) and all(p <= high + margin)
        ]
        if len(found) >= enough or margin > most:
            break
        margin *= 2
    rim = [i for i in found if not first <= i < last]
    stride = max(1, ceil(len(rim) / (RIM * section)))
    return sorted([*rim[::stride], *range(first, last)])


def sections(
    points: Any, cores: Sequence[tuple[int, int]], section: int, rules: Rules, variance: Any = None
) -> list[float]:
    """Score points in tree order, by the ranges of the cores."""
    positions = np.asarray(points, float)
    own = [nan] * len(positions)
    others: list[list[float]] = [[] for _ in positions]
    for first, last in cores:
        window = section_window(positions, first, last, section)
        scores = judge(positions[window], rules, None if variance is None else variance[window])
        for i, score in zip(window, scores, strict=True):
            if first <= i < last:
                own[i] = score
            elif score <= 1:
                others[i].append(score)
    scores = [
        score if score <= 1 or not other else min(other)
        for score, other in zip(own, others, strict=True)
    ]
    return shared(positions, scores)


def shared(positions: Floats, scores: Sequence[float]) -> list[float]:
    """Give coincident points the least of their scores; NaN does not count."""
    groups: dict[tuple[float, ...], list[float]] = {}
    for place, score in zip(positions, scores, strict=True):
        groups.setdefault(tuple(place + 0.0), []).append(score)
    return [float(np.fmin.reduce(groups[tuple(place + 0.0)])) for place in positions]


def patches(points: Any, order: Sequence[int], k: int, rules: Rules) -> list[float]:
    """Score points, each in the window of itself and its k nearest; these in tree order."""
    positions = np.asarray(points, float)
    rank = {int(i): position for position, i in enumerate(order)}
    result = []
    for i, p in enumerate(positions):
        squared = [(q - p) ** 2 for q in positions]
        nearest = sorted(
            range(len(positions)),
            key=lambda j: ((squared[j][0] + squared[j][1]) + squared[j][2], j),
        )
        others = [j for j in nearest if j != i]
        window = sorted([i, *others[:k]], key=rank.__getitem__)
        scores = judge(positions[window], rules)
        result.append(scores[window.index(i)])
    return shared(positions, result)
