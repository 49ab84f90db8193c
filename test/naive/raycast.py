# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Where a ray meets a surface, with school geometry and plain loops; None where it does not.

Each function takes the measures of a surface, then the ray's origin and direction (length one), and
returns the distance and the cosine of the angle of incidence.
"""

import math
from itertools import product

Vector = tuple[float, float, float]
Hit = tuple[float, float] | None

MASK = 2**64 - 1


def along(o: Vector, d: Vector, distance: float) -> Vector:
    """Go along a ray."""
    x, y, z = (a + distance * b for a, b in zip(o, d, strict=True))
    return x, y, z


def dot(a: Vector, b: Vector) -> float:
    """Multiply two vectors."""
    return sum(x * y for x, y in zip(a, b, strict=True))


def minus(a: Vector, b: Vector) -> Vector:
    """Go from b to a."""
    x, y, z = (p - q for p, q in zip(a, b, strict=True))
    return x, y, z


def ground(  # noqa: PLR0913  the measures of a road
    start: float, end: float, half: float, crown: float, o: Vector, d: Vector
) -> Hit:
    """Meet a road z = crown (1 - (y / half)²) from above: halve until it is crossed."""

    def above(distance: float) -> float:
        _, y, z = along(o, d, distance)
        return z - crown * (1 - (y / half) ** 2)

    if above(0) <= 0:
        return None
    low, high = 0.0, 0.0
    while above(high) > 0:
        low, high = high, high + 0.05
        if high > 50:
            return None
    for _ in range(100):
        middle = (low + high) / 2
        low, high = (middle, high) if above(middle) > 0 else (low, middle)
    x, y, _ = along(o, d, high)
    if not (start <= x <= end and abs(y) <= half):
        return None
    normal = (0.0, 2 * crown * y / half**2, 1.0)
    return high, abs(dot(d, normal)) / math.sqrt(dot(normal, normal))


def box(low: Vector, high: Vector, o: Vector, d: Vector) -> Hit:
    """Meet a box from outside: the nearest of its six faces whose rectangle is hit."""
    hit: Hit = None
    for axis, corner in product(range(3), (low, high)):
        if d[axis] == 0:
            continue
        distance = (corner[axis] - o[axis]) / d[axis]
        position = along(o, d, distance)
        others = [i for i in range(3) if i != axis]
        inside = all(low[i] <= position[i] <= high[i] for i in others)
        if distance > 0 and inside and (hit is None or distance < hit[0]):
            hit = distance, abs(d[axis])
    is_outside = any(not low[i] < o[i] < high[i] for i in range(3))
    return hit if is_outside else None


def tube(  # noqa: PLR0913  the measures of a tube
    foot: Vector, axis: Vector, radius: float, length: float, o: Vector, d: Vector
) -> Hit:
    """Meet the outside of a tube: the nearer root of |p - foot|² - ((p - foot) · axis)² = r²."""
    out, lean = minus(o, foot), dot(d, axis)
    a = 1 - lean**2
    b = dot(out, d) - dot(out, axis) * lean
    c = dot(out, out) - dot(out, axis) ** 2 - radius**2
    if a < 1e-12 or b * b <= a * c:
        return None
    distance = (-b - math.sqrt(b * b - a * c)) / a
    position = minus(along(o, d, distance), foot)
    height = dot(position, axis)
    if distance <= 0 or not 0 <= height <= length:
        return None
    normal = minus(position, (axis[0] * height, axis[1] * height, axis[2] * height))
    return distance, abs(dot(d, normal)) / radius


def ball(centre: Vector, radius: float, o: Vector, d: Vector) -> Hit:
    """Meet a ball from outside."""
    out = minus(o, centre)
    b, c = dot(out, d), dot(out, out) - radius**2
    if c <= 0 or b * b <= c or b >= 0:
        return None
    distance = -b - math.sqrt(b * b - c)
    normal = minus(along(o, d, distance), centre)
    return distance, abs(dot(d, normal)) / radius


def lid(  # noqa: PLR0913  the measures of a lid
    centre: Vector, radius: float, relief: float, spacing: float, o: Vector, d: Vector
) -> Hit:
    """Meet a lid from above, or a groove between the ribs on it."""
    if d[2] >= 0 or o[2] <= centre[2]:
        return None
    distance = (centre[2] - o[2]) / d[2]
    x, y, _ = minus(along(o, d, distance), centre)
    if math.hypot(x, y) > radius:
        return None
    square = math.floor(2 * x / spacing) + math.floor(2 * y / spacing)
    deeper = relief if square % 2 else 0.0
    return distance + deeper / -d[2], -d[2]


def scramble(value: int) -> int:
    """Mix 64 bits as SplitMix64 does."""
    value = ((value ^ (value >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    value = ((value ^ (value >> 27)) * 0x94D049BB133111EB) & MASK
    return value ^ (value >> 31)


def uniform(i: int, j: int, k: int, seed: int, which: int) -> float:
    """Give a number in 0 to 1 that belongs to a cell."""
    state = seed & MASK
    for number in (i, j, k, which):
        state = scramble((state + (number & MASK) + 0x9E3779B97F4A7C15) & MASK)
    return (state >> 11) / 2**53


def crown(  # noqa: PLR0913  the measures of a crown
    centre: Vector,
    half: Vector,
    cell: float,
    leaf: float,
    share: float,
    seed: int,
    o: Vector,
    d: Vector,
) -> Hit:
    """Meet a leaf: try the cells that the ray crosses inside the ellipsoid, nearest first."""
    a = sum((d[i] / half[i]) ** 2 for i in range(3))
    b = sum((o[i] - centre[i]) * d[i] / half[i] ** 2 for i in range(3))
    c = sum(((o[i] - centre[i]) / half[i]) ** 2 for i in range(3)) - 1
    if b * b <= a * c:
        return None
    start, end = max((-b - math.sqrt(b * b - a * c)) / a, 0.0), (-b + math.sqrt(b * b - a * c)) / a
    reach = [math.ceil(size / cell) + 1 for size in half]
    crossed = []
    for number in product(*(range(-n, n + 1) for n in reach)):
        low = [centre[i] + number[i] * cell for i in range(3)]
        enter, leave = start, end
        for i in range(3):
            sides = sorted(((low[i] - o[i]) / d[i], (low[i] + cell - o[i]) / d[i]))
            enter, leave = max(enter, sides[0]), min(leave, sides[1])
        if enter < leave:
            crossed.append((enter, number))
    for _, (i, j, k) in sorted(crossed):
        if uniform(i, j, k, seed, 0) >= share:
            continue
        position = [
            centre[n] + ((i, j, k)[n] + uniform(i, j, k, seed, 1 + n)) * cell for n in range(3)
        ]
        height, around = 2 * uniform(i, j, k, seed, 4) - 1, 2 * math.pi * uniform(i, j, k, seed, 5)
        flat = math.sqrt(1 - height**2)
        normal = (flat * math.cos(around), flat * math.sin(around), height)
        middle = (position[0], position[1], position[2])
        lean = dot(d, normal)
        distance = dot(minus(middle, o), normal) / lean
        off = minus(along(o, d, distance), middle)
        if 0 < distance < end and dot(off, off) < leaf**2:
            return distance, abs(lean)
    return None
