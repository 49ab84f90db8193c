# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The default as it is shipped, on sweeps of WADS: by the code of the node, or of `clean`."""

# ruff: noqa: INP001  a part of a script, no package

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np
from real_snow_forms import Verdict

from lidar_outlier_filter import CloudFilter
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.files.clean import clean_file
from lidar_outlier_filter.files.judged_file import CleanOptions
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.parameters.yaml_files import read_yaml

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray
    from real_snow_forms import Cloud
    from real_snow_sweeps import Mask

    from lidar_outlier_filter.files.judged_file import JudgedFile

HESAI = Path(__file__).resolve().parents[1] / 'config' / 'hesai.yaml'  # as the quick start says
XYZI = [('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('intensity', '<f4')]
MESSAGE = np.dtype([*XYZI, ('ring', '<u2'), ('timestamp', '<f8'), ('index', '<u4')])
FILE = np.dtype(XYZI)
PCD = """VERSION 0.7
FIELDS x y z intensity
SIZE 4 4 4 4
TYPE F F F F
COUNT 1 1 1 1
WIDTH {0}
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS {0}
DATA binary
"""


def judge(clouds: Sequence[Cloud]) -> Verdict:
    """Judge clouds as a stream where they have rings and times, and else as files."""
    bare = any(one.ring is None for one in clouds)
    return as_files(clouds) if bare else as_stream(clouds)


def as_stream(clouds: Sequence[Cloud]) -> Verdict:
    """Judge clouds one after the other, as the node and `replay` do."""
    messages = [message(one) for one in clouds]
    filters = [CloudFilter(read_yaml(HESAI)) for _ in range(2)]
    filters[0].push(messages[0])  # what is compiled or read once is no part of the time
    filters[0].flush()
    begin = perf_counter()
    answers = [answer for one in messages for answer in filters[1].push(one)]
    answers += filters[1].flush()
    seconds = perf_counter() - begin
    if len(answers) != len(clouds):
        raise RecordingError('the answers', f'{len(clouds)}, one for each sweep', len(answers))
    rejected = []
    for one, answer in zip(clouds, answers, strict=True):
        mask = np.zeros(len(one), np.bool_)
        mask[answer.outliers['index']] = True
        rejected.append(mask)
    return Verdict(rejected, seconds, '')


def message(cloud: Cloud) -> NDArray[np.void]:
    """Lay out a cloud as Hesai's driver does, and number its points."""
    points = _points(cloud, MESSAGE)
    points['ring'] = cloud.ring
    points['timestamp'] = np.asarray(cloud.time) / 1e9
    points['index'] = np.arange(len(cloud))
    return points


def as_files(clouds: Sequence[Cloud]) -> Verdict:
    """Judge each cloud alone, as `clean` does; writing the answer is no part of the time."""
    rejected: list[Mask] = []

    def look(judged: JudgedFile) -> None:
        rejected.append(judged.verdict.rejected)

    with TemporaryDirectory() as folder:
        paths = [_write(one, Path(folder)) for one in clouds]
        output, dry = Path(folder, 'cleaned.pcd'), CleanOptions(dry=True)
        # What is compiled or read once is no part of the time.
        clean_file(paths[0], output, FilterParameters(), dry)
        begin = perf_counter()
        for path in paths:
            clean_file(path, output, FilterParameters(), dry, inspect=look)
        return Verdict(rejected, perf_counter() - begin, '')


def _write(cloud: Cloud, folder: Path) -> Path:
    """Write a cloud as PCD of x, y, z and intensity alone."""
    path = folder / f'{Path(cloud.name).stem}.pcd'
    path.write_bytes(PCD.format(len(cloud)).encode() + _points(cloud, FILE).tobytes())
    return path


def _points(cloud: Cloud, layout: np.dtype[np.void]) -> NDArray[np.void]:
    points = np.zeros(len(cloud), layout)
    for axis, column in zip('xyz', cloud.xyz.T, strict=True):
        points[axis] = column
    points['intensity'] = cloud.intensity
    return points
