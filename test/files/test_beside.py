# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Tiles are judged with the points beside them, which other files of the folder hold."""

from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from pyproj import CRS

from lidar_outlier_filter import detect_outliers
from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.files.cloud_file import open_cloud
from lidar_outlier_filter.files.judged_file import CleanOptions, JudgedFile, judge_file
from lidar_outlier_filter.parameters.filter import FilterParameters

SIDE = 20.0  # m, of a tile


def ground(seed: int = 1) -> Floats:
    """Make four tiles of rough ground, some points off it, in millimetres of a projection."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform((0, 0, 0), (2 * SIDE - 0.01, 2 * SIDE - 0.01, 0.1), (20_000, 3))
    xyz[:200, 2] += rng.uniform(-6, 6, 200)
    placed: Floats = np.round(xyz, 3) + np.array([650_000.0, 5_400_000.0, 100.0])
    return placed


def write(path: Path, xyz: Floats, classes: Any = 2, epsg: int | None = None) -> Path:
    """Write a tile."""
    header = laspy.LasHeader(point_format=6, version='1.4')
    header.scales, header.offsets = np.full(3, 0.001), np.array([650_000.0, 5_400_000.0, 0.0])
    if epsg is not None:
        header.add_crs(CRS.from_epsg(epsg))
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = xyz.T
    cloud.classification = np.broadcast_to(np.uint8(classes), len(xyz))
    cloud.write(path)
    return path


def write_tiles(folder: Path, xyz: Floats, epsg: int | None = None) -> list[tuple[Path, Any]]:
    """Write the four tiles; return each with the indices of its points."""
    number = np.floor((xyz[:, 0] - 650_000.0) / SIDE) + 2 * np.floor(
        (xyz[:, 1] - 5_400_000.0) / SIDE
    )
    where = [np.flatnonzero(number == n) for n in range(4)]
    return [(write(folder / f'{n}.laz', xyz[own], epsg=epsg), own) for n, own in enumerate(where)]


def judged(path: Path, **options: Any) -> JudgedFile:
    """Judge a tile."""
    return judge_file(open_cloud(path), CleanOptions(dry=True, **options), FilterParameters())


def test_tiles_are_judged_as_the_merged_file(tmp_path: Path) -> None:
    """With a buffer as wide as all tiles, scores are the same; without, hundreds differ."""
    xyz = ground()
    tiles = write_tiles(tmp_path, xyz)
    merged = detect_outliers(xyz)
    assert merged.outlier.sum() > 50
    alone = 0
    for path, own in tiles:
        found = judged(path, buffer=3 * SIDE)
        assert found.loaded.note == f'judged beside other files: 3, points: {len(xyz) - len(own)}'
        np.testing.assert_allclose(found.verdict.score, merged.score[own], atol=2e-3)
        np.testing.assert_array_equal(found.verdict.rejected, merged.outlier[own])
        alone += int((judged(path).verdict.score != found.verdict.score).sum())
    assert alone > 100


def test_only_near_points_are_seen(tmp_path: Path) -> None:
    """Points beyond the buffer, of ignored classes, and copies of the tile are not counted."""
    xyz = ground()
    (path, own), *others = write_tiles(tmp_path, xyz)
    low, high = xyz[own, :2].min(axis=0), xyz[own, :2].max(axis=0)
    beside = np.concatenate([which for _, which in others])
    near = ((xyz[beside, :2] >= low - 3) & (xyz[beside, :2] <= high + 3)).all(axis=1).sum()
    assert judged(path, buffer=3.0).loaded.note == f'judged beside other files: 3, points: {near}'
    write(tmp_path / 'noise.las', xyz[beside] + (0, 0, 1), classes=7)
    note = judged(path, buffer=3.0, ignore=(7,)).loaded.note
    assert note == f'judged beside other files: 3, points: {near}'


def test_only_the_tile_is_written(tmp_path: Path) -> None:
    """Each output has the points of its own tile."""
    folder = tmp_path / 'tiles'
    folder.mkdir()
    tiles = write_tiles(folder, ground(), epsg=32632)
    output = tmp_path / 'cleaned'
    assert main(['clean', str(folder), '--output', str(output), '--buffer', '10']) == 0
    for path, own in tiles:
        (written,) = output.rglob(f'{path.stem}*.laz')
        assert len(laspy.read(written).points) == len(own)


def test_what_has_no_buffer_is_refused(tmp_path: Path) -> None:
    """Another coordinate system beside it, methods along lines, strips, and other formats."""
    path, _ = write_tiles(tmp_path, ground(), epsg=32632)[0]
    with pytest.raises(FilterError, match='--buffer must be at least 0 and finite'):
        judged(path, buffer=-1.0)
    with pytest.raises(FilterError, match='given without --strips'):
        judged(path, buffer=1.0, strips=True)
    along = FilterParameters().changed({'chain': ('alpha_beta_gamma',)})
    with pytest.raises(FilterError, match='no scan lines that go on in other files'):
        judge_file(open_cloud(path), CleanOptions(dry=True, buffer=1.0), along)
    write(tmp_path / '1.laz', ground(), epsg=25832)
    with pytest.raises(FilterError, match=r'the coordinate system of .*1\.laz'):
        judged(path, buffer=1.0)
    table = tmp_path / 'a.csv'
    table.write_text('x,y,z\n' + '1,2,3\n4,5,6\n' * 9)
    with pytest.raises(FilterError, match='LAS or LAZ with x, y and z, for --buffer'):
        judged(table, buffer=1.0)
