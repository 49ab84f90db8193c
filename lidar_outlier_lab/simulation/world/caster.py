# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels that find where rays meet surfaces; each surface is one row of numbers.

A row holds the shape's code, the low and the high corner of a box around it, the velocity with
which all of it moves, and from ``REST`` on what its shape needs: see the functions ``_meet_...``.
A ray has an origin, a direction of length one and a time. The result is the distance (inf: missed),
the cosine of incidence and the *part* that was met: 0 to 2, a face that is normal to this axis; 3,
any other; ``PANE`` more for the pane of a window.
"""

import numpy as np

from lidar_outlier_filter.core.annotations import Floats, Ints
from lidar_outlier_filter.core.kernels.kernels import device_function, kernel

Hit = tuple[float, float, int]

GROUND, BOX, BUILDING, TUBE, ARM, BALL, LID, CROWN = range(8)
LOW, HIGH, VELOCITY, REST, WIDTH = 1, 4, 7, 10, 24
ROUND, PANE = 3, 4
TINY = 1e-12  # keeps a ray parallel to a face from dividing by zero; it meets the face nowhere near


@kernel
def cast(
    table: Floats, origin: Floats, direction: Floats, t: Floats, reach: float
) -> tuple[Floats, Floats, Ints, Ints]:
    """Find the nearest surface on every ray.

    Parameters
    ----------
    table : (S, WIDTH) surfaces; of equally near ones the first counts
    origin, direction : (3, N, K) N bundles of K rays
    t : (N,) seconds, for what moves
    reach : metres within which the rays of a bundle stay of its first

    Returns
    -------
    distance, cosine, surface, part : (N, K); surface is the row, -1 where nothing was met

    """
    count, rays = direction.shape[1], direction.shape[2]
    distance = np.full((count, rays), np.inf)
    cosine = np.ones((count, rays))
    surface = np.full((count, rays), -1, np.int64)
    part = np.full((count, rays), ROUND, np.int64)
    position, step = np.empty(3), np.empty(3)
    for n in range(count):
        farthest = np.inf  # of what the rays of the bundle have met so far
        for s in range(len(table)):
            row = table[s]
            for axis in range(3):
                position[axis] = origin[axis, n, 0] - row[VELOCITY + axis] * t[n]
                step[axis] = direction[axis, n, 0]
            if not _is_towards(row, position, step, reach, farthest):
                continue
            farthest = 0.0
            for k in range(rays):
                for axis in range(3):
                    position[axis] = origin[axis, n, k] - row[VELOCITY + axis] * t[n]
                    step[axis] = direction[axis, n, k]
                far, lean, face = _meet(row, position, step, t[n])
                if far < distance[n, k]:
                    distance[n, k], cosine[n, k] = far, lean
                    surface[n, k], part[n, k] = s, face
                farthest = max(farthest, distance[n, k])
    return distance, cosine, surface, part


@device_function
def _is_towards(row: Floats, o: Floats, d: Floats, reach: float, farthest: float) -> bool:
    """Return whether a ray comes within ``reach`` of a row's box before ``farthest``."""
    entry, leave = 0.0, farthest
    for axis in range(3):
        step = d[axis] if abs(d[axis]) >= TINY else TINY
        first = (row[LOW + axis] - reach - o[axis]) / step
        second = (row[HIGH + axis] + reach - o[axis]) / step
        entry = max(entry, min(first, second))
        leave = min(leave, max(first, second))
    return bool(entry <= leave)


@device_function
def _meet(row: Floats, o: Floats, d: Floats, t: float) -> Hit:  # noqa: PLR0911  one a shape
    """Meet one surface."""
    shape, p = int(row[0]), row[REST:]
    if shape == GROUND:
        return _meet_ground(p, o, d)
    if shape == BOX:
        return _meet_box(p, o, d)
    if shape == BUILDING:
        return _meet_building(p, o, d)
    if shape == TUBE:
        return _meet_tube(p, o, d)
    if shape == ARM:
        return _meet_arm(p, o, d, t)
    if shape == BALL:
        return _meet_ball(p, o, d)
    if shape == LID:
        return _meet_lid(p, o, d)
    return _meet_crown(p, o, d)


