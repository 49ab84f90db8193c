# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Points of LAS are seen from where a trajectory says that the scanner was, as PROJ places it."""

from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from helpers.profile_scanner import MAP, POSITION, Drive, pose
from helpers.scans import RINGS, sweep
from pyproj import CRS, Proj
from scipy.spatial.transform import Rotation

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.files.cloud_file import open_cloud
from lidar_outlier_filter.files.judged_file import CleanOptions, JudgedFile, judge_file
from lidar_outlier_filter.parameters.filter import FilterParameters

GPS_TIME = 3.0e8  # s, as LAS has it: GPS time less 10^9
OF_WEEK = (GPS_TIME + 1e9) % 604_800  # s
STAMPS: Floats = np.arange(-1.0, 110.0) / 200
TOP = 'Time[s],Roll[deg],Pitch[deg],Yaw[deg],Easting[m],Northing[m],Height[m]'


def write(path: Path, xyz: Floats, t: Any, crs: str = 'EPSG:25832') -> Path:
    """Write LAS."""
    header = laspy.LasHeader(point_format=6, version='1.4')
    header.scales, header.offsets = np.full(3, 1e-4), MAP
    if crs:
        header.add_crs(CRS.from_user_input(crs))
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = xyz.T
    cloud.gps_time = np.broadcast_to(t, len(xyz))
    cloud.write(path)
    return path


def track(path: Path) -> Path:
    """Write the way of the vehicle, as a table or an SBET, by what PROJ says of the system."""
    position, rotation = pose(STAMPS)
    position, (yaw, *_) = position + MAP, rotation.as_euler('ZYX').T
    heading = np.pi / 2 - yaw
    if path.name == 'still.txt':
        position[:] = MAP
    if path.suffix == '.txt':
        np.savetxt(path, np.column_stack([GPS_TIME + STAMPS, position]), '%.9f')
    elif path.suffix == '.traj':
        none = np.zeros_like(yaw)
        rows = [OF_WEEK + STAMPS, none, none, np.degrees(heading) % 360, *position.T]
        np.savetxt(path, np.column_stack(rows), '%.9f', ',', header=TOP, comments='')
    else:
        system, wander = Proj('EPSG:25832'), 0.3
        longitude, latitude = system(position[:, 0], position[:, 1], inverse=True)
        north = np.radians(system.get_factors(longitude, latitude).meridian_convergence)
        records = np.zeros((len(yaw), 17), '<f8')
        records[:, :4] = np.stack(
            [OF_WEEK + STAMPS, np.radians(latitude), np.radians(longitude), position[:, 2]], axis=1
        )
        records[:, 9], records[:, 10] = heading + north + wander, wander
        records.tofile(path)
    return path


def judged(path: Path, trajectory: Path, **parameters: object) -> JudgedFile:
    """Judge a file by ranges."""
    changed = FilterParameters().changed({'chain': ('crop_box',), **parameters})
    return judge_file(open_cloud(path), CleanOptions(dry=True, trajectory=str(trajectory)), changed)


def seen(drive: Drive, xyz: Floats, *, turned: bool = True) -> Floats:
    """Return points ahead of, to the left of, and above the vehicle; or to the east and north."""
    position, rotation = pose(drive.t.astype(np.float64) * 1e-9)
    level = Rotation.from_euler('z', -rotation.as_euler('ZYX')[:, :1] * turned)
    found: Floats = level.apply(xyz - MAP - position)
    return found


@pytest.mark.parametrize('name', ['plain.txt', 'a.traj', 'sbet.out'])
def test_points_are_seen_from_the_scanner(tmp_path: Path, name: str) -> None:
    """Times are those of LAS, or of the week; without heading, x is east."""
    drive, turned = Drive(0.5), name != 'plain.txt'
    path = write(tmp_path / 'a.las', drive.fixed, GPS_TIME + drive.t * 1e-9)
    mounted = np.multiply(POSITION, (turned, turned, True))
    expected = seen(drive, drive.fixed, turned=turned) - mounted
    mounting = zip(('motion.x', 'motion.y', 'motion.z'), mounted.tolist(), strict=True)
    loaded = judged(path, track(tmp_path / name), **dict(mounting)).loaded
    assert loaded.points.own is not None
    np.testing.assert_allclose(loaded.points.own, expected, atol=3e-4)
    middle = np.median(np.sqrt((expected**2).sum(axis=1)))
    assert loaded.note.startswith(f'seen from {name}, {middle:.1f} m away')
    assert ('ellipsoidal' in loaded.note) == (name == 'sbet.out')


