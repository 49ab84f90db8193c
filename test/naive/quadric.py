# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Reference implementation of the quadric detector in plain loops, for tests of its kernels.

It imports nothing from the package, so both cannot share an error. Equation numbers are
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

from naive.neighbours import nearest

Floats = NDArray[np.float64]
Members = list[int]

RUN, SHARE, CONCENTRATIONS, BLUNT = 16, 0.3, 2, 0.01
PASSES, ADJUSTMENTS, CONVERGED, MIN_VARIANCE, SINGULAR = 30, 10, 1e-6, 0.01, 1e-12
GAP, CURVED, THICK, LIKE, TIGHT, PART = 4.0, 0.25, 0.2, 2.0, 1.5, 0.25
MARGIN, ENOUGH, SMALLEST, RIM = 0.25, 1.5, 2.0**-20, 3
PLANE, PARABOLOID, QUADRIC = 4, 7, 10


@dataclass
class Rules:
    """Parameters: significance level of the tests, minimum standard deviation (metres), others."""

    significance: float = 1e-6
    min_sigma: float = 0.005
    min_points: int = 12
    max_surfaces: int = 3
    always_quadric: bool = False


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
    """A surface fitted to the kept points; v, σ², slope and lever B Q Bᵀ of every point."""

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
    """Return a row of B (23); its first 4 or 7 columns are smaller models. Products times r."""
    x, y, z = p
    return np.array([1, x, y, z, x * x, r * x * y, y * y, r * x * z, r * y * z, z * z])


def gradient(a: Floats, p: Floats, r: float) -> Floats:
    """Return the row of A (25)-(27)."""
    x, y, z = p
    return np.array(
        [
            a[1] + 2 * a[4] * x + r * a[5] * y + r * a[7] * z,
            a[2] + 2 * a[6] * y + r * a[5] * x + r * a[8] * z,
            a[3] + 2 * a[9] * z + r * a[7] * x + r * a[8] * y,
        ]
    )


def fit_plane(points: Floats, weights: Floats) -> Plane:
    """Fit a plane by weighted least squares of distances."""
    mean = sum(w * p for w, p in zip(weights, points, strict=True)) / sum(weights)
    moments = sum(w * np.outer(p - mean, p - mean) for w, p in zip(weights, points, strict=True))
    values, vectors = np.linalg.eigh(moments)
    return Plane(vectors.T, mean, np.maximum(values, 0), float(sum(weights)))


def is_plane(plane: Plane, floor: float) -> bool:
    """Return whether the points span a plane, and not only a line."""
    return bool(plane.moments[1] > floor**2 * plane.weight)


def heights(plane: Plane, points: Floats) -> Floats:
    """Return the signed distances of points from a plane."""
    return np.array([plane.axes[0] @ (p - plane.mean) for p in points])


def measure_plane(plane: Plane, points: Floats, variance: Floats) -> Fit:
    """Measure points against a plane, whose height and two tilts are uncorrelated."""
    _, middle, long = plane.axes
    lever = [
        1 / plane.weight
        + (middle @ (p - plane.mean)) ** 2 / plane.moments[1]
        + (long @ (p - plane.mean)) ** 2 / plane.moments[2]
        for p in points
    ]
    fit = heights(plane, points), variance, np.ones(len(points)), np.array(lever)
    return Fit(PLANE, [], *fit, np.zeros(10), np.zeros(0))


class Frame:
    """Points in the frame of a plane (z: its normal), for paraboloids and quadrics."""

    def __init__(self, plane: Plane, points: Floats, variance: Floats) -> None:
        """Rotate the points into the frame."""
        rotation = plane.axes[::-1]
        self.root = sqrt(2)
        self.points = np.array([rotation @ (p - plane.mean) for p in points])
        self.variance = variance
        self.rows = np.array([row(p, self.root) for p in self.points])

    def spread(self, a: Floats, kept: Members) -> tuple[Floats, Floats]:
        """Return slopes, and variances (30), which are at least 1 % of their mean."""
        gradients = [gradient(a, p, self.root) for p in self.points]
        sigma2 = np.array([d * (g @ g) for g, d in zip(gradients, self.variance, strict=True)])
        minimum = MIN_VARIANCE * np.mean(sigma2[kept])
        return np.array([sqrt(g @ g) for g in gradients]), np.maximum(sigma2, minimum)

    def step(self, a: Floats, weights: Floats, size: int) -> Step | None:
        """Solve (29) under aᵀ δa = 0; None if the matrix is singular."""
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
        """Iterate (29) from a until it converges; None if a step fails."""
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
        """Return the eigenvector of the smallest eigenvalue (19), and its gap to the second."""
        _, vectors = np.linalg.eigh(self.rows[kept].T @ self.rows[kept])
        mean_squares = []
        for a in vectors.T[:2]:
            slope, _ = self.spread(a, kept)
            mean_squares.append(sum((self.rows[kept] @ a) ** 2) / sum(slope[kept] ** 2))
        # Points exactly on a plane give z² = 0, whose slope is 0: the gap is NaN.
        with np.errstate(divide='ignore', invalid='ignore'):
            return vectors[:, 0], mean_squares[1] / mean_squares[0]


