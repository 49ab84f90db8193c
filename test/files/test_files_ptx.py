# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""PTX: the grids of all scans stay whole, lines keep their bytes, poses put them together."""

from pathlib import Path

import numpy as np
import pytest
from helpers.cloud_files import check_refused, columns, copied, every_third

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.files.cloud_file import Change, open_cloud

# The second scan stands at (100, 200, 3) and faces y: its x is y, its y is -x.
POSES = (
    '0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n',
    '100 200 3\r\n0 1 0\r\n-1 0 0\r\n0 0 1\r\n0 1 0 0\r\n-1 0 0 0\r\n0 0 1 0\r\n100 200.0 3 1\r\n',
)
FIRST = ['1 2 3 0.125', '+1.50 0 0e0 .5', '0 0 0 0.5', ' 4 5 6 1', '0.0 -0 0 0.250', '7 8 9 0']
SECOND = ['1 0 0 0.5', '0 0 0 0.500000', '0 2 1 0.25']


def make(path: Path, first: list[str] = FIRST, second: list[str] = SECOND) -> Path:
    """Write two scans, 3 × 2 and 1 × 3, the second with ends of Windows, the last without one."""
    text = '3\n2\n' + POSES[0] + ''.join(f'{line}\n' for line in first)
    text += '1\r\n3\r\n' + POSES[1] + '\r\n'.join(second)
    path.write_bytes(text.encode())
    return path


def test_points_of_all_scans(tmp_path: Path) -> None:
    """Poses put them into one frame; a missing return has no place, and its intensity stays."""
    x, y, z, intensity = columns(make(tmp_path / 'two.ptx'))
    nan = np.nan
    np.testing.assert_array_equal(x, [1, 1.5, nan, 4, nan, 7, 100, nan, 98])
    np.testing.assert_array_equal(y, [2, 0, nan, 5, nan, 8, 201, nan, 200])
    np.testing.assert_array_equal(z, [3, 0, nan, 6, nan, 9, 3, nan, 4])
    np.testing.assert_array_equal(intensity, [0.125, 0.5, 0.5, 1, 0.25, 0, 0.5, 0.5, 0.25])
    assert columns(tmp_path / 'two.ptx', 'intensity')[0].tolist() == intensity.tolist()


def test_what_is_left_out_is_missing(tmp_path: Path) -> None:
    """The grid stays whole, in the form of missing returns; other lines keep their bytes."""
    path = make(tmp_path / 'two.ptx')
    copy = copied(path, Change(keep=every_third(9)))
    lines, new = path.read_bytes().split(b'\n'), copy.read_bytes().split(b'\n')
    assert len(lines) == len(new)
    changed = {i: line for i, line in enumerate(new) if line != lines[i]}
    assert changed == {10: b'0 0 0 0.5', 13: b'0 0 0 0.5', 26: b'0 0 0 0.5\r'}
    assert len(open_cloud(copy)) == 9


def test_colours(tmp_path: Path) -> None:
    """Lines of seven numbers have colours; there, missing returns are black."""
    first, second = ([f'{line} 1 2 255' for line in part] for part in (FIRST, SECOND))
    path = make(tmp_path / 'two.ptx', first, second)
    assert list(open_cloud(path).columns) == ['x', 'y', 'z', 'intensity', 'red', 'green', 'blue']
    assert columns(path, 'blue')[0].tolist() == [255] * 9
    copy = copied(path, Change(keep=np.arange(9) != 8))
    assert copy.read_bytes().endswith(b'\r\n0 0 0 0.5 0 0 0')
    mixed = make(tmp_path / 'mixed.ptx', first)
    assert list(open_cloud(mixed).columns) == ['x', 'y', 'z', 'intensity']
    assert copied(mixed, Change()).read_bytes() == mixed.read_bytes()


def test_blank_lines(tmp_path: Path) -> None:
    """They are no points, wherever they stand, and stay in a copy."""
    first, second = ['', *FIRST[:2], '', ' ', *FIRST[2:]], [SECOND[0], '', *SECOND[1:]]
    path = make(tmp_path / 'two.ptx', first, second)
    assert len(columns(path)[0]) == 9
    assert copied(path, Change()).read_bytes() == path.read_bytes()
    copy = copied(path, Change(keep=np.arange(9) != 0))
    expected = path.read_bytes().replace(FIRST[0].encode(), b'0 0 0 0.5', 1)
    assert copy.read_bytes() == expected


def test_no_columns_are_added(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A line has no place for scores."""
    path = make(tmp_path / 'two.ptx')
    assert main(['clean', '--chain', 'sor', '--set', 'scores=true', str(path)]) == 1
    assert 'must be left out: a line of PTX has no place for them' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('old', 'new', 'sentence'),
    [
        ('3\n2\n', '3.0\n2\n', 'the columns of scan 1 of .* must be a whole number'),
        ('3\n2\n', '3\n3\n', 'the columns of scan 2 of'),
        *(
            ('3\n2\n', f'{c}\n{r}\n', 'of scan 1 of')
            for c, r in ((1, 10**17), (10**9, 10**9), (-2, -3))
        ),
        ('3\n2\n', '1\n2\n', 'the columns of scan 2 of .* must be a whole number'),
        ('1\r\n3\r\n', '1\r\n2\r\n', 'the columns of scan 3 of'),
        ('1\r\n3\r\n', '2\r\n2\r\n', 'must be of 4 points, as it says, got 3'),
        ('1 0 0 0\n', '1 0 0\n', 'the pose of scan 1 of .* must be of 4 finite numbers'),
        ('1 0 0 0\n', '1 0 nan 0\n', 'the pose of scan 1 of .* must be of 4 finite numbers'),
        ('3 1\r\n', '3 2\r\n', 'the matrix of scan 2 of'),
        ('1 2 3 0.125', '1 2 3', 'the first point of scan 1 of .* must be of 4 or 7 numbers'),
        ('7 8 9 0', '7 8 9', 'point 6 of .* must be of 4 numbers, got 3'),
    ],
)
def test_refused(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    """Wrong counts, wrong poses and lines of other lengths are refused."""
    check_refused(make(tmp_path / 'two.ptx'), old, new, sentence)