@device_function
def _meet_ground(p: Floats, o: Floats, d: Floats) -> Hit:
    """Meet a road from above: start, end, half width, crown."""
    start, end, half, crown = p[0], p[1], p[2], p[3]
    y = o[1]
    bend = crown / half**2
    a = bend * d[1] ** 2
    b = d[2] + 2.0 * bend * y * d[1]
    c = o[2] - crown * (1.0 - (y / half) ** 2)
    disc = b * b - 4.0 * a * c
    # This form of the quadratic formula is exact for the flat road (a = 0) too.
    far = 2.0 * c / max(np.sqrt(max(disc, 0.0)) - b, TINY)
    along, across = o[0] + far * d[0], y + far * d[1]
    inside = start <= along <= end and abs(across) <= half
    if not (inside and b < 0.0 and c > 0.0 and disc >= 0.0):
        return np.inf, 1.0, 2
    slope = 2.0 * bend * across
    return far, abs(d[2] + slope * d[1]) / np.sqrt(1.0 + slope * slope), 2


@device_function
def _meet_box(p: Floats, o: Floats, d: Floats) -> Hit:
    """Meet a box from outside: its low corner and its high corner."""
    entry, leave, face = -np.inf, np.inf, 0
    for axis in range(3):
        step = d[axis] if abs(d[axis]) >= TINY else TINY
        first, second = (p[axis] - o[axis]) / step, (p[3 + axis] - o[axis]) / step
        if min(first, second) > entry:
            entry, face = min(first, second), axis
        leave = min(leave, max(first, second))
    if not (0.0 < entry < leave):
        return np.inf, 1.0, face
    return entry, abs(d[face]), face


@device_function
def _meet_building(p: Floats, o: Floats, d: Floats) -> Hit:
    """Meet a box with windows, from outside.

    Corners, pitch, storey, width and height of a window, sill, recess, every how many-th is open
    (0: none), and whether the walls across the street (normal to x) have windows too.
    """
    far, lean, face = _meet_box(p, o, d)
    if far == np.inf or face == 2 or (face == 0 and p[13] == 0.0):  # noqa: PLR2004  the roof
        return far, lean, face
    side = 1 - face
    pitch, storey, across, up, sill, recess, every = p[6:13]
    u = o[side] + far * d[side] - p[side]
    v = o[2] + far * d[2] - p[2]
    column, level = np.floor(u / pitch), np.floor(v / storey)
    u -= (column + 0.5) * pitch
    v = v - level * storey - sill - up / 2.0
    if not (abs(u) < across / 2.0 and abs(v) < up / 2.0):
        return far, lean, face
    aside = (across / 2.0 - np.sign(d[side]) * u) / max(abs(d[side]), TINY)
    upward = (up / 2.0 - np.sign(d[2]) * v) / max(abs(d[2]), TINY)
    deep = recess / max(abs(d[face]), TINY)
    if aside <= deep and aside <= upward:
        return far + aside, abs(d[side]), side
    if upward < deep:
        return far + upward, abs(d[2]), 2
    if every > 0.0 and (column + 2.0 * level) % every == 0.0:
        return np.inf, 1.0, face  # an open window: what goes in is lost
    return far + deep, abs(d[face]), face + PANE


@device_function
def _meet_tube(p: Floats, o: Floats, d: Floats) -> Hit:
    """Meet the outside of a tube: its foot, its axis (length one), radius, length."""
    along = lean = 0.0
    for axis in range(3):
        along += (o[axis] - p[axis]) * p[3 + axis]
        lean += d[axis] * p[3 + axis]
    a = b = c = 0.0
    for axis in range(3):
        out = o[axis] - p[axis] - along * p[3 + axis]
        turn = d[axis] - lean * p[3 + axis]
        a += turn * turn
        b += out * turn
        c += out * out
    a = max(a, TINY)
    disc = b * b - a * (c - p[6] * p[6])
    if not disc > 0.0:
        return np.inf, 1.0, ROUND
    far = (-b - np.sqrt(disc)) / a
    position = along + far * lean
    if not (far > 0.0 and 0.0 <= position <= p[7]):
        return np.inf, 1.0, ROUND
    return far, np.sqrt(disc) / p[6], ROUND


@device_function
def _meet_arm(p: Floats, o: Floats, d: Floats, t: float) -> Hit:
    """Meet a swinging tube: its pivot, length, radius, angle at t = 0, rate."""
    raised = min(max(p[5] + p[6] * t, 0.0), np.pi / 2.0)
    tube = np.empty(8)
    tube[:3] = p[:3]
    tube[3], tube[4], tube[5] = 0.0, -np.cos(raised), np.sin(raised)
    tube[6], tube[7] = p[4], p[3]
    return _meet_tube(tube, o, d)


@device_function
def _meet_ball(p: Floats, o: Floats, d: Floats) -> Hit:
    """Meet a ball from outside: centre, radius."""
    b = c = 0.0
    for axis in range(3):
        b += (o[axis] - p[axis]) * d[axis]
        c += (o[axis] - p[axis]) ** 2
    disc = b * b - c + p[3] * p[3]
    if disc <= 0.0 or b >= 0.0 or c <= p[3] * p[3]:
        return np.inf, 1.0, ROUND
    return -b - np.sqrt(disc), np.sqrt(disc) / p[3], ROUND


