# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Headers that lie and small files that unpack to large ones are refused, or read in pieces."""

import sqlite3
import struct
import sys
import tracemalloc
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from helpers.cloud_files import columns, copied, number, patch, run_sql, write_las
from helpers.programs import ended
from pyarrow import parquet

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.clean import clean_file
from lidar_outlier_filter.files.cloud_file import Change, check_points, open_cloud
from lidar_outlier_filter.parameters.filter import FilterParameters

SOON = 5.0  # seconds
LITTLE = 50_000_000  # bytes
COUNT = 300
PCD = (
    'FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {0}\nHEIGHT 1\nPOINTS {0}\nDATA {1}\n'
)


def las(folder: Path, name: str = 'cloud.las', point_format: int = 6) -> Path:
    """Write a file of 300 points with a record before them and one behind them."""
    x, y = np.arange(COUNT), np.arange(COUNT, 0, -1)
    return write_las(folder / name, COUNT, point_format, 'note', X=x, Y=y)


def rows(count: int = COUNT) -> bytes:
    """Make rows of three numbers that are not zero."""
    return struct.pack('<3f', 1.5, 2.5, 3.5) * count


def refused(path: Path, sentence: str = ' must be ') -> None:
    """Refuse a file soon, with little memory, and in one sentence without foreign words."""
    tracemalloc.start()
    begin = perf_counter()
    with pytest.raises(CloudError) as caught:
        columns(path)
    taken, most = perf_counter() - begin, tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert sentence in str(caught.value)
    assert '\n' not in str(caught.value)
    assert taken < SOON
    assert most < LITTLE


@pytest.mark.parametrize(
    ('offset', 'data', 'sentence'),
    [
        (94, '<H', 'the end of the header of'),
        (96, '<I', 'the first point of'),
        (100, '<I', 'the number of records of'),
        (235, '<Q', 'the first extended record of'),
        (243, '<I', 'the number of records of'),
        (247, '<Q', 'as it says, got 300'),
    ],
)
def test_numbers_of_a_las_header(tmp_path: Path, offset: int, data: str, sentence: str) -> None:
    """A count or an offset beyond the file is refused."""
    largest = 256 ** struct.calcsize(data) - 1
    refused(patch(las(tmp_path), offset, struct.pack(data, largest)), sentence)


@pytest.mark.parametrize(
    ('pointer', 'width', 'size'),
    [(94, 2, struct.pack('<H', 420)), (235, 8, struct.pack('<Q', 2**63))],
)
def test_records_longer_than_the_file(
    tmp_path: Path, pointer: int, width: int, size: bytes
) -> None:
    """A record that ends behind the first point, or behind the file, is refused."""
    path = las(tmp_path, 'cloud.laz')
    at = number(path.read_bytes(), pointer, width) + 20
    refused(patch(path, at, size), 'the bytes in a record of')


@pytest.mark.parametrize(
    ('point_format', 'said', 'found'),
    # Formats 0 to 5 of LAZ do not count the points of the last chunk, which has up to 50 000.
    [(6, 0, COUNT), (6, COUNT - 1, COUNT), (6, 2**63, COUNT), (3, 0, 1), (3, 50_001, 50_000)],
)
def test_number_of_laz_points(tmp_path: Path, point_format: int, said: int, found: int) -> None:
    """More or fewer points than the header says are refused."""
    path = patch(las(tmp_path, 'cloud.laz', point_format), 247, struct.pack('<Q', said))
    refused(path, f'{found} points instead of {said}')


@pytest.mark.parametrize('point_format', [3, 6])
@pytest.mark.parametrize(
    ('part', 'offset', 'data'),
    [
        ('points', 0, struct.pack('<Q', 0)),  # where the table of chunks is
        ('points', 0, struct.pack('<Q', 2**63)),
        ('table', 4, struct.pack('<I', 100)),  # how many chunks there are
        ('table', 4, struct.pack('<I', 2**32 - 1)),
        ('record', 0, b'\0'),  # the compressor
        ('record', 0, b'\5'),
        ('record', 12, struct.pack('<I', 3)),  # points of a chunk
        ('record', 32, b'\0\0'),  # items of a point
        ('record', 36, b'\xff\xff'),  # bytes of an item
        # Layers that are larger than their chunk: gigabytes are not taken for them.
        *(('layers', 4 * layer, b'\xff' * 4) for layer in range(9)),
    ],
)
def test_what_laz_says(
    tmp_path: Path, point_format: int, part: str, offset: int, data: bytes
) -> None:
    """Damaged LAZ is refused, even where the library ends its process."""
    path = las(tmp_path, 'cloud.laz', point_format)
    begin = number(path.read_bytes(), 96, 4)
    offsets = {
        'points': begin,
        'layers': begin + 8 + number(path.read_bytes(), 105, 2) + 4,
        'table': number(path.read_bytes(), begin, 8),
        'record': path.read_bytes().index(b'laszip encoded') - 2 + 54,
    }
    if part != 'layers' or point_format == 6:  # the older ones have no layers
        refused(patch(path, offsets[part] + offset, data))


