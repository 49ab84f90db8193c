# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The points beside a tile: those of the LAS files in its folder that lie within a buffer."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.errors import CloudError, ParameterError
from lidar_outlier_filter.files import cloud_file
from lidar_outlier_filter.files.cloud_file import CloudFile, open_cloud
from lidar_outlier_filter.files.points import CLASSIFICATION, Loaded

_NUMBER = re.compile(r'^EPSG:\d+ ')  # some files name the number of a system, others do not
LAS_SUFFIXES = ('.las', '.laz')


def judge_with_buffer(
    file: CloudFile,
    axes: Mapping[str, float],
    loaded: Loaded,
    judge: Callable[[Points], Verdict],
    seen: tuple[float, Sequence[int]],
) -> tuple[Loaded, Verdict]:
    """Judge a tile with the points beside it; say in the note of the file whose they are.

    ``seen``: the width of the buffer, metres, and the classes that are left out.
    """
    own = loaded.points
    inside = own.xyz[own.valid]
    if len(inside) == 0:
        return loaded, judge(own)
    beside, names = _read_beside(file, axes, inside, *seen)
    xyz = np.concatenate([own.xyz, beside])
    zeros = np.zeros(len(xyz), np.int64)
    valid = np.append(own.valid, np.ones(len(beside), np.bool_))
    field = own.field
    if field is not None:  # that of the points beside it is not read
        field = np.append(field, np.full(len(beside), np.nan))
    found = judge(Points(xyz, zeros, zeros, valid, field=field))
    verdict = found.take(slice(len(own)))
    note = f'judged beside other files: {len(names)}, points: {len(beside)}'
    return loaded.noted(note), verdict


def _read_beside(
    file: CloudFile, axes: Mapping[str, float], xyz: Floats, buffer: float, ignore: Sequence[int]
) -> tuple[Floats, list[str]]:
    """Read the points (M, 3) within so many metres of a tile, and the names of files that have any.

    ``axes``: metres per unit of its columns x, y and z; ``xyz``: its points, metres; ``ignore``:
    classes whose points are left out.
    """
    if not 0 < buffer < np.inf:
        raise ParameterError('--buffer', 'at least 0 and finite', buffer)
    if not file.classes or [*axes] != ['x', 'y', 'z']:
        raise CloudError(
            f'the file {file.path}', 'LAS or LAZ with x, y and z, for --buffer', 'none'
        )
    low, high = xyz[:, :2].min(axis=0) - buffer, xyz[:, :2].max(axis=0) + buffer
    found, names, units = [np.empty((0, 3))], list[str](), np.array([*axes.values()])
    for path in _tiles_at(file.path, low / units[:2], high / units[:2]):
        other = open_cloud(path)
        systems = {_NUMBER.sub('', one.crs) for one in (file, other)} - {''}
        if len(systems) > 1 or other.metres != file.metres:
            must_be = f'that of {file.path}, for --buffer'
            raise CloudError(f'the coordinate system of {path}', must_be, other.crs or 'none')
        parts = []
        for *values, codes in cloud_file.read(other, [*axes, CLASSIFICATION]):
            some = np.stack(values, axis=1) * units
            near = ((some[:, :2] >= low) & (some[:, :2] <= high)).all(axis=1)
            parts.append(some[near & ~np.isin(codes, ignore)])
        if any(map(len, parts)):
            names.append(path.name)
            found += parts
    return np.concatenate(found), names


def _tiles_at(own: Path, low: Floats, high: Floats) -> Iterator[Path]:
    """Yield the other LAS files of the folder whose boxes touch this one, in units of the file."""
    # It needs laspy, which is no part of every installation.
    from lidar_outlier_filter.files.las_header import read_box  # noqa: PLC0415

    for path in sorted(own.absolute().parent.iterdir()):
        if path.suffix.lower() not in LAS_SUFFIXES or not path.is_file() or path.samefile(own):
            continue
        box = read_box(path)
        if box is not None and (box[0] <= high).all() and (box[1] >= low).all():
            yield path