# Tests --------------------------------------------------------------------------------------------


@dataclass
class Growth:
    """Minimum σ; σ and degrees of freedom of the first surface, if they bound this one."""

    floor: float
    noise: float = inf
    freedom: int = 0


def scores_of(fit: Fit, rules: Rules, growth: Growth) -> Floats | None:
    """Return T (31) ÷ its critical value for every point; None without degrees of freedom."""
    kept = fit.kept
    freedom = len(kept) - (fit.size - 1)
    if freedom < 1:
        return None
    squares = sum(fit.residual[i] ** 2 / fit.sigma2[i] for i in kept) / freedom
    if growth.freedom:
        unit = sum(fit.slope[i] ** 2 / fit.sigma2[i] for i in kept) / len(kept)
        minimum = growth.noise**2 * unit
        squares = min(max(squares, minimum), TIGHT**2 * minimum)
        freedom += growth.freedom
    if freedom < 2:
        return None
    leaves_out = not rules.always_quadric and not growth.freedom
    scores = []
    for i, v in enumerate(fit.residual):
        if i in kept and leaves_out:
            # σ̂0 of the other points
            degrees, q = freedom - 1, fit.sigma2[i] - fit.lever[i]
            variance = max(squares * freedom * q - v**2, 0.0) / degrees
        else:
            degrees, q = freedom, fit.sigma2[i] + (-1 if i in kept else 1) * fit.lever[i]
            variance = squares * q
        variance = max(variance, (growth.floor * fit.slope[i]) ** 2)
        statistic = sqrt(v**2 / variance) if v else 0.0
        scores.append(statistic / t_quantile(rules.significance, degrees))
    return np.array(scores)


def deviation(fit: Fit) -> float:
    """Return the standard deviation of the kept points' distances."""
    squares = sum((fit.residual[i] / fit.slope[i]) ** 2 for i in fit.kept if fit.slope[i] > 0)
    return sqrt(squares / max(len(fit.kept) - (fit.size - 1), 1))


def is_better(before: float, after: float, freedom: int, rules: Rules) -> bool:
    """Return whether three more parameters improve the fit significantly (F test)."""
    if freedom < 1:
        return False
    ratio = f_quantile(rules.significance, freedom)
    return bool((before - after) / 3 > ratio * after / freedom)


@cache
def t_quantile(significance: float, freedom: int) -> float:
    """Return the two-sided quantile of Student's t."""
    return float(t.isf(significance / 2, freedom))


@cache
def f_quantile(significance: float, freedom: int) -> float:
    """Return the upper quantile of F with 3 and ``freedom`` degrees of freedom."""
    return float(f.isf(significance, 3, freedom))


