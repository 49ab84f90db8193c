# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""SQLite: the database is copied whole, and the verdict is a table of its own."""

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from helpers.cloud_files import columns, copied, run_sql, verdict

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files import cloud_file
from lidar_outlier_filter.files.cloud_file import Change, open_cloud

COUNT = 30


def make(folder: Path) -> Path:
    """Make a database with the track of a bus, whose row ids are neither dense nor in order."""
    path = folder / 'tracks.sqlite'
    with closing(sqlite3.connect(path)) as database, database:
        database.execute(
            'CREATE TABLE "line 11" (id INTEGER PRIMARY KEY, bus TEXT, lat REAL, lon, '
            '"speed ""km/h""" INTEGER, at TEXT, note BLOB)'
        )
        rows = [
            (3 * i + 1, f'bus {i}', 45 + i / 1000, f'{7 + i / 1000}', i % 50, '2017-05-03', b'\0\1')
            for i in range(COUNT)
        ]
        database.executemany('INSERT INTO "line 11" VALUES (?, ?, ?, ?, ?, ?, ?)', rows[::-1])
        database.execute('CREATE INDEX by_bus ON "line 11" (bus)')
        database.execute('CREATE VIEW fast AS SELECT * FROM "line 11" WHERE lat > 45')
    return path


def test_columns(tmp_path: Path) -> None:
    """Columns of numbers can be read by row id, numbers that were stored as text, too."""
    path = make(tmp_path)
    assert list(open_cloud(path).columns) == ['id', 'lat', 'lon', 'speed "km/h"']
    row, lat, lon, speed = columns(path)
    assert row.tolist() == [3 * i + 1 for i in range(COUNT)]
    np.testing.assert_array_equal(lat, [45 + i / 1000 for i in range(COUNT)])
    np.testing.assert_array_equal(lon, [7 + i / 1000 for i in range(COUNT)])
    np.testing.assert_array_equal(speed, [i % 50 for i in range(COUNT)])


def test_whole_numbers_are_exact(tmp_path: Path) -> None:
    """Large whole numbers are not rounded, stored as text or not; beyond 64 bits they are."""
    path, large = tmp_path / 'large.db', 2**53 + 1
    run_sql(path, 'CREATE TABLE t (x, y TEXT, z, a TEXT, b TEXT, c TEXT)')
    values = (large, f'{large}', 2.0**63, f'{2**63}', f'{2**63 - 1}', f'{-(2**63)}')
    with closing(sqlite3.connect(path)) as database, database:
        database.execute('INSERT INTO t VALUES (?, ?, ?, ?, ?, ?)', values)
    found = [column.tolist() for column in columns(path)]
    assert found == [[large], [large], [2.0**63], [2.0**63], [2**63 - 1], [-(2**63)]]
    assert [type(one) for (one,) in found] == [int, int, float, float, int, int]
    run_sql(path, 'INSERT INTO t (x) VALUES (NULL)')
    x, y, z = next(cloud_file.read(open_cloud(path), ['x', 'y', 'z'], exact=True))
    assert x.tolist() == y.tolist() == [large, None]
    np.testing.assert_array_equal(z, [2.0**63, np.nan])


def test_verdict(tmp_path: Path) -> None:
    """The copy has all of the database, and a table with the verdict on every row, by row id."""
    path = make(tmp_path)
    before, added = path.read_bytes(), verdict(COUNT)
    copy = copied(path, Change(added=added))
    for query in (
        "SELECT * FROM sqlite_schema WHERE name NOT LIKE '%verdict' ORDER BY name",
        'SELECT * FROM "line 11" ORDER BY id',
    ):
        assert run_sql(copy, query) == run_sql(path, query)
    found = run_sql(copy, 'SELECT * FROM "line 11_verdict" ORDER BY row_id')
    score = [None if np.isnan(one) else one for one in added['outlier_score'].tolist()]
    others = (added[name].tolist() for name in ('outlier', 'outlier_detectors'))
    outlier, detectors = others
    ids = range(1, 3 * COUNT, 3)
    assert found == [*zip(ids, outlier, score, detectors, strict=True)]
    assert path.read_bytes() == before
    with pytest.raises(CloudError, match='without line 11_verdict, which is to be made'):
        open_cloud(copy, 'line 11')
    assert sorted(item.name for item in tmp_path.iterdir()) == ['copied', 'tracks.sqlite']


def test_row_ids(tmp_path: Path) -> None:
    """A table without row ids, or with a column of that name, is refused."""
    for columns_of, sentence in (
        ('(x, RowID)', 'the columns of table .* must be without rowid'),
        ('(x PRIMARY KEY, y) WITHOUT ROWID', 'must be readable, got "no such column: rowid"'),
    ):
        path = tmp_path / f'{len(columns_of)}.db'
        run_sql(path, f'CREATE TABLE t {columns_of}', 'INSERT INTO t VALUES (1, 2)')
        with pytest.raises(CloudError, match=sentence):
            open_cloud(path)


