# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""LaserScan and MultiEchoLaserScan as clouds, and verdicts written back as scans of their shape.

The points are those that laser_geometry's ``projectLaser`` makes, bit for bit: angles and products
in float64, coordinates in float32, ranges from range_min on and below range_max. All others are
missing returns.
"""

import copy
import math
import sys
from array import array
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Bools, Floats, Ints, Rows, Singles
from lidar_outlier_filter.core.points.points import LONGEST_NS, SECOND
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.messages.cloud import DATATYPES

ANGLES = ('angle_min', 'angle_max', 'angle_increment')
NUMBERS = (*ANGLES, 'time_increment', 'range_min', 'range_max')  # nothing follows from scan_time
ATTRIBUTES = ('header', *NUMBERS, 'ranges', 'intensities')
TIME_FIELD, TIME_UNIT = 'time_ns', 'ns'  # from the stamp
POINT = np.dtype([('x', 'f4'), ('y', 'f4'), ('z', 'f4'), (TIME_FIELD, 'i8')])
BRIGHT_POINT = np.dtype([*POINT.descr, ('intensity', 'f4')])
TURN_RAD = 2.0 * math.pi
# Drivers that round, or count an angle more or less, are off by so much.
MAX_OFF_SHARE, MAX_OFF_ANGLES = 0.01, 2
MAX_SHOTS = 100_000  # of a turn: 0.0036 degrees apart
MAX_KEPT = 8  # directions of scans of one kind


class ScanCloud(SimpleNamespace):
    """The returns of a scan with the attributes of a PointCloud2, and the ``scan`` itself."""

    def split(self, rejected: Bools, requested: tuple[bool, bool]) -> tuple[Any, Any]:
        """Split into cleaned and outliers, two scans of the same shape; None if not requested.

        Ranges that are not in a scan are NaN, which REP 117 has for erroneous detections: +Inf
        would say that there is no object. All else is kept, byte for byte.
        """
        cleaned, outliers = requested
        return (
            _with_holes(self.scan, rejected) if cleaned else None,
            _with_holes(self.scan, ~rejected) if outliers else None,
        )


def is_scan(msg: Any) -> bool:
    """Return whether a message has what a scan has."""
    return hasattr(msg, 'ranges') and all(hasattr(msg, name) for name in ATTRIBUTES)


def as_cloud(scan: Any) -> ScanCloud:
    """Convert a scan to a cloud of one point for each range; of several echoes, beam by beam.

    Raises
    ------
    CloudError
        If its numbers or lengths contradict each other.

    """
    ranges, beam = _flat(scan.ranges, 'ranges')
    _refuse_numbers(scan)
    _refuse_angles(scan)
    intensities, of_beam = _flat(scan.intensities, 'intensities')
    rows = np.zeros(len(ranges), BRIGHT_POINT if len(intensities) else POINT)
    if len(intensities):
        if not np.array_equal(beam, of_beam):
            must_be = f'one for each of the {len(ranges)} ranges, or none'
            raise CloudError('the intensities of a scan', must_be, len(intensities))
        rows['intensity'] = intensities
    axes = _directions(scan.angle_min, scan.angle_increment, len(scan.ranges))
    with np.errstate(invalid='ignore'):
        is_return = (ranges >= np.float32(scan.range_min)) & (ranges < np.float32(scan.range_max))
        for axis, direction in zip('xy', axes, strict=True):
            rows[axis] = np.where(is_return, ranges * direction[beam], np.nan)
    rows[TIME_FIELD] = np.rint(beam * (scan.time_increment * SECOND))
    return _cloud(scan, rows)


def _flat(ranges: Any, name: str) -> tuple[Singles, Ints]:
    """Return all values, and the beam of each."""
    try:
        if _has_echoes(ranges):
            echoes = [np.asarray(beam.echoes, np.float32) for beam in ranges]
            counts = [len(one) for one in echoes]
            return np.concatenate(echoes), np.repeat(np.arange(len(echoes)), counts)
        flat = np.asarray(ranges, np.float32)
    except (TypeError, ValueError, AttributeError) as err:
        raise CloudError(f'the {name} of a scan', 'float32', type(ranges).__name__) from err
    if flat.ndim != 1:
        raise CloudError(f'the {name} of a scan', 'an array of one dimension', flat.shape)
    return flat, np.arange(len(flat))


def _has_echoes(ranges: Any) -> bool:
    return len(ranges) > 0 and hasattr(ranges[0], 'echoes')


def _refuse_numbers(scan: Any) -> None:
    for name in NUMBERS:
        value = getattr(scan, name)
        if not (math.isfinite(value) or (name == 'range_max' and value > 0)):
            raise CloudError(f'{name} of a scan', 'finite', f'{value:g}')
    if not 0 <= scan.range_min < scan.range_max:
        got = f'{scan.range_min:g} and {scan.range_max:g} m'
        raise CloudError('range_min of a scan', '0 or more, and below range_max', got)
    if not 0 <= scan.time_increment * SECOND * max(len(scan.ranges), 1) < LONGEST_NS:
        must_be, got = 'from 0 on, and a scan of less than 73 years', f'{scan.time_increment:g} s'
        raise CloudError('time_increment of a scan', must_be, got)


def _refuse_angles(scan: Any) -> None:
    """Refuse angles that are not those of the ranges; to the right they count down."""
    count, first, last = len(scan.ranges), scan.angle_min, scan.angle_max
    if count > MAX_SHOTS:
        raise CloudError('the ranges of a scan', f'of at most {MAX_SHOTS} shots', count)
    if max(abs(first), abs(last)) > TURN_RAD * (1 + MAX_OFF_SHARE):
        got = f'{first:g} and {last:g} rad'
        raise CloudError('angle_min and angle_max of a scan', 'within a turn of 0', got)
    if count < 2:  # noqa: PLR2004  a single range has no step
        return
    step = scan.angle_increment
    if step == 0 or abs(step) * (count - 1) > TURN_RAD * (1 + MAX_OFF_SHARE):
        must_be = f'not 0, and {count} ranges within a turn'
        raise CloudError('angle_increment of a scan', must_be, f'{step:g} rad')
    steps = (last - first) / step
    if abs(steps - (count - 1)) > MAX_OFF_ANGLES + MAX_OFF_SHARE * count:
        must_be = f'as many as steps from {first:g} to {last:g} rad by {step:g}, about {steps:.0f}'
        raise CloudError('the ranges of a scan', must_be, count)


@lru_cache(maxsize=MAX_KEPT)
def _directions(first: float, step: float, count: int) -> tuple[Floats, Floats]:
    """Return cosine and sine of each angle, by the functions of laser_geometry."""
    angles = [first + k * step for k in range(count)]
    return np.array([math.cos(a) for a in angles]), np.array([math.sin(a) for a in angles])


def _cloud(scan: Any, rows: Rows) -> ScanCloud:
    columns: Any = rows.dtype.fields
    return ScanCloud(
        scan=scan,
        header=scan.header,
        height=1,
        width=len(rows),
        fields=[
            SimpleNamespace(name=name, offset=offset, datatype=DATATYPES[kind.str[1:]], count=1)
            for name, (kind, offset) in columns.items()
        ],
        is_bigendian=sys.byteorder == 'big',
        point_step=rows.dtype.itemsize,
        row_step=rows.nbytes,
        data=rows.view(np.uint8),
        is_dense=False,
    )


def _with_holes(scan: Any, left_out: Bools) -> Any:
    """Copy a scan, some of its ranges NaN."""
    result = copy.copy(scan)
    if not len(left_out):
        return result
    if _has_echoes(scan.ranges):
        ends = np.cumsum([len(beam.echoes) for beam in scan.ranges])
        parts = np.split(left_out, ends[:-1])
        result.ranges = [_echoes(*both) for both in zip(scan.ranges, parts, strict=True)]
    else:
        result.ranges = _holed(scan.ranges, left_out)
    return result


def _echoes(beam: Any, left_out: Bools) -> Any:
    result = copy.copy(beam)
    result.echoes = _holed(beam.echoes, left_out)
    return result


def _holed(values: Any, left_out: NDArray[np.bool_]) -> Any:
    """Copy values in the type that the message has, some of them NaN."""
    holed = np.array(values, np.float32)
    holed[left_out] = np.nan
    if isinstance(values, np.ndarray):
        return holed
    result = array('f')
    result.frombytes(holed.tobytes())
    return result