@pytest.mark.parametrize(
    ('packed', 'size', 'sentence'),
    [
        (2**32 - 1, 3600, 'the compressed bytes of'),
        (10, 2**32 - 1, 'the bytes unpacked of'),
        (10, 600, 'must be of 300 points, as it says, got 50'),
    ],
)
def test_sizes_of_a_compressed_pcd(tmp_path: Path, packed: int, size: int, sentence: str) -> None:
    """The sizes of the compressed bytes fit the file and the points."""
    path = tmp_path / 'cloud.pcd'
    head = PCD.format(COUNT, 'binary_compressed').encode()
    path.write_bytes(head + struct.pack('<II', packed, size) + b'\1xy' * 4)
    refused(path, sentence)


def test_pages_filled_with_zeros(tmp_path: Path) -> None:
    """Zeros behind the points fill a page: they are no points; other bytes are."""
    path = tmp_path / 'cloud.pcd'
    whole = PCD.format(COUNT, 'binary').encode() + rows()
    path.write_bytes(whole + bytes(4096))
    assert len(columns(path)[0]) == COUNT
    path.write_bytes(whole + b'rest')
    assert len(columns(path)[0]) == COUNT
    path.write_bytes(whole + bytes(4095) + b'\1')
    refused(path, 'must be of 300 points, as it says, got 641')
    with pytest.raises(
        CloudError, match=r'the size of a point of .* must be at least 1 byte, got 0'
    ):
        check_points(path, 1, 0, 0, 10)


def test_too_large_for_the_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cloud that does not fit into memory is refused in one sentence."""

    def none(*_: object, **__: object) -> Iterator[object]:
        raise MemoryError

    path = tmp_path / 'cloud.pcd'
    path.write_bytes(PCD.format(COUNT, 'binary').encode() + rows())
    monkeypatch.setattr('lidar_outlier_filter.files.judged_file.judge_whole', none)
    with pytest.raises(CloudError, match='small enough for the memory, or judged in files'):
        clean_file(path, tmp_path / 'out.pcd', FilterParameters())
    assert [item.name for item in tmp_path.iterdir()] == ['cloud.pcd']
    assert len(open_cloud(path)) == COUNT


MAX_GROWTH_MB = 300  # MB more than before a file is opened
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
    """Open, read and copy a file in its own process; return its message."""
    said, more = ended(sys.executable, '-c', PROGRAM, path).stdout.splitlines()
    assert int(more) < MAX_GROWTH_MB
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


@pytest.mark.parametrize(('count', 'values'), [(10_000, 20_000), (1, 200_000_000)])
def test_a_column_that_is_packed(tmp_path: Path, count: int, values: int) -> None:
    """Zeros take next to nothing in a file: rows of so many of them, 8 bytes each."""
    zeros = pa.FixedSizeListArray.from_arrays(np.zeros(count * values), values)
    path = write(tmp_path, count, zeros=zeros)
    assert path.stat().st_size < 1_000_000
    assert f'row group 0 of {path} unpacks to must be at most 1073741824, got 16' in opened(path)


def test_more_points_than_there_can_be(tmp_path: Path) -> None:
    """More points than a file of that size can hold are refused."""
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
    """Computed columns and checks cannot produce huge values."""
    path = tmp_path / 'cloud.db'
    run_sql(path, f'CREATE TABLE t ({table})', 'PRAGMA ignore_check_constraints = ON')
    names = 'y, z' if table.startswith('x AS') else 'x, y, z'
    values = names.replace('x', '1').replace('y', '2').replace('z', '3')
    with closing(sqlite3.connect(path)) as database, database:
        database.execute('PRAGMA ignore_check_constraints = ON')
        database.execute(f'{MANY} INSERT INTO t ({names}) SELECT {values} FROM n')  # noqa: S608
    assert said in opened(path)


def test_a_virtual_table(tmp_path: Path) -> None:
    """A virtual table, whose rows a module computes, is refused."""
    path = tmp_path / 'cloud.db'
    run_sql(path, 'CREATE VIRTUAL TABLE t USING fts5(x, y, z)')
    with pytest.raises(CloudError, match=r'the table of .* must be one of .*, got .*t'):
        open_cloud(path, 't')