@device_function
def _meet_lid(p: Floats, o: Floats, d: Floats) -> Hit:
    """Meet a round lid from above: centre of its top, radius, height and spacing of its ribs.

    The ribs' flanks are left out: a ray is carried on from the top to the grooves between them.
    """
    if d[2] >= -TINY or o[2] <= p[2]:
        return np.inf, 1.0, 2
    far = (p[2] - o[2]) / d[2]
    u, v = o[0] + far * d[0] - p[0], o[1] + far * d[1] - p[1]
    if u * u + v * v > p[3] * p[3]:
        return np.inf, 1.0, 2
    if np.sin(2.0 * np.pi * u / p[5]) * np.sin(2.0 * np.pi * v / p[5]) < 0.0:
        far += p[4] / -d[2]
    return far, -d[2], 2


@device_function
def mix(value: np.uint64) -> np.uint64:
    """Scramble 64 bits (the last step of SplitMix64; Steele et al. 2014, figure 17)."""
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))


@kernel
def uniform(i: int, j: int, k: int, seed: int, which: int) -> float:
    """Give a number in 0 to 1 that belongs to a cell of a grid."""
    state = np.uint64(seed)
    for number in (i, j, k, which):
        state = mix(state + np.uint64(number) + np.uint64(0x9E3779B97F4A7C15))
    return float(state >> np.uint64(11)) * 2.0**-53


@device_function
def _meet_crown(p: Floats, o: Floats, d: Floats) -> Hit:
    """Meet the leaves of an ellipsoid: centre, half axes, cell, leaf radius, share, seed.

    Space is cut into cells; in a share of them is a leaf, a disc that lies and leans anyhow. The
    cells on the ray are visited in order, and in each only its own leaf counts.
    """
    a = b = c = 0.0
    for axis in range(3):
        turn, out = d[axis] / p[3 + axis], (o[axis] - p[axis]) / p[3 + axis]
        a += turn * turn
        b += out * turn
        c += out * out
    disc = b * b - a * (c - 1.0)
    if disc <= 0.0:
        return np.inf, 1.0, ROUND
    now, end = max((-b - np.sqrt(disc)) / a, 0.0), (-b + np.sqrt(disc)) / a
    size, radius, share, seed = p[6], p[7], p[8], int(p[9])
    cell, onward, border = np.empty(3, np.int64), np.empty(3), np.empty(3)
    for axis in range(3):
        step = d[axis] if abs(d[axis]) >= TINY else TINY
        cell[axis] = int(np.floor((o[axis] + now * d[axis] - p[axis]) / size))
        border[axis] = (p[axis] - o[axis] + (cell[axis] + (step > 0.0)) * size) / step
        onward[axis] = size / abs(step)
    while now < end:
        if uniform(cell[0], cell[1], cell[2], seed, 0) < share:
            far, lean = _meet_leaf(p, o, d, cell, radius)
            if 0.0 < far < end:
                return far, lean, ROUND
        axis = int(np.argmin(border))
        now = border[axis]
        border[axis] += onward[axis]
        cell[axis] += 1 if d[axis] > 0.0 else -1
    return np.inf, 1.0, ROUND


@device_function
def _meet_leaf(p: Floats, o: Floats, d: Floats, cell: Ints, radius: float) -> tuple[float, float]:
    """Meet the leaf of a cell: distance and cosine."""
    i, j, k, seed = cell[0], cell[1], cell[2], int(p[9])
    gap, normal = np.empty(3), np.empty(3)
    for axis in range(3):
        position = (cell[axis] + uniform(i, j, k, seed, 1 + axis)) * p[6]
        gap[axis] = p[axis] + position - o[axis]
    height, around = 2.0 * uniform(i, j, k, seed, 4) - 1.0, 2.0 * np.pi * uniform(i, j, k, seed, 5)
    flat = np.sqrt(max(1.0 - height * height, 0.0))
    normal[0], normal[1], normal[2] = flat * np.cos(around), flat * np.sin(around), height
    lean = reach = 0.0
    for axis in range(3):
        lean += d[axis] * normal[axis]
        reach += gap[axis] * normal[axis]
    if abs(lean) < TINY:
        return np.inf, 1.0
    far, off = reach / lean, 0.0
    for axis in range(3):
        off += (far * d[axis] - gap[axis]) ** 2
    return (far, abs(lean)) if off < radius * radius else (np.inf, 1.0)
