# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What is in a file of points: its columns, and from where to where they reach."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.detectors.registry import explanations
from lidar_outlier_filter.core.detectors.seen import Seen
from lidar_outlier_filter.core.scan_pattern.recovered_rings import MOST_POINTS
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.cleaning import points
from lidar_outlier_filter.files.cloud_file import open_cloud, readable
from lidar_outlier_filter.parameters.filter import FilterParameters

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from lidar_outlier_filter.files.cloud_file import CloudFile


@dataclass(frozen=True)
class FileInfo:
    """Points, the types of the columns by name, and the least and largest number of each.

    ``rings`` is how many were recovered from elevations, for want of times or scan lines; 0: none.
    ``way`` is how the default judges the file, for people; empty: nobody looked.
    """

    points: int
    columns: Mapping[str, str]
    extent: Mapping[str, tuple[float, float]]
    rings: int = 0
    way: str = ''


def look_at_file(path: Path) -> FileInfo:
    """Read a file once, chunk by chunk.

    Raises
    ------
    CloudError
        If it cannot be read.

    """
    file = open_cloud(path)
    names = [name for name, kind in file.columns.items() if kind.kind in 'iuf']
    extent: dict[str, tuple[float, float]] = {}
    with readable(path):
        for chunk in file.read(names):
            for name, values in zip(names, chunk, strict=True):
                known = np.ma.compressed(values)
                known = known[np.isfinite(known)]
                if len(known):
                    low, high = extent.get(name, (np.inf, -np.inf))
                    extent[name] = min(low, float(known.min())), max(high, float(known.max()))
    types = {name: str(kind) for name, kind in file.columns.items()}
    return FileInfo(len(file), types, extent, *_judged(file))


def _judged(file: CloudFile) -> tuple[int, str]:
    """Count the rings that ``clean`` would recover of a file, and say how it would judge."""
    if len(file) > MOST_POINTS:
        return 0, ''
    parameters = FilterParameters()
    try:
        coordinates = points.choose_coordinates(file, ())
        loaded = points.load(file, coordinates, parameters, timed=True)
    except CloudError:  # `clean` says it
        return 0, ''
    if loaded.lack:
        loaded = points.recovered(file, loaded, parameters)
    valid = loaded.points.take(loaded.points.valid)
    seen = Seen(valid, parameters, whole=True)
    known = (explanations()[name] for name in parameters.chain if name in explanations())
    return loaded.rings, '; '.join(one.choose(seen, parameters) for one in known)
