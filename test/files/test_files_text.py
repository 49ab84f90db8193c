# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Tables that are text: every byte of every row is kept, whatever the separator."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from helpers.cloud_files import columns, copied, verdict

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files import cloud_file
from lidar_outlier_filter.files.cloud_file import Change, open_cloud

if TYPE_CHECKING:
    from pathlib import Path

TABLE = (
    b'x,y,"z, metres",remark,stop\n'
    b'1.50,2,0.1,plain,4\n'
    b'-1e3,,+.5,"quoted, with a ""comma""",\n'
    b'007,inf,nan,"over\ntwo lines", 6\n'
    b' 8 ,9,10,\xff\xfe no UTF-8,7\n'
)


def make(folder: Path, data: bytes = TABLE, name: str = 'table.csv') -> Path:
    """Write a table."""
    path = folder / name
    path.write_bytes(data)
    return path


def test_columns(tmp_path: Path) -> None:
    """Columns whose first row is a number or empty can be read; an empty field is NaN."""
    path = make(tmp_path)
    assert list(open_cloud(path).columns) == ['x', 'y', 'z, metres', 'stop']
    x, z, y, stop = columns(path, 'x', 'z, metres', 'y', 'stop')
    np.testing.assert_array_equal(x, [1.5, -1000, 7, 8])
    np.testing.assert_array_equal(z, [0.1, 0.5, np.nan, 10])
    np.testing.assert_array_equal(y, [2, np.nan, np.inf, 9])
    np.testing.assert_array_equal(stop, [4, np.nan, 6, 7])


@pytest.mark.parametrize(
    ('fields', 'expected'),
    [
        ('9007199254740993 -9007199254740993 0', [2**53 + 1, -(2**53) - 1, 0]),
        ('9007199254740993 nan 7.0', [2**53 + 1, None, 7]),
        ('9007199254740993 7.5 7', [2.0**53, 7.5, 7.0]),
        ('9007199254740993 1e300 7', [2.0**53, 1e300, 7.0]),
        ('9007199254740993 inf 7', [2.0**53, np.inf, 7.0]),
        ('9223372036854775807 1 1', [2**63 - 1, 1, 1]),
        ('9223372036854775808 1 1', [2.0**63, 1.0, 1.0]),
        ('nan nan nan', [None, None, None]),
    ],
)
def test_whole_numbers_are_exact(tmp_path: Path, fields: str, expected: list[float]) -> None:
    """Large whole numbers are not rounded, unless one of their column is none, or too large."""
    path = make(tmp_path, b'x\n' + '\n'.join(fields.split()).encode())
    ((x,),) = cloud_file.read_exact(open_cloud(path), ['x'])
    assert x.tolist() == expected
    (x,) = columns(path, 'x')
    np.testing.assert_array_equal(x, np.array(expected, x.dtype))


def test_some_rows(tmp_path: Path) -> None:
    """A copy of some rows has their bytes, under the same names."""
    path = make(tmp_path)
    copy = copied(path, Change(keep=np.array([False, True, True, False])))
    lines = TABLE.splitlines(keepends=True)
    assert copy.read_bytes() == lines[0] + b''.join(lines[2:5])


def test_added_columns(tmp_path: Path) -> None:
    """Added columns stand behind all else of a row, in as many digits as it takes."""
    path = make(tmp_path)
    score = np.array([np.nan, 1 / 3, 16777217 / 3, np.inf], np.float32)
    copy = copied(path, Change(added={'outlier': np.array([0, 1, 0, 1], np.uint8), 'score': score}))
    lines = TABLE.split(b'\n')
    expected = [
        lines[0] + b',outlier,score',
        lines[1] + b',0,nan',
        lines[2] + b',1,0.333333343',
        lines[3],
        lines[4] + b',0,5592405.5',
        lines[5] + b',1,inf',
        b'',
    ]
    assert copy.read_bytes() == b'\n'.join(expected)
    np.testing.assert_array_equal(columns(copy, 'score')[0].astype(np.float32), score)


@pytest.mark.parametrize('separator', [',', ';', '\t', '|', ' '])
@pytest.mark.parametrize('named', [True, False])
def test_separators(tmp_path: Path, separator: str, *, named: bool) -> None:
    """The separator is found; without names the columns are numbered."""
    rows = [['1', '2.5', '3'], ['4', '5', '6.25']]
    head = [['x', 'y', 'z']] if named else []
    text = '\r\n'.join(separator.join(row) for row in head + rows) + '\r\n'
    path = make(tmp_path, text.encode(), 'cloud.xyz')
    assert list(open_cloud(path).columns) == (['x', 'y', 'z'] if named else ['1', '2', '3'])
    assert [column.tolist() for column in columns(path)] == [[1, 4], [2.5, 5], [3, 6.25]]
    copy = copied(path, Change(added=verdict(2)))
    assert copy.read_bytes().count(b'\r\n') == copy.read_bytes().count(b'\n') == 2 + named
    assert [column.tolist() for column in columns(copy)[:3]] == [[1, 4], [2.5, 5], [3, 6.25]]
    np.testing.assert_array_equal(columns(copy)[3], verdict(2)['outlier'])


def test_blanks_and_empty_lines(tmp_path: Path) -> None:
    """Several blanks are one separator, and empty lines are no rows, but are gone in no copy."""
    path = make(tmp_path, b'1   2 3\n\n4 5    6\n   \n7 8 9', 'cloud.txt')
    assert [column.tolist() for column in columns(path)] == [[1, 4, 7], [2, 5, 8], [3, 6, 9]]
    copy = copied(path, Change(keep=np.array([True, False, True])))
    assert copy.read_bytes() == b'1   2 3\n7 8 9'


