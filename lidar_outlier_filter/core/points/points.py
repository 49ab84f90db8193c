# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Points: what every stage after the decoder works on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Allocate
from lidar_outlier_filter.errors import CloudError

SECOND = 1_000_000_000  # nanoseconds
LONGEST_NS = 2**61  # nanoseconds: 73 years, and sums of two still fit
# Metres. No map reaches that far, the Moon is nearer, and float64 still resolves 0.1 µm there. What
# is beyond was never measured: memory that nobody has set, the wrong order of bytes.
FARTHEST = 1e9
LEAST_SIGMA_M = 1e-9  # metres: the least standard deviation
COARSEST = 0.01  # metres between two float32 that still carry what sensors measure
SAMPLE_POINTS = 64  # points that show how far a cloud is from the origin


@dataclass(frozen=True)
class Points:
    """N points in the order of their message.

    Time is an integer, because a float64 of 1.7e9 seconds resolves 240 ns only, and because integer
    differences do not depend on where the stream was cut.

    Attributes
    ----------
    xyz : (N, 3) float64
        Position, metres.
    t : (N,) int64
        Time of measurement, nanoseconds of the sensor's clock.
    line : (N,) int64
        Identity of the scan line: points of one line are compared along it.
    valid : (N,) bool
        False for missing returns (NaN, Inf, 0 0 0), which no detector sees.
    sigma : (N,) float64 or None
        Own standard deviation of each point, metres.
    own : (N, 3) float64 or None
        Position in the sensor's own frame, metres, where ``xyz`` is in another one.
    intensity : (N,) float32 or None
        As the sensor gives it, in any unit; NaN where it is not known.
    ring : (N,) int64 or None
        Recovered from elevations, where the sensor spins and gives no scan lines; -1 for missing
        returns.
    fixed : (N,) bool or None
        In a partly transformed cloud: whether ``xyz`` is in the fixed frame.
    masked : (N,) bool or None
        On the own vehicle, if a mask is set; not valid, so that no detector uses it.
    shadow : (N,) bool or None
        Which of the masked points are behind it.
    head : (N,) int64 or None
        Which of several scanners measured it, where a column says so; until it has its line.
    field : (N,) float64 or None
        The field that a detector reads by its name; NaN where it is not known.

    """

    xyz: NDArray[np.float64]
    t: NDArray[np.int64]
    line: NDArray[np.int64]
    valid: NDArray[np.bool_]
    sigma: NDArray[np.float64] | None = None
    own: NDArray[np.float64] | None = None
    intensity: NDArray[np.float32] | None = None
    ring: NDArray[np.int64] | None = None
    fixed: NDArray[np.bool_] | None = None
    masked: NDArray[np.bool_] | None = None
    shadow: NDArray[np.bool_] | None = None
    head: NDArray[np.int64] | None = None
    field: NDArray[np.float64] | None = None

    def __len__(self) -> int:
        """Count the points."""
        return len(self.t)

    @property
    def range(self) -> NDArray[np.float64]:
        """Distance from the sensor, which is the origin of its own frame, metres."""
        xyz = self.xyz if self.own is None else self.own
        distance: NDArray[np.float64] = np.sqrt(np.einsum('ij,ij->i', xyz, xyz))
        return distance

    @property
    def in_own_frame(self) -> Points:
        """The same points in the sensor's own frame; unchanged if they are in it already."""
        return self if self.own is None else replace(self, xyz=self.own, own=None)

    def take(
        self, index: NDArray[np.intp] | NDArray[np.bool_] | slice, allocate: Allocate = np.empty
    ) -> Points:
        """Choose points by index, mask or slice, in that order; ``allocate`` makes coordinates."""
        if not isinstance(index, slice) and index.dtype == np.bool_:
            index = np.flatnonzero(index)
        columns: dict[str, Any] = {}
        for name, column in vars(self).items():
            if column is not None and column.ndim > 1:
                columns[name] = _rows(column, index, allocate)
            else:
                columns[name] = None if column is None else column[index]
        return Points(**columns)


