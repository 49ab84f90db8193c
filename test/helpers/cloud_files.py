# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the tests of cloud files share."""

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from numpy.typing import NDArray

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files import cloud_file
from lidar_outlier_filter.files.cloud_file import Change, open_cloud

VERDICT = ('outlier', 'outlier_score', 'outlier_detectors')


def columns(path: Path, *names: str, table: str | None = None) -> list[NDArray[Any]]:
    """Read columns of a file; none named: all."""
    file = open_cloud(path, table)
    chunks = cloud_file.read(file, names or list(file.columns))
    return [np.concatenate(column) for column in zip(*chunks, strict=True)]


def copied(path: Path, change: Change, name: str = '', table: str | None = None) -> Path:
    """Copy a file, changed, into a folder beside it; under its own name, if no other is given."""
    folder = path.parent / 'copied'
    folder.mkdir(exist_ok=True)
    target = folder / (name or path.name)
    file = open_cloud(path, table)
    done = list(cloud_file.copy(file, target, change))
    assert sorted(done) == done
    assert done[-1] >= len(file)
    return target


def check_refused(path: Path, old: str, new: str, sentence: str) -> None:
    """Put words in the place of others, and hold that the file is refused in one sentence."""
    data = path.read_bytes()
    assert old.encode() in data
    path.write_bytes(data.replace(old.encode(), new.encode(), 1))
    with pytest.raises(CloudError, match=sentence) as caught:
        columns(path)
    assert '\n' not in str(caught.value)


def verdict(count: int) -> dict[str, NDArray[Any]]:
    """Make up columns of a verdict; the first point is untested."""
    rng = np.random.default_rng(count)
    score = rng.gamma(1.0, size=count).astype(np.float32)
    score[0] = np.nan
    outlier = (score > 1).astype(np.uint8)
    return dict(zip(VERDICT, (outlier, score, outlier.astype(np.uint16) * 300), strict=True))


def every_third(count: int) -> NDArray[np.bool_]:
    """Keep all but every third point."""
    return np.arange(count) % 3 > 0


def write_las(path: Path, count: int, point_format: int = 6, record: str = '', **raw: Any) -> Path:
    """Write LAS 1.4 of points that are 0 but for some dimensions, which are not scaled.

    A ``record`` lies before the points, and one behind them.
    """
    header = laspy.LasHeader(point_format=point_format, version='1.4')
    if record:
        header.vlrs.append(laspy.VLR('someone', 77, '', record.encode()))
    points = laspy.ScaleAwarePointRecord.zeros(count, header=header)
    for name, values in raw.items():
        points[name] = values
    with laspy.open(path, 'w', header=header) as writer:
        writer.write_points(points)
        if record:
            behind = [laspy.VLR('someone', 78, '', record.encode())]
            writer.write_evlrs(laspy.vlrs.vlrlist.VLRList(behind))
    return path


def patch(path: Path, offset: int, data: bytes) -> Path:
    """Overwrite some bytes of a file."""
    whole = bytearray(path.read_bytes())
    whole[offset : offset + len(data)] = data
    path.write_bytes(whole)
    return path


def number(data: bytes, offset: int, size: int) -> int:
    """Read an unsigned number out of a header."""
    return int.from_bytes(data[offset : offset + size], 'little')


def run_sql(path: Path, *statements: str) -> list[tuple[Any, ...]]:
    """Run SQL in a database; return what the last statement finds."""
    with closing(sqlite3.connect(path)) as database, database:
        for statement in statements:
            found = database.execute(statement).fetchall()
    return found
