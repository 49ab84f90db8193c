# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Headers that lie: counts, offsets and sizes that do not fit into the file are refused."""

from __future__ import annotations

import struct
import tracemalloc
from time import perf_counter
from typing import TYPE_CHECKING

import laspy
import pytest
from helpers.cloud_files import columns

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.clean import clean_file
from lidar_outlier_filter.files.cloud_file import check_points, open_cloud
from lidar_outlier_filter.parameters.filter import FilterParameters

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

SOON = 5.0  # seconds
LITTLE = 50_000_000  # bytes
COUNT = 300
PCD = (
    'FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {0}\nHEIGHT 1\nPOINTS {0}\nDATA {1}\n'
)


def las(folder: Path, name: str = 'cloud.las', point_format: int = 6) -> Path:
    """Write a file of 300 points with a record before them and one behind them."""
    header = laspy.LasHeader(point_format=point_format, version='1.4')
    header.vlrs.append(laspy.VLR('someone', 77, 'a note', b'note'))
    points = laspy.ScaleAwarePointRecord.zeros(COUNT, header=header)
    points['X'], points['Y'] = range(COUNT), range(COUNT, 0, -1)
    path = folder / name
    with laspy.open(path, 'w', header=header) as writer:
        writer.write_points(points)
        writer.write_evlrs(laspy.vlrs.vlrlist.VLRList([laspy.VLR('someone', 78, '', b'more')]))
    return path


def rows(count: int = COUNT) -> bytes:
    """Make rows of three numbers that are not zero."""
    return struct.pack('<3f', 1.5, 2.5, 3.5) * count


def patch(path: Path, offset: int, data: bytes) -> Path:
    """Overwrite some bytes of a file."""
    whole = bytearray(path.read_bytes())
    whole[offset : offset + len(data)] = data
    path.write_bytes(whole)
    return path


def number(path: Path, offset: int, size: int) -> int:
    """Read a number out of a file."""
    return int.from_bytes(path.read_bytes()[offset : offset + size], 'little')


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
    """A count or an offset beyond what is in the file is refused, whatever it counts."""
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
    refused(patch(path, number(path, pointer, width) + 20, size), 'the bytes in a record of')


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
    """Whatever the library for LAZ makes of it, and if it ends its process, the file is refused."""
    path = las(tmp_path, 'cloud.laz', point_format)
    begin = number(path, 96, 4)
    places = {
        'points': begin,
        'layers': begin + 8 + number(path, 105, 2) + 4,
        'table': number(path, begin, 8),
        'record': path.read_bytes().index(b'laszip encoded') - 2 + 54,
    }
    if part != 'layers' or point_format == 6:  # the older ones have no layers
        refused(patch(path, places[part] + offset, data))


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
