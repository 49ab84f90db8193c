# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Verdicts as bytes, on their way from one process to another; and points by their digest."""

from __future__ import annotations

import struct
import zlib
from dataclasses import fields
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.verdict import Verdict

if TYPE_CHECKING:
    from numpy.typing import NDArray


_HEAD = struct.Struct('<IHHH?')  # points, passes, bits of detectors, bits of undecided, scores
_DIGEST = struct.Struct(f'<{1 + len(fields(Points))}q')  # points, and a CRC of each column or -1
_FAST = 1  # level of zlib: most bits are 0, so that others gain little
_REJECTED = 2.0  # stands for any score above 1 where scores are left out


def digest(points: Points) -> bytes:
    """Return what tells these points from all others that a chain would judge differently.

    It is the number of points with a CRC of each column. Other points of the same recording that
    are as many have other times and positions: a CRC always sees a change of up to 32 bits in
    a row, and misses any other once in 2^32, in each of these columns. SHA-256 takes three times
    as long.
    Scan lines are compared with each other only: their numbers count from the first one's.
    """
    found = [len(points)]
    for column in fields(Points):
        values = getattr(points, column.name)
        if column.name == 'line':
            values = values - values[:1] if len(values) else values
        found.append(-1 if values is None else zlib.crc32(np.ascontiguousarray(values).data))
    return _DIGEST.pack(*found)


def pack(verdict: Verdict, passes: int, *, scores: bool) -> bytes:
    """Write a verdict as bits: one of each point for each detector that says anything of it.

    ``passes`` are those that the block has needed. Without ``scores`` the bytes say only which
    points were tested, and no reasons.
    """
    kinds = [int(np.bitwise_or.reduce(bits)) for bits in (verdict.detectors, verdict.undecided)]
    planes = [verdict.rejected, ~np.isnan(verdict.score)]
    for bits, kind in zip((verdict.detectors, verdict.undecided), kinds, strict=True):
        planes += [bits & bit != 0 for bit in _bits(kind)]
    body = b''.join(np.packbits(plane).tobytes() for plane in planes)
    if scores:
        body += verdict.reason.tobytes() + verdict.score.tobytes()
    return _HEAD.pack(len(verdict), passes, *kinds, scores) + zlib.compress(body, _FAST)


def unpack(packed: bytes) -> tuple[Verdict, int]:
    """Read what :func:`pack` wrote: the verdict, and the passes that the block has needed."""
    count, passes, detectors, undecided, scores = _HEAD.unpack_from(packed)
    body = np.frombuffer(zlib.decompress(packed[_HEAD.size :]), np.uint8)
    step = -(-count // 8)

    def plane(number: int) -> NDArray[np.bool_]:
        rows = body[number * step : (number + 1) * step]
        return np.unpackbits(rows, count=count).view(np.bool_)

    def sums(kind: int, begin: int) -> NDArray[np.uint16]:
        total = np.zeros(count, np.uint16)
        for number, bit in enumerate(_bits(kind), begin):
            total |= plane(number) * np.uint16(bit)
        return total

    first = 2 + len(_bits(detectors))
    bits = sums(detectors, 2)
    if scores:
        end = (first + len(_bits(undecided))) * step
        reason = body[end : end + count]
        score = np.frombuffer(body[end + count :].tobytes(), np.float32)
    else:
        reason = np.zeros(count, np.uint8)
        score = np.where(plane(1), np.where(bits, _REJECTED, 0), np.nan).astype(np.float32)
    return Verdict(score, bits, sums(undecided, first), plane(0), reason), passes


def _bits(total: int) -> list[int]:
    return [1 << number for number in range(16) if total & 1 << number]