def test_rows_of_empty_fields(tmp_path: Path) -> None:
    """A row of empty fields is a missing return: a point as any other, in its place."""
    data = b'x,y,z\n,,\n1,2,3\n , ,\n\n"","",""\n4,5,6\n,,\n'
    path = make(tmp_path, data)
    x, y, _ = columns(path)
    np.testing.assert_array_equal(x, [np.nan, 1, np.nan, np.nan, 4, np.nan])
    np.testing.assert_array_equal(y, [np.nan, 2, np.nan, np.nan, 5, np.nan])
    copy = copied(path, Change(added={'outlier': np.arange(6, dtype=np.uint8)}))
    assert copy.read_bytes() == (
        b'x,y,z,outlier\n,,,0\n1,2,3,1\n , ,,2\n"","","",3\n4,5,6,4\n,,,5\n'
    )
    path = make(tmp_path, b'x\ty\n\t\n1\t2\n', 'table.tsv')
    np.testing.assert_array_equal(columns(path, 'y')[0], [np.nan, 2])


def test_blanks_at_the_end(tmp_path: Path) -> None:
    """Between blanks, those at the end of a line, or of the names, are no further column."""
    path = make(tmp_path, b'x y  \n1 2 \n3 4\n', 'cloud.xyz')
    assert list(open_cloud(path).columns) == ['x', 'y']
    assert [column.tolist() for column in columns(path)] == [[1, 3], [2, 4]]


@pytest.mark.parametrize('end', [b'\n', b'\r\n'])
def test_names_with_line_breaks(tmp_path: Path, end: bytes) -> None:
    """A quoted name may have a line break; new names stand behind the last one."""
    head = b'x,"y' + end + b'(north)",z'
    path = make(tmp_path, head + end + b'1,2,3' + end)
    assert list(open_cloud(path).columns) == ['x', f'y{end.decode()}(north)', 'z']
    assert copied(path, Change()).read_bytes() == path.read_bytes()
    copy = copied(path, Change(added={'outlier': np.ones(1, np.uint8)}))
    assert copy.read_bytes() == head + b',outlier' + end + b'1,2,3,1' + end


def test_byte_order_mark(tmp_path: Path) -> None:
    """A byte order mark belongs to no name, and is kept."""
    path = make(tmp_path, b'\xef\xbb\xbfx;y\n1;2\n3;4\n')
    assert list(open_cloud(path).columns) == ['x', 'y']
    assert copied(path, Change()).read_bytes() == path.read_bytes()
    copy = copied(path, Change(added={'outlier': np.zeros(2, np.uint8)}))
    assert copy.read_bytes().startswith(b'\xef\xbb\xbfx;y;outlier\n1;2;0\n')


@pytest.mark.parametrize(
    ('data', 'sentence'),
    [
        (b'', 'must be of at least one point, got 0'),
        (b'x,y,z\n', 'must be of at least one point, got 0'),
        (b'x,y,x\n1,2,3\n', 'must be of different names, got x'),
        (b'x,y,z\n1,2,3\n4,1_0,6\n', "line 3 of {} must be of numbers, got '1_0'"),
        (b'x,y,z\n1,2,3\n4,five,6\n', "line 3 of {} must be of numbers, got 'five'"),
        (b'x,y,z\n1,2,3\n4,5\n', 'line 3 of {} must be of 3 fields, as the first, got 2'),
        (b'x,y,z\n1,2,3\n\n4,5,6,7\n', 'line 4 of {} must be of 3 fields, as the first, got 4'),
        (b'1,2,3\n4,5,6,\n', 'line 2 of {} must be of 3 fields, as the first, got 4'),
        # R's write.table, which has a name for every column but the first, of row numbers.
        (b'"x" "y" "z"\n"1" 7 8 9\n', 'line 2 of {} must be of 3 fields, as the first, got 4'),
        # Behind rows of several lines, too, it is the line where a row begins.
        (b'x,y\n"1\n",2\n3,"4\n",5\n', 'line 4 of {} must be of 2 fields, as the first, got 3'),
        (b'x,y,z\n1,"2,3\n4,5,6\n', 'must be readable, got "unexpected end of data"'),
    ],
)
def test_refused(tmp_path: Path, data: bytes, sentence: str) -> None:
    """A table that makes no sense is refused in one sentence."""
    path = make(tmp_path, data)
    with pytest.raises(CloudError) as caught:
        columns(path)
    assert sentence.format(path) in str(caught.value)


@pytest.mark.parametrize('separator', [',', ' '])
def test_byte_order_mark_without_names(tmp_path: Path, separator: str) -> None:
    """A byte order mark in front of a number belongs to no number, and is kept."""
    text = separator.join('123') + '\n' + separator.join('456') + '\n'
    path = make(tmp_path, b'\xef\xbb\xbf' + text.encode())
    assert list(open_cloud(path).columns) == ['1', '2', '3']
    assert [column.tolist() for column in columns(path)] == [[1, 4], [2, 5], [3, 6]]
    assert copied(path, Change()).read_bytes() == path.read_bytes()
    copy = copied(path, Change(keep=np.array([False, True])))
    assert copy.read_bytes() == b'\xef\xbb\xbf' + separator.join('456').encode() + b'\n'


def test_a_line_without_an_end(tmp_path: Path) -> None:
    """Of a file that is one endless line, or has one, no more than a line is read."""
    for before in (b'', b'x,y\n', b'x,y\n1,2\n'):
        path = make(tmp_path, before + b'1,' * 2_000_000)
        with pytest.raises(CloudError, match='must be of fewer than 1000000 letters, got more'):
            open_cloud(path)
