# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Distances from a surface model, and the truth that they make."""

from __future__ import annotations

import numpy as np

from lidar_outlier_lab.simulation.papers import surface_truth


def to_triangle(p: np.ndarray, corners: np.ndarray) -> float:
    """Measure the distance from a point to a triangle, by its plane, edges and corners."""
    a, b, c = corners
    normal = np.cross(b - a, c - a)
    foot = p - (p - a) @ normal / (normal @ normal) * normal
    edges = [(a, b), (b, c), (c, a)]
    if all(np.cross(v - u, foot - u) @ normal >= 0 for u, v in edges):
        return float(np.linalg.norm(p - foot))
    found = []
    for u, v in edges:
        t = np.clip((p - u) @ (v - u) / ((v - u) @ (v - u)), 0, 1)
        found.append(float(np.linalg.norm(p - u - t * (v - u))))
    return min(found)


def test_distances() -> None:
    """They are those to the nearest triangle, too large by the step of the samples at most."""
    rng = np.random.default_rng(1)
    height = rng.uniform(0, 3, (4, 5))
    triangles = []
    for i in range(3):
        for j in range(4):
            p, q, r, s = (
                np.array([a, b, height[a, b]], float)
                for a, b in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1))
            )
            triangles += [np.array([p, q, r]), np.array([p, r, s])]
    points = rng.uniform([0, 0, -2], [3, 4, 6], (60, 3))
    expected = np.array([min(to_triangle(p, one) for one in triangles) for p in points])
    found = surface_truth.distances(points, height, 1.0)
    assert (found >= expected - 1e-12).all()
    assert (found <= np.hypot(expected, surface_truth.FINE / np.sqrt(2)) + 1e-12).all()
