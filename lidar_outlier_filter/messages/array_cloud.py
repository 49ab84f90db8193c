# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A structured array as a PointCloud2, and back again, so that both go the same way."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Rows
from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.messages.cloud import DATATYPES, DTYPES, SCORE_FIELDS, laid_out
from lidar_outlier_filter.messages.laser_scan import as_cloud, is_scan

ATTRIBUTES = ('header', 'height', 'width', 'fields', 'is_bigendian', 'point_step', 'row_step')
A_CLOUD = 'a structured array with the fields x, y and z, a PointCloud2 or a LaserScan'


class ArrayCloud(SimpleNamespace):
    """The points of a structured array, with the attributes of a PointCloud2 and its ``dtype``.

    Its ``fields`` are those of a type that PointCloud2 knows. The others, and the padding, are kept
    as bytes of the point. ``header.stamp`` is None where nobody gave one.
    """

    @property
    def rows(self) -> Rows:
        """The points as a structured array: (N,), or (height, width) where there are more rows.

        The dtype is the given one, and the fields of the scores behind it where they were added.
        """
        rows = np.asarray(self.data).view(self._dtype())
        return rows.reshape(self.height, self.width) if self.height > 1 else rows

    def _dtype(self) -> np.dtype[np.void]:
        given: np.dtype[np.void] = self.dtype
        if self.point_step == given.itemsize:
            return given
        fields: Any = given.fields
        columns = {name: fields[name][:2] for name in given.names or ()}
        order = '>' if self.is_bigendian else '<'
        for item in self.fields[-len(SCORE_FIELDS) :]:
            columns[item.name] = (order + DTYPES[item.datatype], item.offset)
        return laid_out(columns, self.point_step)


def as_message(cloud: Any, stamp: int | np.integer[Any] | None = None) -> Any:
    """Give a cloud the attributes of a PointCloud2, unless it has them.

    Parameters
    ----------
    cloud : structured array of shape (N,) or (height, width), or a message
        Anything like a PointCloud2, a LaserScan or a MultiEchoLaserScan. An array is not copied
        where its points lie together in memory.
    stamp : int, optional
        Reference of an array's relative times, nanoseconds. A message has its own.

    Raises
    ------
    CloudError
        If it is neither, or cannot be read.

    """
    if is_scan(cloud):
        cloud = as_cloud(cloud)
    if not isinstance(cloud, np.ndarray):
        if not all(hasattr(cloud, name) for name in (*ATTRIBUTES, 'data')):
            raise CloudError('a cloud', A_CLOUD, f'{type(cloud).__name__}')
        if stamp is not None:
            raise CloudError('the stamp', 'that of the message', stamp)
        return cloud
    _refuse(cloud)
    if stamp is not None and not isinstance(stamp, int | np.integer):
        raise CloudError('the stamp', 'a whole number of nanoseconds', repr(stamp))
    table = np.asarray(cloud)[np.newaxis] if cloud.ndim == 1 else np.asarray(cloud)
    # As plain bytes: a copy of a structured array would lose its padding.
    plain = table.view(np.dtype((np.void, cloud.dtype.itemsize)))
    fields, is_bigendian = _fields(cloud.dtype)
    sec, nanosec = divmod(0 if stamp is None else int(stamp), SECOND)
    time = None if stamp is None else SimpleNamespace(sec=sec, nanosec=nanosec)
    height, width = table.shape
    return ArrayCloud(
        header=SimpleNamespace(stamp=time, frame_id=''),
        height=height,
        width=width,
        fields=fields,
        is_bigendian=is_bigendian,
        point_step=cloud.dtype.itemsize,
        row_step=cloud.dtype.itemsize * width,
        data=np.ascontiguousarray(plain).reshape(-1).view(np.uint8),
        dtype=cloud.dtype,
        is_dense=False,
    )


def as_given(cloud: Any) -> Any:
    """Undo :func:`as_message` for an output: a cloud that was an array becomes one again."""
    return cloud.rows if isinstance(cloud, ArrayCloud) else cloud


def _refuse(cloud: NDArray[Any]) -> None:
    if not cloud.dtype.names:
        raise CloudError('a cloud', A_CLOUD, f'an array of {cloud.dtype}, {cloud.shape}')
    if isinstance(cloud, np.ma.MaskedArray):
        raise CloudError('a cloud', 'without a mask', 'a masked array')
    if cloud.ndim not in {1, 2}:
        raise CloudError('the shape of a cloud', '(N,) or (height, width)', cloud.shape)
    if cloud.dtype.hasobject:
        raise CloudError('the fields', 'without Python objects', str(cloud.dtype))


def _fields(dtype: np.dtype[np.void]) -> tuple[list[Any], bool]:
    """Describe the fields that PointCloud2 has types for, and give their byte order."""
    described: list[Any] = []
    orders: dict[bool, str] = {}  # a field of each
    columns: Any = dtype.fields
    for name in dtype.names or ():
        kind, offset = columns[name][:2]
        base, shape = kind.subdtype or (kind, ())
        datatype, count = DATATYPES.get(base.str[1:]), math.prod(shape)
        if datatype is None or count == 0 or not name:
            continue
        described.append(SimpleNamespace(name=name, offset=offset, datatype=datatype, count=count))
        if base.itemsize > 1:
            orders.setdefault(base.str[0] == '>', name)
    if len(orders) > 1:
        got = ' and '.join(map(repr, orders.values()))
        raise CloudError('the byte order of the fields', 'the same for all', f'two, of {got}')
    return described, next(iter(orders), False)
