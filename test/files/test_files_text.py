# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Text tables: every byte of every row is kept, whatever the separator."""

from pathlib import Path

import numpy as np
import pytest
from helpers.cloud_files import columns, copied, verdict

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files import cloud_file
from lidar_outlier_filter.files.cloud_file import Change, open_cloud

TABLE = (
    b'x,y,"z, metres",remark,stop\n'
    b'1.50,2,0.1,plain,4\n'
    b'-1e3,,+.5,"quoted, with a ""comma""",\n'
    b'   \n'
    b' 8 ,inf,nan,\xff\xfe no UTF-8, 7\n'
)
MARK = b'\xef\xbb\xbf'


def make(folder: Path, data: bytes = TABLE, name: str = 'table.csv') -> Path:
    """Write a table."""
    path = folder / name
    path.write_bytes(data)
    return path


def test_columns(tmp_path: Path) -> None:
    """A column is numeric if its first field is a number or empty; an empty field is NaN."""
    path = make(tmp_path)
    assert list(open_cloud(path).columns) == ['x', 'y', 'z, metres', 'stop']
    x, z, y, stop = columns(path, 'x', 'z, metres', 'y', 'stop')
    np.testing.assert_array_equal(x, [1.5, -1000, 8])
    np.testing.assert_array_equal(z, [0.1, 0.5, np.nan])
    np.testing.assert_array_equal(y, [2, np.nan, np.inf])
    np.testing.assert_array_equal(stop, [4, np.nan, 7])


@pytest.mark.parametrize(
    ('fields', 'expected'),
    [
        ('9007199254740993 -9007199254740993 0', [2**53 + 1, -(2**53) - 1, 0]),
        ('9007199254740993 nan 7.0', [2**53 + 1, None, 7]),
        ('9007199254740993 7.5 7', [2.0**53, 7.5, 7.0]),
        ('9007199254740993 1e300 7', [2.0**53, 1e300, 7.0]),
        ('9007199254740993 inf 7', [2.0**53, np.inf, 7.0]),
        ('9223372036854775808 1 1', [2.0**63, 1.0, 1.0]),
        ('nan nan nan', [None, None, None]),
    ],
)
def test_whole_numbers_are_exact(tmp_path: Path, fields: str, expected: list[float]) -> None:
    """Large integers are exact, unless their column has a fraction or a number beyond 64 bits."""
    path = make(tmp_path, b'x\n' + '\n'.join(fields.split()).encode())
    ((x,),) = cloud_file.read(open_cloud(path), ['x'], exact=True)
    assert x.tolist() == expected


def test_copies_keep_every_row(tmp_path: Path) -> None:
    """Removed rows leave the others as they are; added fields follow the last one."""
    path, lines = make(tmp_path), TABLE.splitlines(keepends=True)
    copy = copied(path, Change(keep=np.array([True, False, True])))
    assert copy.read_bytes() == b''.join([*lines[:2], *lines[3:]])
    score = np.array([np.nan, 1 / 3, 16777217 / 3], np.float32)
    copy = copied(path, Change(added={'outlier': np.array([0, 1, 0], np.uint8), 'score': score}))
    added = (b',outlier,score', b',0,nan', b',1,0.333333343', b'', b',0,5592405.5')
    pairs = zip(TABLE.splitlines(), added, strict=True)
    assert copy.read_bytes() == b''.join(line + more + b'\n' for line, more in pairs)
    np.testing.assert_array_equal(columns(copy, 'score')[0].astype(np.float32), score)


@pytest.mark.parametrize('separator', [',', ';', '\t', '|', ' '])
@pytest.mark.parametrize('names', ['', 'xyz'])
@pytest.mark.parametrize('mark', [b'', MARK])
def test_separators(tmp_path: Path, separator: str, names: str, mark: bytes) -> None:
    """The separator is found; unnamed columns are numbered; a byte order mark is kept."""
    rows = [list(names)] * bool(names) + [['1', '2.5', '3'], ['4', '5', '6.25']]
    text = '\r\n'.join(separator.join(row) for row in rows) + '\r\n'
    path = make(tmp_path, mark + text.encode(), 'cloud.xyz')
    assert list(open_cloud(path).columns) == list(names or '123')
    assert [column.tolist() for column in columns(path)] == [[1, 4], [2.5, 5], [3, 6.25]]
    data = copied(path, Change(added=verdict(2))).read_bytes()
    assert data.startswith(mark + rows[0][0].encode() + separator.encode())
    assert data.count(b'\r\n') == data.count(b'\n') == len(rows)
    copy = path.parent / 'copied' / path.name
    assert [column.tolist() for column in columns(copy)[:3]] == [[1, 4], [2.5, 5], [3, 6.25]]
    np.testing.assert_array_equal(columns(copy)[3], verdict(2)['outlier'])