def test_points_below_the_track_are_rejected(tmp_path: Path) -> None:
    """As lastrack does: those within 3 m of the vehicle's side, and 0.4 m below it."""
    drive = Drive(0.5)
    low = (drive.fixed[:, 2] < MAP[2] + 0.1) & (np.arange(len(drive.t)) % 50 == 0)
    xyz = drive.fixed - np.outer(low, (0.0, 0.0, 0.8))
    path = write(tmp_path / 'a.las', xyz, GPS_TIME + drive.t * 1e-9)
    command = ['clean', str(path), '--trajectory', str(track(tmp_path / 'a.traj'))]
    for value in ('negative=true', 'max_z=-0.4', 'min_y=-3', 'max_y=3'):
        command += ['--set', f'crop_box.{value}']
    assert main([*command, '--chain', 'crop_box']) == 0
    expected = low & (np.abs(seen(drive, xyz)[:, 1]) < 3)
    assert 0 < expected.sum() < low.sum()
    marked = np.array(laspy.read(tmp_path / 'a_cleaned.las').classification) == 7
    np.testing.assert_array_equal(marked, expected)


def test_rings_are_recovered_from_a_map(tmp_path: Path) -> None:
    """A turn of a spinning sensor on a map is judged as in its own frame."""
    xyz = sweep(1, 0.0, columns=240).xyz
    path = write(tmp_path / 'a.las', xyz + MAP, GPS_TIME)
    found = judged(path, track(tmp_path / 'still.txt'), chain=('boosted_trees',))
    assert found.loaded.rings == len(RINGS)


def test_what_changes_is_cleaned_again(tmp_path: Path) -> None:
    """Of an archive, all files, if the trajectory is another one under its name."""
    (tmp_path / 'in').mkdir()
    write(tmp_path / 'in' / 'a.las', MAP + np.eye(3), GPS_TIME)
    path = track(tmp_path / 'still.txt')
    command = ['clean', str(tmp_path / 'in'), '--trajectory', str(path), '--chain', 'crop_box']
    command += ['--set', 'crop_box.max_range=9']
    for far in (0, 20):
        path.write_text(path.read_text().replace(' 100.', f' {100 + far}.'))
        assert main(command) == 0
        (output,) = (tmp_path / 'in_cleaned').glob('*.las')
        assert (np.array(laspy.read(output).classification) == 7).all() == (far > 9)


ROWS = '299999999.9 400000 5000000 100\n300000000.0 400000 5000000 100\n300000000.1 4e5 5e6 1e2\n'


@pytest.mark.parametrize(
    ('name', 'content', 'sentence'),
    [
        ('a.out', b'\0' * 271, 'of whole records of 136 bytes .SBET., got 271'),
        ('a.out', np.full(34, np.nan).tobytes(), 'must be'),
        ('a.txt', ROWS.replace('5e6', 'nan'), 'positions of .* must be finite'),
        ('a.txt', ROWS.replace('300000000.1', '300000000.0'), 'ascending'),
        ('a.txt', ROWS.replace('300000000', '300000001'), r'points, 300000000.000 to'),
        ('a.txt', ROWS.replace('0.0 ', '0.4 ').replace('0.1 ', '0.5 '), 'without gaps over 0.2 s'),
        ('a.txt', ROWS.replace('5000000', '51'), 'within 20000 m of them'),
        ('a.txt', 'time x y\n1 2 3\n2 3 4\n', 'must be time, x, y and z'),
    ],
)
def test_what_does_not_fit_is_refused(
    tmp_path: Path, name: str, content: str | bytes, sentence: str
) -> None:
    """In a sentence that says what it must be."""
    path = write(tmp_path / 'a.las', MAP + np.eye(3), GPS_TIME)
    (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(FilterError, match=sentence):
        judged(path, tmp_path / name)


def test_what_the_file_lacks_is_refused(tmp_path: Path) -> None:
    """A system, for SBET; one of heights that is known there; a heading, for what is ahead."""
    for crs, sentence in (
        ('', 'coordinate system of .* got none'),
        ('EPSG:32632+5703', 'projected to'),
    ):
        path = write(tmp_path / 'a.las', MAP + np.eye(3), GPS_TIME, crs)
        with pytest.raises(FilterError, match=sentence):
            judged(path, track(tmp_path / 'sbet.out'))
    with pytest.raises(FilterError, match=r'y must be 0 m, as .* has no heading'):
        judged(path, track(tmp_path / 'still.txt'), **{'motion.x': 1.0})
