# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Small files that unpack to large ones: they are read in bounded pieces, or refused."""

from __future__ import annotations

import sqlite3
import subprocess
import sys
from contextlib import closing
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pytest
from helpers.cloud_files import copied
from pyarrow import parquet

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.cloud_file import Change, open_cloud

if TYPE_CHECKING:
    from pathlib import Path

MOST = 300  # MB more than before a file is opened
# Opens a file, reads its numbers and copies it; prints what was wrong, and the memory that it took.
PROGRAM = """
import resource, sys
from pathlib import Path
import pyarrow.compute, pyarrow.parquet
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files import cloud_file, parquet, sqlite
from lidar_outlier_filter.files.cloud_file import Change, copy, open_cloud, read

def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1000

path, before = Path(sys.argv[1]), peak()
try:
    file = open_cloud(path)
    for _ in read(file, ['x', 'y', 'z']):
        pass
    for _ in copy(file, path.with_name('copy' + path.suffix), Change()):
        pass
except CloudError as err:
    print(err)
else:
    print('copied')
print(peak() - before)
"""


def opened(path: Path) -> str:
    """Open, read and copy a file in a process of its own; return what it says of it."""
    done = subprocess.run(
        [sys.executable, '-c', PROGRAM, str(path)], capture_output=True, text=True, check=True
    )
    said, more = done.stdout.splitlines()
    assert int(more) < MOST
    return said


def write(folder: Path, count: int, **more: Any) -> Path:
    """Write a Parquet file of points, with more columns."""
    path = folder / 'cloud.parquet'
    rng = np.random.default_rng(1)
    table = pa.table({**{name: rng.random(count) for name in 'xyz'}, **more})
    size = 2**27
    parquet.write_table(table, path, store_schema=False, dictionary_pagesize_limit=size)
    return path


def repeated(text: str, count: int) -> Any:
    """Return a text so many times, as a column that holds it once."""
    return pa.DictionaryArray.from_arrays(pa.array(np.zeros(count, np.int32)), pa.array([text]))


@pytest.mark.parametrize('within', ['', 'struct', 'list'])
def test_a_text_that_is_repeated(tmp_path: Path, within: str) -> None:
    """20 000 times 100 000 letters are in 0.5 MB of file, and would be 2 GB of memory."""
    count = 20_000
    column = repeated('a' * 100_000, count)
    if within == 'struct':
        column = pa.StructArray.from_arrays([column], ['text'])
    elif within == 'list':
        column = pa.ListArray.from_arrays(np.arange(count + 1, dtype=np.int32), column)
    path = write(tmp_path, count, note=column)
    assert path.stat().st_size < 1_000_000
    must_be = 'at most 1073741824, got 10'
    assert f'row group 0 of {path} unpacks to must be {must_be}' in opened(path)


def test_a_column_that_is_packed(tmp_path: Path) -> None:
    """Zeros take next to nothing in a file: rows of 20 000 of them, 8 bytes each."""
    count = 10_000
    zeros = pa.FixedSizeListArray.from_arrays(np.zeros(count * 20_000), 20_000)
    path = write(tmp_path, count, zeros=zeros)
    assert path.stat().st_size < 1_000_000
    assert f'row group 0 of {path} unpacks to must be at most 1073741824, got 16' in opened(path)


def test_more_points_than_there_can_be(tmp_path: Path) -> None:
    """Points that are all one, in a thousand of which not one byte is left, are none."""
    path = tmp_path / 'cloud.parquet'
    one = pa.array(np.zeros(50_000_000, np.float32))
    table, most = pa.table({'x': one, 'y': one, 'z': one}), 2**30
    parquet.write_table(
        table,
        path,
        row_group_size=most,
        data_page_size=most,
        max_rows_per_page=most,
        compression='zstd',
    )
    assert f'the number of points of {path} must be from 0 to ' in opened(path)


def test_texts_of_a_usual_size(tmp_path: Path) -> None:
    """Texts, repeated and not, with and without nulls, in columns of all kinds, are copied."""
    names = [None if i % 3 == 0 else f'point {i}' for i in range(1000)]
    path = write(
        tmp_path,
        1000,
        name=names,
        one=repeated('a' * 1000, 1000),
        pair=[{'a': name, 'b': 1} for name in names],
        several=pa.array([[name, 'b'] for name in names], pa.list_(pa.large_string())),
        named=pa.array([[('key', name)] for name in names], pa.map_(pa.string(), pa.binary())),
    )
    copy = copied(path, Change())
    assert parquet.read_table(copy).equals(parquet.read_table(path), check_metadata=True)


def run(path: Path, *statements: str) -> None:
    """Run SQL."""
    with closing(sqlite3.connect(path)) as database, database:
        for statement in statements:
            database.execute(statement)


MANY = 'WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < 2000)'


@pytest.mark.parametrize(
    ('table', 'said'),
    [
        ('x AS (zeroblob(1000000000)), y, z', "must be one of y, z, got 'x'"),
        ('x, y, z, note AS (zeroblob(1000000000))', 'copied'),
        (
            'x, y, z, note AS (zeroblob(1000000000)) NOT NULL',
            'must be whole, got "string or blob too big"',
        ),
    ],
)
def test_expressions_in_a_database(tmp_path: Path, table: str, said: str) -> None:
    """A column that is computed when it is read, or a check, makes no value as large as it says."""
    path = tmp_path / 'cloud.db'
    run(path, f'CREATE TABLE t ({table})', 'PRAGMA ignore_check_constraints = ON')
    names = 'y, z' if table.startswith('x AS') else 'x, y, z'
    values = names.replace('x', '1').replace('y', '2').replace('z', '3')
    with closing(sqlite3.connect(path)) as database, database:
        database.execute('PRAGMA ignore_check_constraints = ON')
        database.execute(f'{MANY} INSERT INTO t ({names}) SELECT {values} FROM n')  # noqa: S608
    assert said in opened(path)


def test_a_virtual_table(tmp_path: Path) -> None:
    """A table whose rows a module makes is none that can be judged."""
    path = tmp_path / 'cloud.db'
    run(path, 'CREATE VIRTUAL TABLE t USING fts5(x, y, z)')
    with pytest.raises(CloudError, match=r'the table of .* must be one of .*, got .*t'):
        open_cloud(path, 't')