@pytest.mark.parametrize(
    ('head', 'names'),
    [
        ('# x y z\n', 'x y z'),
        ('#x y z\n', 'x y z'),
        ('//X Y Z\n', 'X Y Z'),
        ('// X,Y,Z\n', 'X Y Z'),
        ('# made by hand\n# 3 points\n# x y z\n', 'x y z'),
        ('# made by hand in 2024\nx y z\n', 'x y z'),
        ('# made by hand in 2024\n', '1 2 3'),
    ],
)
def test_names_in_a_comment(tmp_path: Path, head: str, names: str) -> None:
    """Names may be in the last comment above the rows; comments are kept in copies."""
    path = make(tmp_path, f'{head}1 2.5 3\n4 5 6.25\n'.encode(), 'cloud.xyz')
    assert list(open_cloud(path).columns) == names.split()
    assert [column.tolist() for column in columns(path)] == [[1, 4], [2.5, 5], [3, 6.25]]
    data = copied(path, Change(added=verdict(2))).read_bytes().decode()
    added = ' outlier' if names != '1 2 3' else ''
    assert data.startswith(f'{head[:-1]}{added}')
    copy = path.parent / 'copied' / path.name
    assert len(columns(copy)[0]) == 2


def test_blanks_and_empty_lines(tmp_path: Path) -> None:
    """Several blanks are one separator, trailing blanks are ignored; empty lines are no rows."""
    for data in (b'1   2 3 \n\n 4 5    6\n   \n7 8 9', b'1 2 3\n4 5 6\n7 8 9\n\n'):
        path = make(tmp_path, data, 'cloud.txt')
        assert [column.tolist() for column in columns(path)] == [[1, 4, 7], [2, 5, 8], [3, 6, 9]]


def test_rows_of_empty_fields(tmp_path: Path) -> None:
    """A row of empty fields is a missing return: a point in its place."""
    for mark, name in ((b',', 'table.csv'), (b'\t', 'table.tsv')):
        data = b'x,y,z\n,,\n1,2,3\n , ,\n"","",""\n4,5,6\n,,\n'.replace(b',', mark)
        path = make(tmp_path, data, name)
        np.testing.assert_array_equal(columns(path, 'y')[0], [np.nan, 2, *[np.nan] * 2, 5, np.nan])


@pytest.mark.parametrize(
    ('data', 'sentence'),
    [
        (b'', 'must be of at least one point, got 0'),
        (b'x,y,z\n', 'must be of at least one point, got 0'),
        (b'x,y,x\n1,2,3\n', 'must be of different names, got x'),
        (b'x,y,z\n1,2,3\n4,1_0,6\n', "got '1_0'"),
        (b'x,y,z\n1,2,3\n4,five,6\n', "point 2 of {} must be of numbers, got 'five'"),
        (b'x,y,z\n1,2,3\n4,5\n', 'point 2 of {} must be of 3 numbers, got 2'),
        (b'1,2,3\n4,5,6,\n', 'point 2 of {} must be of 3 numbers, got 4'),
        # R's write.table, which has a name for every column but the first, of row numbers.
        (b'"x" "y" "z"\n"1" 7 8 9\n', 'point 1 of {} must be of 3 numbers, got 4'),
        (b'x,y,z\n1,2,"3\n"\n4,5,6\n', 'must be readable, got "unexpected end of data"'),
    ],
)
def test_refused(tmp_path: Path, data: bytes, sentence: str) -> None:
    """A table that makes no sense is refused in one sentence."""
    path = make(tmp_path, data)
    with pytest.raises(CloudError) as caught:
        columns(path)
    assert sentence.format(path) in str(caught.value)