def is_flat(fit: Fit) -> bool:
    """Return whether three quarters of the points are close to the surface, against its radius."""
    curvature = 2 * sqrt(sum(fit.a[4:] ** 2))
    curved = sum(abs(fit.residual[i]) * curvature > CURVED * fit.slope[i] ** 2 for i in fit.kept)
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
        floor = rules.min_sigma / self.scale
        score = np.full(n, inf)
        remaining = list(range(n))
        noise, freedom = inf, 0
        for number in range(rules.max_surfaces):
            start = self.begin(remaining, floor) if len(remaining) >= rules.min_points else []
            if not start:
                break
            if number:
                fit = self.grow_another(start, remaining, Growth(floor, noise, freedom))
            else:
                fit = self.grow(start, remaining, Growth(floor))
                if fit is not None:
                    noise = max(deviation(fit), floor)
                    freedom = len(fit.kept) - (fit.size - 1)
            if fit is None or (not rules.always_quadric and noise > max(THICK, floor)):
                break
            score = np.minimum(score, fit.test)
            remaining = [i for i in range(n) if score[i] > 1]
        undecided = len(remaining) == n if rules.always_quadric else 3 * len(remaining) > n
        return [nan] * n if undecided else list(score)

    def begin(self, remaining: Members, floor: float) -> Members:
        """Choose the initial points of a surface."""
        if self.rules.always_quadric:
            return remaining
        rank = min(len(remaining), max(self.rules.min_points, ceil(SHARE * len(remaining)))) - 1
        candidates = [remaining]
        for k in range(0, len(remaining), RUN):
            run = remaining[k : k + RUN]
            if 2 * len(run) >= RUN:
                distance = abs(heights(self.plane(run), self.points))
                limit = sorted(distance[run])[len(run) // 2]
                candidates.append([i for i in run if distance[i] <= limit])
        best, best_plane = inf, None
        for subset in candidates:
            plane = self.plane(subset)
            rank_distance = sorted(abs(heights(plane, self.points[remaining])))[rank]
            if is_plane(plane, floor) and max(rank_distance, BLUNT * floor) < best:
                best, best_plane = max(rank_distance, BLUNT * floor), plane
        if best_plane is None:
            return []
        subset = []
        for _ in range(CONCENTRATIONS):
            distance = abs(heights(best_plane, self.points))
            limit = sorted(distance[remaining])[rank]
            subset = [i for i in remaining if distance[i] <= limit]
            best_plane = self.plane(subset)
        return subset

    def plane(self, subset: Members) -> Plane:
        """Fit a plane to a subset of the points with unit weights."""
        return fit_plane(self.points[subset], np.ones(len(subset)))

    def grow(self, start: Members, remaining: Members, growth: Growth) -> Fit | None:
        """Grow a surface; a model with more parameters must improve the fit significantly."""
        if self.rules.always_quadric:
            self.frame = Frame(self.plane(start), self.points, self.variance)
            return self.grow_quadric(start, remaining, growth)
        plane = self.settle(start, remaining, PLANE, np.zeros(10), growth)
        if plane is None or deviation(plane) <= growth.floor:
            return plane
        curved = self.bend(plane)
        if curved is None:
            return plane
        paraboloid = self.settle(curved[0], remaining, PARABOLOID, curved[1], growth)
        if paraboloid is None:
            return plane
        if deviation(paraboloid) <= growth.floor:
            return paraboloid
        return self.rise(paraboloid, remaining, growth)

    def grow_quadric(self, start: Members, remaining: Members, growth: Growth) -> Fit | None:
        """Grow a quadric from the algebraic fit; None if that is ambiguous."""
        assert self.frame is not None
        a, gap = self.frame.algebraic(start)
        if not gap > GAP and not self.rules.always_quadric:
            return None
        quadric = self.settle(start, remaining, QUADRIC, a, growth)
        if self.rules.always_quadric:
            return quadric
        return quadric if quadric is not None and is_flat(quadric) else None

    def rise(self, paraboloid: Fit, remaining: Members, growth: Growth) -> Fit:
        """Replace a paraboloid by a quadric, if that improves the fit significantly."""
        assert self.frame is not None
        kept = paraboloid.kept
        weights = np.zeros(len(self.points))
        weights[kept] = 1 / paraboloid.sigma2[kept]
        solution = self.frame.step(paraboloid.a, weights, QUADRIC)
        if solution is None or not is_better(
            solution.before, solution.after, len(kept) - 9, self.rules
        ):
            return paraboloid
        return self.grow_quadric(kept, remaining, growth) or paraboloid

    def grow_another(self, start: Members, remaining: Members, growth: Growth) -> Fit | None:
        """Grow another surface, whose standard deviation is similar to that of the first."""
        for limits in (Growth(growth.floor), growth):
            fit = self.grow(start, remaining, limits)
            is_large = fit is not None and len(fit.kept) >= PART * len(remaining)
            if fit is not None and is_large and deviation(fit) <= LIKE * growth.noise:
                return fit
        return None

    def settle(
        self, kept: Members, remaining: Members, size: int, a: Floats, growth: Growth
    ) -> Fit | None:
        """Repeat fit and test until the kept points do not change."""
        fit = None
        for number in range(PASSES):
            fit = self.fit(kept, size, a, growth.floor)
            scores = None if fit is None else scores_of(fit, self.rules, growth)
            if fit is None or scores is None:
                return None
            fit.test, a = scores, fit.a
            adds = number < PASSES // 2
            following = [i for i in remaining if scores[i] <= 1 and (i in kept or adds)]
            if following == kept:
                return fit
            if len(following) < max(self.rules.min_points, size + 1):
                return None
            kept = following
        return fit

    def fit(self, kept: Members, size: int, a: Floats, floor: float) -> Fit | None:
        """Fit a model to the kept points."""
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
        """Fit a paraboloid to the kept points and to their best half; None if neither is better."""
        assert self.frame is not None
        up = np.eye(10)[3]
        kept, rules = plane.kept, self.rules
        half = (len(kept) + 1) // 2
        weights = np.zeros(len(self.points))
        weights[kept] = 1 / plane.sigma2[kept]
        solution = self.frame.step(up, weights, PARABOLOID)
        if solution is None:
            return None
        is_curved = is_better(solution.before, solution.after, len(kept) - 6, rules)
        a = up + np.append(solution.change, np.zeros(3))
        best_half = kept
        before = sum(sorted(plane.residual[kept] ** 2 / plane.sigma2[kept])[:half])
        after = inf
        for number in range(CONCENTRATIONS + 1):
            squared = (self.frame.rows @ a) ** 2 / plane.sigma2
            limit = sorted(squared[kept])[half - 1]
            best_half = [i for i in kept if squared[i] <= limit]
            after = sum(sorted(squared[kept])[:half])
            if number == CONCENTRATIONS:
                break
            weights = np.zeros(len(self.points))
            weights[best_half] = 1 / plane.sigma2[best_half]
            solution = self.frame.step(up, weights, PARABOLOID)
            if solution is None:
                return None
            a = up + np.append(solution.change, np.zeros(3))
        is_curved = is_curved or is_better(before, after, half - 6, rules)
        return (best_half, a / sqrt(a @ a)) if is_curved else None


def judge(points: Any, rules: Rules, variance: Any = None) -> list[float]:
    """Score the points (n, 3) of one window, whose variances are (n,) or None."""
    positions = np.asarray(points, float)
    if len(positions) < rules.min_points:
        return [nan] * len(positions)
    return Window(positions, variance, rules).judge()


# Windows ------------------------------------------------------------------------------------------


def section_window(points: Floats, first: int, last: int, section: int) -> Members:
    """Return the window of a core: points ``first`` to ``last`` - 1, and those around."""
    low, high = points[first:last].min(axis=0), points[first:last].max(axis=0)
    cloud_extent = max(points.max(axis=0) - points.min(axis=0))
    extent = max(high - low)
    margin = MARGIN * extent if extent > 0 else SMALLEST * cloud_extent
    min_count = min(len(points), max(section, int(ENOUGH * (last - first))))
    while True:
        found = [
            i for i, p in enumerate(points) if all(low - margin <= p) and all(p <= high + margin)
        ]
        if len(found) >= min_count or margin > cloud_extent:
            break
        margin *= 2
    rim = [i for i in found if not first <= i < last]
    stride = max(1, ceil(len(rim) / (RIM * section)))
    return sorted([*rim[::stride], *range(first, last)])


def sections(
    points: Any, cores: Sequence[tuple[int, int]], section: int, rules: Rules, variance: Any = None
) -> list[float]:
    """Score points in tree order; ``cores`` are ranges of their indices."""
    positions = np.asarray(points, float)
    core_scores = [nan] * len(positions)
    rim_scores: list[list[float]] = [[] for _ in positions]
    for first, last in cores:
        window = section_window(positions, first, last, section)
        scores = judge(positions[window], rules, None if variance is None else variance[window])
        for i, score in zip(window, scores, strict=True):
            if first <= i < last:
                core_scores[i] = score
            elif score <= 1:
                rim_scores[i].append(score)
    scores = [
        score if score <= 1 or not passed else min(passed)
        for score, passed in zip(core_scores, rim_scores, strict=True)
    ]
    return shared(positions, scores)


def shared(positions: Floats, scores: Sequence[float]) -> list[float]:
    """Give coincident points the smallest of their scores; NaN is ignored."""
    groups: dict[tuple[float, ...], list[float]] = {}
    for position, score in zip(positions, scores, strict=True):
        groups.setdefault(tuple(position + 0.0), []).append(score)
    return [float(np.fmin.reduce(groups[tuple(position + 0.0)])) for position in positions]


def patches(points: Any, order: Sequence[int], k: int, rules: Rules) -> list[float]:
    """Score each point in the window of itself and its k nearest, sorted in tree order."""
    positions = np.asarray(points, float)
    rank = {int(i): position for position, i in enumerate(order)}
    result = []
    for i in range(len(positions)):
        others, _ = nearest(positions.tolist(), i, k)
        window = sorted([i, *others], key=rank.__getitem__)
        scores = judge(positions[window], rules)
        result.append(scores[window.index(i)])
    return shared(positions, result)
