# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Parquet: schema, metadata, row groups, compression and all other columns are kept."""

import tracemalloc
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from helpers.cloud_files import columns, copied, every_third
from pyarrow import parquet

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.cloud_file import Change, open_cloud
from lidar_outlier_filter.files.judged_file import CleanOptions, judge_file
from lidar_outlier_filter.parameters.filter import FilterParameters

COUNT = 1000


def table() -> Any:
    """Make a table with columns of many kinds, nulls among them."""
    rng = np.random.default_rng(0)
    nulls = rng.random(COUNT) < 0.1
    times = pa.array(np.arange(COUNT) * 1001, pa.timestamp('us'))
    columns = {
        'x': pa.array(rng.random(COUNT)),
        'y': pa.array(rng.random(COUNT), mask=nulls),
        'z': pa.array(rng.random(COUNT).astype(np.float32)),
        'ring': pa.array(np.arange(COUNT) % 32, pa.uint16(), mask=nulls),
        'time': times,
        'name': pa.array([f'point {i}' for i in range(COUNT)]).dictionary_encode(),
        'list': pa.array([[i, i + 1] if i % 7 else None for i in range(COUNT)]),
        'pair': pa.array([{'a': i, 'b': str(i)} for i in range(COUNT)]),
        'flag': pa.array(nulls),
    }
    made = pa.table(columns)
    return made.replace_schema_metadata({b'geo': b'{"version": "1.0"}', b'made by': b'a test'})


def make(folder: Path, compression: str = 'zstd') -> Path:
    """Write the table in row groups of 300."""
    path = folder / 'cloud.parquet'
    parquet.write_table(table(), path, row_group_size=300, compression=compression)
    return path


def test_columns(tmp_path: Path) -> None:
    """Columns of numbers and of times can be read; null is NaN, times are nanoseconds."""
    path = make(tmp_path)
    assert list(open_cloud(path).columns) == ['x', 'y', 'z', 'ring', 'time']
    time, y, ring = columns(path, 'time', 'y', 'ring')
    expected = table()
    np.testing.assert_array_equal(y, expected['y'].to_numpy())
    np.testing.assert_array_equal(ring, expected['ring'].to_numpy())
    np.testing.assert_array_equal(time, np.arange(COUNT) * 1_001_000)
    assert time.dtype == np.int64


@pytest.mark.parametrize('compression', ['zstd', 'none'])
def test_unchanged(tmp_path: Path, compression: str) -> None:
    """Copies have the content of their rows, metadata, row groups and compression."""
    path = make(tmp_path, compression)
    copy = copied(path, Change())
    assert parquet.read_table(copy).equals(parquet.read_table(path), check_metadata=True)
    before, after = parquet.ParquetFile(path).metadata, parquet.ParquetFile(copy).metadata
    assert after.num_row_groups == before.num_row_groups == 4
    for i in range(before.num_columns):
        one, other = before.row_group(0).column(i), after.row_group(0).column(i)
        assert other.compression == one.compression
        assert other.physical_type == one.physical_type
    keep = every_third(COUNT)
    keep[300:600] = False
    expected = parquet.read_table(path).filter(pa.array(keep))
    copy = copied(path, Change(keep=keep))
    assert parquet.read_table(copy).equals(expected, check_metadata=True)


def test_damaged(tmp_path: Path) -> None:
    """A file with damaged columns is refused when they are read."""
    path = make(tmp_path)
    data = bytearray(path.read_bytes())
    data[4:4000] = bytes(3996)
    path.write_bytes(data)
    with pytest.raises(CloudError, match=r'cloud\.parquet must be readable, got "'):
        columns(path)


@pytest.mark.parametrize(
    ('said', 'other', 'refusal'),
    [
        # The footer has numbers n as 2 |n|, less 1 below 0, in sevens of bits, the lowest first.
        (b'\xd0\x0f', b'\xd2\x0f', 'of 1001 points, as it says, got 1000'),
        (b'\xd0\x0f', b'\xcf\x0f', 'of -1000 points, as it says, got 1000'),
        (b'\xd8\x04', b'\xd7\x04', r'cloud\.parquet must be at least 0, got -300'),
    ],
)
def test_counts_that_lie(tmp_path: Path, said: bytes, other: bytes, refusal: str) -> None:
    """The counts of all points and of each part agree, and none is negative."""
    path = make(tmp_path)
    data = path.read_bytes()
    footer = len(data) - 8 - int.from_bytes(data[-8:-4], 'little')
    path.write_bytes(data[:footer] + data[footer:].replace(b'\x16' + said, b'\x16' + other))
    with pytest.raises(CloudError, match=refusal):
        open_cloud(path)


def test_no_change_of_the_footer_ends_the_process(tmp_path: Path) -> None:
    """A file with one changed byte of the footer is copied or refused; pyarrow may not abort."""
    path, other = tmp_path / 'cloud.parquet', tmp_path / 'other.parquet'
    more = {'name': ['a', None, 'b'], 'list': [[1, 2], None, [3]]}
    parquet.write_table(pa.table({**{name: np.arange(3.0) for name in 'xyz'}, **more}), path)
    data = path.read_bytes()
    footer = len(data) - 8 - int.from_bytes(data[-8:-4], 'little')
    for at in range(footer, len(data) - 8):
        changed = bytearray(data)
        changed[at] ^= 1
        other.write_bytes(changed)
        with suppress(CloudError):
            copied(other, Change())


@pytest.mark.parametrize(
    ('zone', 'unit'), [('UTC', 'ns'), ('Europe/Zurich', 'us'), ('+02:00', 'ms')]
)
def test_times_with_a_zone(tmp_path: Path, zone: str, unit: str) -> None:
    """A time with a zone is the same number of nanoseconds since 1970, and is copied as it is."""
    path, kind = tmp_path / 'cloud.parquet', pa.timestamp(unit, zone)
    times = pa.array([0, 1_700_000_000_000, None], pa.timestamp('ms')).cast(kind)
    parquet.write_table(pa.table({'x': [1.0, 2.0, 3.0], 'time': times}), path)
    assert list(open_cloud(path).columns) == ['x', 'time']
    np.testing.assert_array_equal(columns(path, 'time')[0], [0, 1_700_000_000_000_000_000, np.nan])
    copy = copied(path, Change(added={'outlier': np.zeros(3, np.uint8)}))
    assert parquet.read_table(copy).drop_columns(['outlier']).equals(parquet.read_table(path))
    parquet.write_table(pa.Table.from_arrays([times] * 2, names=['x', 'x']), path)
    with pytest.raises(CloudError, match='must be of different names, got x'):
        open_cloud(path)


def test_more_points_than_are_judged(tmp_path: Path) -> None:
    """A small file of very many points is refused by its footer, before memory is allocated."""
    path, count = tmp_path / 'flat.parquet', 3_000_000
    column = pa.DictionaryArray.from_arrays(np.zeros(count, np.int32), [0.5])
    table = pa.table(dict.fromkeys('xyz', column.dictionary_decode()))
    parquet.write_table(table, path, compression='zstd', row_group_size=count)
    assert path.stat().st_size < count / 50
    file = open_cloud(path)
    parameters = FilterParameters().changed({'max_points': count - 1, 'chain': ['sor']})
    tracemalloc.start()
    with pytest.raises(CloudError, match=f'at most max_points = {count - 1}, .*, got {count}'):
        judge_file(file, CleanOptions(), parameters)
    assert tracemalloc.get_traced_memory()[1] < 1_000_000
    tracemalloc.stop()