def test_generated_columns(tmp_path: Path) -> None:
    """A column that is computed and stored can be read; one that is only computed cannot."""
    path = tmp_path / 'made.db'
    run_sql(
        path,
        'CREATE TABLE t (x REAL, name AS (x + 1), y REAL, z REAL AS (x + y) STORED, note TEXT)',
        "INSERT INTO t (x, y, note) VALUES (1, 2, 'a'), (3, 4, 'b')",
    )
    assert list(open_cloud(path).columns) == ['x', 'y', 'z']
    assert [column.tolist() for column in columns(path)] == [[1, 3], [2, 4], [3, 7]]


def test_the_table_is_named(tmp_path: Path) -> None:
    """With several tables, one must be named, and exist."""
    path = make(tmp_path)
    run_sql(path, 'CREATE TABLE other (x, y)', 'INSERT INTO other VALUES (1.5, 2)')
    with pytest.raises(CloudError, match='must be one of line 11, other, got none'):
        open_cloud(path)
    with pytest.raises(CloudError, match="must be one of line 11, other, got 'fast'"):
        open_cloud(path, 'fast')
    assert len(open_cloud(path, 'line 11')) == COUNT
    assert [column.tolist() for column in columns(path, table='other')] == [[1.5], [2]]


def test_words_among_numbers(tmp_path: Path) -> None:
    """A column of numbers must be of numbers in every row."""
    path = make(tmp_path)
    run_sql(path, """UPDATE "line 11" SET lon = 'west' WHERE id = 7""")
    with pytest.raises(CloudError, match="column 'lon' of table 'line 11' must be of numbers, got"):
        columns(path, 'lon')


def test_no_database(tmp_path: Path) -> None:
    """A file of another kind, an empty one and an empty table are refused."""
    path = tmp_path / 'other.db'
    path.write_bytes(b'LASF' * 1000)
    with pytest.raises(CloudError, match='must be readable, got "file is not a database"'):
        open_cloud(path)
    path.write_bytes(b'')
    with pytest.raises(CloudError, match=r'the table of .* must be one of none, got none'):
        open_cloud(path)
    run_sql(path, 'CREATE TABLE t (x, y, z)')
    with pytest.raises(CloudError, match='must be of at least one point, got 0'):
        open_cloud(path)


@pytest.mark.parametrize('lost', [1, 511, 4096])
@pytest.mark.parametrize('counted', [True, False])
def test_damaged(tmp_path: Path, lost: int, *, counted: bool) -> None:
    """A database with a damaged page, or without its last bytes, is refused before it is read.

    So is one that does not count its pages.
    """
    path = make(tmp_path)
    whole = path.read_bytes()
    data = bytearray(whole[:-lost])
    if not counted:
        data[92:96] = bytes(4)
    for damaged in (data, whole[:4096] + bytes(2000) + whole[6096:]):
        path.write_bytes(damaged)
        with pytest.raises(CloudError, match='must be whole, got "'):
            open_cloud(path)


def test_nothing_is_left_beside(tmp_path: Path) -> None:
    """A database that was written with a log is read without one; with rows in a log, refused."""
    path = make(tmp_path)
    database = sqlite3.connect(path)
    database.execute('PRAGMA journal_mode=WAL')
    database.close()
    assert path.read_bytes()[18] == 2
    assert len(columns(path)[0]) == COUNT
    assert [item.name for item in tmp_path.iterdir()] == ['tracks.sqlite']
    (tmp_path / 'tracks.sqlite-wal').write_bytes(b'rows')
    with pytest.raises(CloudError, match=r'closed by its writer, got changes in .*-wal'):
        open_cloud(path)


def interrupted(path: Path, statement: str) -> Path:
    """Copy a database as a writer leaves it that is killed within a long transaction."""
    target = path.parent / 'killed'
    target.mkdir()
    with closing(sqlite3.connect(path)) as database:
        database.execute('PRAGMA cache_size = 1')
        database.execute('BEGIN')
        database.execute(statement)
        for file in path.parent.glob(f'{path.name}*'):
            shutil.copyfile(file, target / file.name)
    assert len(list(target.iterdir())) == 2
    return target / path.name


def test_half_a_transaction(tmp_path: Path) -> None:
    """A database with rows of a transaction that was not committed is refused, not read."""
    path = make(tmp_path)
    many = 'INSERT INTO "line 11" (lat, note) SELECT 1, zeroblob(2000) FROM generate'
    series = (
        'WITH RECURSIVE generate(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM generate LIMIT 99)'
    )
    killed = interrupted(path, f'{series} {many}')
    with pytest.raises(CloudError, match=r'closed by its writer, got changes in .*-journal'):
        open_cloud(killed)
    journal = killed.with_name(f'{killed.name}-journal')
    journal.write_bytes(bytes(28) + journal.read_bytes()[28:])  # as PRAGMA journal_mode = PERSIST
    shutil.copyfile(path, killed)
    assert len(columns(killed)[0]) == COUNT


def test_a_real_hot_journal(real_data: Path) -> None:
    """So is a database whose half transaction changed 2944 of 3000 rows."""
    with pytest.raises(CloudError, match='must be closed by its writer'):
        open_cloud(real_data / 'hostile' / 'hot.sqlite')
