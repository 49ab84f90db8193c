# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Errors that are put into surveyed clouds: single points and groups, off every surface.

Distances are multiples of the local spacing, so that the errors of dense and of sparse clouds are
alike hard to find.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from lidar_outlier_filter.core.annotations import Bytes, Floats
from lidar_outlier_filter.evaluation.truth import Cause
from lidar_outlier_lab.simulation.papers.aerial import log_uniform

NEIGHBOUR = 8  # whose distance is the spacing
OFF = (2.5, 1000.0)  # spacings that a point is moved off
GROUP = (2, 40)  # points
SPREAD = (0.1, 3.0)  # standard deviation of a group's coordinates, spacings
APART = (4.0, 600.0)  # spacings that its centre is moved off
STEP = (0.3, 1.5)  # spacings from one point of a row to the next
LOW = (0.03, 20.0)  # spacings below the ground
PLAIN, NOISES = 20, 4.0  # neighbours of a low point, and their standard deviations it is below
NOISE_FREE = 2.0  # spacings from good points that errors keep, low ones aside
PATCH = (4.0, 60.0)  # points of a surface that a mirror shows at another place
BELOW = 0.7  # share of the mirrored pieces that lie below their surface
KINDS = (1.0, 2.0, 1.0, 1.0, 1.0, 1.0)  # how common the makers are, of Dirichlet's distribution
TRIES = 20
CLOUDED = 0.35  # share of the clouds with points at all heights
HIGHEST = (30.0, 1500.0)  # spacings that these are moved up, or up and down, at most


class _Cloud(NamedTuple):
    xyz: Floats
    tree: cKDTree
    low: Floats
    high: Floats


def add_errors(xyz: Floats, share: float, rng: np.random.Generator) -> tuple[Floats, Bytes]:
    """Return a cloud with errors behind its points, and the cause of each point, 0 for good ones.

    Parameters
    ----------
    xyz : (N, 3) good points, z up, metres
    share : of the points, that errors are

    """
    cloud = _Cloud(xyz, cKDTree(xyz), xyz.min(axis=0), xyz.max(axis=0))
    requested = round(share * len(xyz))
    kinds = rng.dirichlet(KINDS)
    parts, causes = [np.empty((0, 3))], [np.zeros(len(xyz), np.uint8)]
    count = 0
    if rng.random() < CLOUDED:
        parts.append(_cloud(cloud, requested, rng))
        count = len(parts[-1])
        causes.append(np.full(count, Cause.SINGLE, np.uint8))
    while count < requested:
        maker = MAKERS[int(rng.choice(len(MAKERS), p=kinds))]
        start = xyz[int(rng.integers(len(xyz)))]
        spacing = max(float(cloud.tree.query(start, NEIGHBOUR + 1)[0][-1]), 1e-6)
        made = maker(cloud, start, spacing, rng)
        low = maker is _low
        if not _is_clear(cloud, start, made, spacing, low=low):
            # Where nothing fits, there are fewer errors.
            count += rng.random() < 1.0 / TRIES
            continue
        parts.append(made)
        cause = Cause.REFLECTION if low else Cause.SINGLE if len(made) == 1 else Cause.CLUSTER
        causes.append(np.full(len(made), cause, np.uint8))
        count += len(made)
    return np.concatenate([xyz, *parts]), np.concatenate(causes)


def _is_clear(cloud: _Cloud, start: Floats, made: Floats, spacing: float, *, low: bool) -> bool:
    """Return whether errors are off every surface, or low ones below theirs."""
    if not low:
        return bool(cloud.tree.query(made)[0].min() >= NOISE_FREE * spacing)
    near = cloud.xyz[cloud.tree.query(start, PLAIN)[1]]
    noise = np.linalg.svd(near - near.mean(axis=0))[1][2] / np.sqrt(PLAIN)
    return bool(start[2] - made[0, 2] >= NOISES * noise)


