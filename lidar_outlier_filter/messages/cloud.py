# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""PointCloud2 as one structured array, and its split into two clouds.

Messages are duck-typed: those of sensor_msgs and of rosbags serve alike. No message is ever
changed.
"""

import copy
from array import array
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Bools, Bytes, Rows
from lidar_outlier_filter.core.verdict import DETECTORS, EXTRA, REASON, SCORE, Verdict
from lidar_outlier_filter.errors import CloudError

# Index is PointField.datatype; 9 to 11 are PCL's, and ROS's after Jazzy: int64, uint64, bool.
DTYPES = ('', 'i1', 'u1', 'i2', 'u2', 'i4', 'u4', 'f4', 'f8', 'i8', 'u8', 'u1')
# PointField.datatype by numpy's name without byte order
DATATYPES = {'b1': 2, **{name: number for number, name in enumerate(DTYPES[:11]) if name}}
AXES = ('x', 'y', 'z')
MAX_LAYOUTS = 64  # of one topic, which has one or two
MAX_NAME_CHARS = 10_000  # characters of the names of all fields
NUMBER = 'outlier_detector_number'
# What `scores` adds behind each point, by numpy's names of the types
SCORE_FIELDS = {SCORE: 'f4', DETECTORS: 'u2', NUMBER: 'u1', REASON: 'u1'}
BYTES_OF_SCORES = sum(np.dtype(kind).itemsize for kind in SCORE_FIELDS.values())


def structured(msg: Any) -> Rows:
    """View the points of a PointCloud2 as a (height, width) structured array, without a copy.

    The dtype has the fields' own names, types, counts, offsets and byte order; its itemsize is
    ``point_step``, so that padding belongs to the rows.

    Raises
    ------
    CloudError
        If the fields or sizes contradict each other.

    """
    if msg.row_step < msg.width * msg.point_step:
        must_be = f'at least width × point_step = {msg.width * msg.point_step}'
        raise CloudError('row_step', must_be, msg.row_step)
    if len(msg.data) < msg.row_step * msg.height:
        must_be = f'at least row_step × height = {msg.row_step * msg.height} bytes'
        raise CloudError('data', must_be, len(msg.data))
    fields = tuple((item.name, item.datatype, item.offset, item.count) for item in msg.fields)
    length = sum(len(name) for name, *_ in fields)
    if length > MAX_NAME_CHARS:
        raise CloudError('the names of the fields', f'at most {MAX_NAME_CHARS} characters', length)
    dtype = _dtype(fields, msg.point_step, is_bigendian=bool(msg.is_bigendian))
    shape, strides = (msg.height, msg.width), (msg.row_step, msg.point_step)
    return np.ndarray(shape, dtype, np.frombuffer(msg.data, np.uint8), 0, strides)


@lru_cache(maxsize=MAX_LAYOUTS)
def _dtype(
    fields: tuple[tuple[str, int, int, int], ...], point_step: int, *, is_bigendian: bool
) -> np.dtype[np.void]:
    """Check the fields of a cloud and make their dtype."""
    columns: dict[str, tuple[Any, int]] = {}
    for name, datatype, offset, count in fields:
        if not 1 <= datatype < len(DTYPES):
            raise CloudError('the datatype of a field', 'from 1 to 11', f'{datatype} for {name!r}')
        if count < 1:
            raise CloudError('the count of a field', 'at least 1', f'{count} for {name!r}')
        if not name or name in columns:
            raise CloudError('the names of the fields', 'given and different', repr(name))
        if name in AXES and count > 1:
            raise CloudError(f'field {name!r}', 'a single number', count)
        kind = np.dtype(('>' if is_bigendian else '<') + DTYPES[datatype])
        end = offset + kind.itemsize * count
        if end > point_step:
            must_be = f'at least {end}, the end of field {name!r}'
            raise CloudError('point_step', must_be, point_step)
        columns[name] = (kind if count == 1 else np.dtype((kind, (count,))), offset)
    if not columns.keys() >= set(AXES):
        raise CloudError('the fields', 'with x, y and z', ', '.join(columns) or 'none')
    return laid_out(columns, point_step)


def laid_out(columns: Mapping[str, tuple[Any, int]], point_step: int) -> np.dtype[np.void]:
    """Return the dtype of rows whose columns have these types and offsets."""
    layout: Any = {
        'names': list(columns),
        'formats': [kind for kind, _ in columns.values()],
        'offsets': [offset for _, offset in columns.values()],
        'itemsize': point_step,
    }
    return np.dtype(layout)  # type: ignore[no-any-return]


def is_empty(msg: Any) -> bool:
    """Return whether a cloud has no points; such a cloud need not even have fields."""
    return bool(msg.width * msg.height == 0)


def is_organised(msg: Any) -> bool:
    """Return whether a cloud has points, and more than one row of them."""
    return bool(msg.height > 1 and msg.width)


def split(  # noqa: PLR0913  what a cloud has, and how it is split
    msg: Any,
    verdict: Verdict,
    *,
    keep_organized: bool = False,
    scores: bool = False,
    left_out: Bools | None = None,
    requested: tuple[bool, bool] = (True, True),
) -> tuple[Any, Any]:
    """Split a cloud into cleaned and outliers: every point in one of them, in order, byte for byte.

    Both are unorganised (height 1) and have the header, the fields and the layout of ``msg``.

    Parameters
    ----------
    msg : PointCloud2
    verdict : Verdict
        Of its points, row by row.
    keep_organized : bool
        The cleaned cloud of an organised one keeps its shape; rejected points become NaN.
    scores : bool
        Both clouds gain ``SCORE_FIELDS``.
    left_out : (N,) bool, optional
        Missing returns that are in neither cloud; the cleaned one is dense then.
    requested : (bool, bool)
        Which of the two to make; the other is None.

    """
    if not any(requested):
        return None, None
    rows, step, fields = plain_rows(msg), msg.point_step, msg.fields
    if scores and fields:
        rows, fields = _rows_with_scores(msg, rows, verdict), more_fields(msg, SCORE_FIELDS)
        step += BYTES_OF_SCORES
    rejected = verdict.rejected
    outliers = with_rows(msg, rows[rejected], fields, step) if requested[1] else None
    if not requested[0]:
        return None, outliers
    if keep_organized and is_organised(msg):
        holes = _with_holes(rows, structured(msg).dtype, rejected)
        organised = with_rows(msg, holes, fields, step, msg.height)
        organised.is_dense = bool(msg.is_dense) and not rejected.any()
        return organised, outliers
    if left_out is None:
        return with_rows(msg, rows[~rejected], fields, step), outliers
    cleaned = with_rows(msg, rows[~(rejected | left_out)], fields, step)
    cleaned.is_dense = True
    return cleaned, outliers


def plain_rows(msg: Any) -> Rows:
    """Give each point as plain bytes: a copy of a structured array would lose its padding."""
    if is_empty(msg):
        return np.empty(0, np.dtype((np.void, 1)))
    plain = structured(msg).view(np.dtype((np.void, msg.point_step)))
    return np.ascontiguousarray(plain).reshape(-1)


def first_numbers(detectors: NDArray[np.uint16]) -> Bytes:
    """Return the number of the lowest detector bit: 1 for bit 1, 2 for 2, 3 for 4; 0: no bit.

    15: the own vehicle.

    Viewers space colours evenly over numbers: sums of bits would give similar colours.
    """
    bits = detectors & np.uint16(0xFFFF & ~EXTRA)
    lowest = bits & (~bits + np.uint16(1))
    return np.frexp(lowest.astype(np.float32))[1].astype(np.uint8)


def _rows_with_scores(msg: Any, rows: Rows, verdict: Verdict) -> Rows:
    order = '>' if msg.is_bigendian else '<'
    added = [(name, order + kind) for name, kind in SCORE_FIELDS.items()]
    wider = np.empty(len(rows), np.dtype([('point', rows.dtype), *added]))
    wider['point'] = rows
    wider[SCORE] = verdict.score
    wider[DETECTORS] = verdict.detectors
    wider[NUMBER] = first_numbers(verdict.detectors)
    wider[REASON] = verdict.reason
    return wider.view(np.dtype((np.void, wider.dtype.itemsize)))


def more_fields(msg: Any, added: Mapping[str, str]) -> list[Any]:
    """Append fields of one number each behind those of the points: numpy types by name."""
    fields, offset = list(msg.fields), msg.point_step
    for name, kind in added.items():
        item = copy.copy(msg.fields[0])
        item.name, item.offset, item.datatype, item.count = name, offset, DATATYPES[kind], 1
        fields.append(item)
        offset += np.dtype(kind).itemsize
    return fields


def _with_holes(rows: Rows, dtype: np.dtype[np.void], rejected: Bools) -> Rows:
    """Copy the rows, x, y and z of the rejected ones NaN."""
    holes = rows.copy()
    for axis in AXES:
        kind, offset = dtype.fields[axis][:2]  # type: ignore[index]
        column = np.ndarray(len(holes), kind, holes, offset, (holes.itemsize,))
        column[rejected] = np.nan
    return holes


def with_rows(msg: Any, rows: Rows, fields: Any, step: int, height: int = 1) -> Any:
    """Copy a message with other points."""
    result = copy.copy(msg)
    result.height = height
    result.width = len(rows) // height
    result.fields = fields
    result.point_step = step
    result.row_step = result.width * step
    result.data = _like(msg.data, rows)
    return result


def _like(data: Any, rows: Rows) -> Any:
    """Give the bytes of the rows in the type that the message's own data has.

    A memoryview, of a cloud as it was received, becomes an array: that can be sent.
    """
    plain = rows.view(np.uint8) if rows.size else np.empty(0, np.uint8)
    if isinstance(data, array | memoryview):
        result = array('B')
        result.frombytes(plain.data)
        return result
    return plain if isinstance(data, np.ndarray) else type(data)(plain.tobytes())