def _rows(
    xyz: NDArray[np.float64],
    index: NDArray[np.intp] | NDArray[np.bool_] | slice,
    allocate: Allocate,
) -> NDArray[np.float64]:
    """Choose rows of three: indexing takes four times as long."""
    if isinstance(index, slice):
        return xyz[index]
    if allocate is np.empty:
        return np.take(xyz, index, axis=0)
    rows: NDArray[np.float64] = allocate((len(index), 3), xyz.dtype)
    return np.take(xyz, index, axis=0, out=rows, mode='clip')  # other modes make a copy


def no_return(count: int) -> Points:
    """Return points without any return; they take no memory."""
    zero = np.broadcast_to(np.int64(0), count)
    return Points(
        np.broadcast_to(np.nan, (count, 3)), zero, zero, np.broadcast_to(np.False_, count)
    )


def is_return(xyz: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mark real returns: all three coordinates finite, and not all three 0."""
    valid, _ = _find_returns(xyz)
    return valid


def returns(xyz: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mark real returns as :func:`is_return` does; refuse impossible coordinates.

    Raises
    ------
    CloudError
        If a coordinate of a return is beyond ``FARTHEST``.

    """
    valid, absurd = _find_returns(xyz)
    if absurd >= 0:
        got = ', '.join(f'{value:g}' for value in xyz[absurd].tolist())
        raise CloudError('the coordinates of a point', f'within {FARTHEST:g} m, NaN or Inf', got)
    return valid


def check_sigma(sigma: NDArray[np.float64], valid: NDArray[np.bool_], what: str) -> None:
    """Refuse standard deviations, metres, that cannot be true.

    Raises
    ------
    CloudError
        If a valid point's value is not in ``LEAST_SIGMA_M`` to ``FARTHEST``.

    """
    wrong = valid & ~((sigma >= LEAST_SIGMA_M) & (sigma <= FARTHEST))
    if wrong.any():
        raise CloudError(what, f'from {LEAST_SIGMA_M:g} to {FARTHEST:g} m', f'{sigma[wrong][0]:g}')


def too_coarse(
    xyz: NDArray[np.float64], valid: NDArray[np.bool_], single: Sequence[bool], unit: float = 1.0
) -> str:
    """Return a warning if float32 coordinates are too coarse at their distance; else empty.

    The median distance of a sample counts, so that a single far point does not warn. From
    131 072 m on neighbouring float32 are more than ``COARSEST`` apart.

    Parameters
    ----------
    xyz, valid : positions, metres, and which of them are returns
    single : of x, y and z, whether it came as float32
    unit : size of the unit of the input, metres

    """
    where = np.flatnonzero(valid)
    if not len(where) or not any(single):
        return ''
    some = np.abs(xyz[where[:: -(-len(where) // SAMPLE_POINTS)]][:, np.array(single)])
    # No median is above the largest, which is found ten times as fast.
    if _step(float(some.max()), unit) <= COARSEST:
        return ''
    far = float(np.median(some, axis=0).max())
    step = _step(far, unit)
    if step <= COARSEST:
        return ''
    return (
        f'float32 coordinates of {far:.0f} m come in steps of {step:.3g} m, and what is finer is '
        'lost: use float64, or a frame near the sensor'
    )


def _step(far: float, unit: float) -> float:
    """Return how far apart float32 coordinates are there, all in metres."""
    return float(np.spacing(np.float32(far / unit))) * unit


def _find_returns(xyz: NDArray[np.float64]) -> tuple[NDArray[np.bool_], int]:
    """Return which points are returns, and the index of the first beyond ``FARTHEST``, or -1."""
    result = np.empty(len(xyz), np.bool_)
    return result, _kernels.mark_returns(xyz, FARTHEST, result)


def concatenate(parts: Sequence[Points]) -> Points:
    """Join points in the order given; all or none of the parts have a sigma, or an own frame.

    Missing intensities and fields become NaN if other parts have them.
    """
    if len(parts) == 1:
        return parts[0]
    for name, kind in (('intensity', np.float32), ('field', np.float64)):
        if any(getattr(part, name) is not None for part in parts):
            unknown: list[Any] = [{name: np.full(len(part), np.nan, kind)} for part in parts]
            parts = [
                replace(part, **nan) if getattr(part, name) is None else part
                for part, nan in zip(parts, unknown, strict=True)
            ]
    every = zip(*(vars(part).values() for part in parts), strict=True)
    columns: list[Any] = [None if one[0] is None else np.concatenate(one) for one in every]
    return Points(*columns)
