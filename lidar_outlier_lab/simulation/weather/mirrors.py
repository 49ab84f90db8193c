# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Ranges that surfaces make wrong: mixed at edges, mirrored by glass and water."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_outlier_filter.core.annotations import Bools, Floats
from lidar_outlier_lab.simulation.weather.beams import Beams, Optics

MIN_JUMP_M, MAX_JUMP_M = 0.25, 6.0  # between two surfaces whose echoes merge
MIN_SHARE = 0.15  # of the jump, that a mixed point is away from both
BESIDE = 0.06  # rad, at most, between a mirrored point and the beam that sees it
PANES = 6  # every third is water


def mix(beams: Beams, share: float, rng: np.random.Generator) -> tuple[Floats, Bools]:
    """Let beams at edges measure something between both surfaces.

    Parameters
    ----------
    beams : sorted by ring and time
    share : of the beams at edges that do

    Returns
    -------
    distance : (N,) metres
    mixed : (N,) bool

    """
    distance = beams.range.copy()
    same = beams.ring[1:] == beams.ring[:-1]
    both = np.isfinite(distance[1:]) & np.isfinite(distance[:-1]) & same
    jump = np.abs(np.where(both, distance[1:], 0.0) - np.where(both, distance[:-1], 0.0))
    edge = np.flatnonzero((jump > MIN_JUMP_M) & (jump < MAX_JUMP_M))
    edge = edge[rng.random(len(edge)) < share]
    # One of the two beams lies on the edge.
    which = edge + (rng.random(len(edge)) < 0.5)  # noqa: PLR2004  either
    part = MIN_SHARE + (1.0 - 2.0 * MIN_SHARE) * rng.random(len(edge))
    distance[which] = part * beams.range[edge] + (1.0 - part) * beams.range[edge + 1]
    mixed = np.zeros(len(beams), np.bool_)
    mixed[which] = True
    return distance, mixed


def mirror(
    beams: Beams, optics: Optics, share: float, rng: np.random.Generator
) -> tuple[Floats, Bools]:
    """Put upright panes on surfaces, and water on the ground: some beams are mirrored.

    A mirrored beam measures the whole way to what the pane mirrors, as if that lay behind it.

    Parameters
    ----------
    share : of the beams at a pane that are mirrored

    Returns
    -------
    distance : (N,) metres
    mirrored : (N,) bool

    """
    distance, mirrored = beams.range.copy(), np.zeros(len(beams), np.bool_)
    known = np.flatnonzero(np.isfinite(beams.range))
    xyz = beams.direction[known] * beams.range[known, None]
    tree = cKDTree(xyz)
    for number in range(PANES):
        pane = _pane(tree, xyz, rng, level=number % 3 == 0)
        if pane is None:
            continue
        inside, normal, offset = pane
        image = xyz - 2.0 * (xyz @ normal - offset)[:, None] * normal
        # Only what is before the pane is mirrored: its image is behind it.
        image = image[(xyz @ normal - offset) * -offset > 0]
        chosen = known[inside][rng.random(len(inside)) < share]
        if not len(image) or not len(chosen):
            continue
        far = np.sqrt((image * image).sum(axis=1))
        seen = cKDTree(image / far[:, None])
        off, nearest = seen.query(beams.direction[chosen], k=3, distance_upper_bound=BESIDE)
        reach = np.where(np.isfinite(off), np.append(far, np.inf)[nearest], np.inf).min(axis=1)
        found = np.isfinite(reach) & (reach < optics.farthest)
        found &= reach > beams.range[chosen] + MIN_JUMP_M
        distance[chosen[found]], mirrored[chosen[found]] = reach[found], True
    return distance, mirrored


def _pane(
    tree: cKDTree, xyz: Floats, rng: np.random.Generator, *, level: bool
) -> tuple[NDArray[np.intp], Floats, float] | None:
    """Choose a flat spot; return the points in it, its normal and its distance from the sensor."""
    for _ in range(40):
        centre = xyz[rng.integers(len(xyz))]
        size = rng.uniform(0.5, 1.0) * (0.15 * np.sqrt(centre @ centre) + 0.5)
        inside = np.array(tree.query_ball_point(centre, size), np.intp)
        if len(inside) < 20:  # noqa: PLR2004  too few to decide a plane
            continue
        mean = xyz[inside].mean(axis=0)
        value, vector = np.linalg.eigh(np.cov((xyz[inside] - mean).T))
        normal = vector[:, 0]
        flat = value[0] < (0.04 * size) ** 2 and value[1] > (0.1 * size) ** 2
        is_level = abs(normal[2]) > 0.9  # noqa: PLR2004  nearly
        is_upright = abs(normal[2]) < 0.3  # noqa: PLR2004  nearly
        if flat and (is_level if level else is_upright):
            return inside, normal, float(mean @ normal)
    return None