def _cloud(cloud: _Cloud, requested: int, rng: np.random.Generator) -> Floats:
    """Put points at all heights above surfaces, or below them as well."""
    count = int(rng.integers(requested // 4, requested + 1))
    start = cloud.xyz[rng.integers(len(cloud.xyz), size=count)]
    spacing = cloud.tree.query(start, NEIGHBOUR + 1)[0][:, -1]
    most = np.median(spacing) * log_uniform(rng, *HIGHEST)
    off = rng.uniform(0.0, most, len(start))
    below = rng.random(len(start)) < rng.choice([0.0, 0.5])
    made = start.copy()
    made[:, 2] += np.where(below, -off, off)
    return made[cloud.tree.query(made)[0] >= NOISE_FREE * spacing]


def _away(rng: np.random.Generator) -> Floats:
    """Draw a direction: up or down as often as any other."""
    if rng.random() < 0.5:  # noqa: PLR2004  half of them
        return np.array([0.0, 0.0, rng.choice([-1.0, 1.0])])
    way = rng.standard_normal(3)
    return way / np.linalg.norm(way)


def _scattered(cloud: _Cloud, _start: Floats, spacing: float, rng: np.random.Generator) -> Floats:
    """Put a point anywhere around the cloud."""
    margin = 5.0 * spacing
    return rng.uniform(cloud.low - margin, cloud.high + margin)[None]


def _moved(_cloud: _Cloud, start: Floats, spacing: float, rng: np.random.Generator) -> Floats:
    """Move a point off, or a few that come together."""
    far = rng.uniform(*OFF) if rng.random() < 0.3 else log_uniform(rng, *OFF)  # noqa: PLR2004
    off = spacing * far * _away(rng)
    few = int(rng.integers(1, 4)) if rng.random() < 0.3 else 1  # noqa: PLR2004  some of them
    return start + off + 0.3 * spacing * rng.standard_normal((few, 3))


def _group(_cloud: _Cloud, start: Floats, spacing: float, rng: np.random.Generator) -> Floats:
    """Put a round group of points somewhere."""
    size, spread = int(rng.integers(*GROUP)), spacing * log_uniform(rng, *SPREAD)
    off = (spacing * log_uniform(rng, *APART) + 2.0 * spread) * _away(rng)
    return start + off + spread * rng.standard_normal((size, 3))


def _row(_cloud: _Cloud, start: Floats, spacing: float, rng: np.random.Generator) -> Floats:
    """Put a row of points somewhere, which is not quite straight."""
    size, step = int(rng.integers(*GROUP)), spacing * log_uniform(rng, *STEP)
    off = spacing * log_uniform(rng, *APART) * _away(rng)
    along = np.cumsum(step * rng.uniform(0.5, 1.5, size))
    made: Floats = start + off + along[:, None] * _away(rng)
    return made + 0.1 * step * rng.standard_normal((size, 3))


def _low(_cloud: _Cloud, start: Floats, spacing: float, rng: np.random.Generator) -> Floats:
    """Put a point below a surface, as if its echo came late."""
    return start - np.array([[0.0, 0.0, spacing * log_uniform(rng, *LOW)]])


def _patch(cloud: _Cloud, start: Floats, spacing: float, rng: np.random.Generator) -> Floats:
    """Copy a piece of a surface to another place, as a mirror does, most often below it."""
    size = int(log_uniform(rng, *PATCH))
    piece = cloud.xyz[cloud.tree.query(start, min(size, len(cloud.xyz)))[1]]
    seen = rng.random(len(piece)) < rng.uniform(0.3, 1.0)
    seen[0] = True
    piece = piece[seen]
    off = spacing * log_uniform(rng, *APART)
    way = np.array([0.0, 0.0, -1.0]) if rng.random() < BELOW else _away(rng)
    height = 2.0 * start[2] - piece[:, 2] if rng.random() < 0.5 else piece[:, 2]  # noqa: PLR2004
    made = np.column_stack([piece[:, :2], height]) + off * way
    return made + rng.uniform(0.0, 0.3) * spacing * rng.standard_normal(made.shape)


MAKERS = (_scattered, _moved, _group, _row, _low, _patch)
