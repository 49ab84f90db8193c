# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Where beams leave a spinning sensor, and peaks of a histogram, in plain loops."""

import math


def spread(flat: list[float], z: list[float], up: float, out: float) -> float:
    """Return the mean logarithm of how far apart every fifth of the sorted elevations are."""
    seen = sorted(math.atan2(h - up, r - out) for r, h in zip(flat, z, strict=True))
    total = 0.0
    for low, high in zip(seen, seen[4:], strict=False):
        gap = high - low + 2e-5
        power = math.floor(math.log2(gap))
        total += power + gap / 2.0**power - 1.0
    return total / max(len(seen) - 4, 1)


def peaks(count: list[int], least: int) -> list[int]:
    """Return the tops between positions that hold no more than half of them."""
    found: list[int] = []
    begin = 0
    while begin < len(count):
        top = -1
        for i in range(begin, len(count)):
            if count[i] == 0 and (top < 0 or count[top] < least):
                top = -1
            elif top < 0 or count[i] > count[top]:
                top = i
            elif count[top] >= least and 2 * count[i] < count[top]:
                break
        else:
            return found
        found.append(top)
        low = count[i]
        while i < len(count) and not (count[i] >= least and count[i] >= 2 * low):
            low = min(low, count[i])
            i += 1
        begin = i
    return found
