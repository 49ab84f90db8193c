# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""PCD: comments, padding, counts and numbers are kept in all three forms."""

import struct
from pathlib import Path
from typing import Any

import lzf
import numpy as np
import pytest
from helpers.cloud_files import check_refused, columns, copied, every_third, verdict

from lidar_outlier_filter.files.cloud_file import Change, open_cloud

HEADER = """# .PCD v0.7 - Point Cloud Data file format
# a comment of its own
VERSION 0.7
FIELDS x y z _ normal ring _ time
SIZE 4 4 4 1 4 2 1 8
TYPE F F F U F U U F
COUNT 1 1 1 4 3 1 2 1
WIDTH 4
HEIGHT 3
VIEWPOINT 0 0 1.50 1 0 0 0
POINTS 12
DATA {}
"""
ROW = np.dtype(
    {
        'names': ['x', 'y', 'z', 'normal', 'ring', 'time'],
        'formats': ['<f4', '<f4', '<f4', ('<f4', (3,)), '<u2', '<f8'],
        'offsets': [0, 4, 8, 16, 28, 32],
        'itemsize': 40,
    }
)
PARTS = (4, 4, 4, 4, 12, 2, 2, 8)  # bytes of the fields, padding too
FORMS = ('ascii', 'binary', 'binary_compressed')


def rows() -> bytes:
    """Twelve points that are noise, bit for bit, padding too; x is no NaN."""
    data = bytearray(np.random.default_rng(3).bytes(12 * ROW.itemsize))
    np.frombuffer(data, ROW)['x'][:] = np.arange(12) / 3
    return bytes(data)


def as_columns(data: bytes) -> bytes:
    """Sort bytes of rows by field, as binary_compressed does."""
    table = np.frombuffer(data, np.uint8).reshape(-1, sum(PARTS))
    ends = np.cumsum(PARTS)
    return b''.join(table[:, e - n : e].tobytes() for e, n in zip(ends, PARTS, strict=True))


def ascii_lines() -> list[bytes]:
    """Twelve points as text, each number in a spelling that no program would print."""
    line = '{0}.10 +{0}.250 -1e-0{0} 1 2 3 4 0.50 nan 7 {0} 0 00 171000000{0}.{0}\n'
    return [line.format(i % 7).encode() for i in range(12)]


def make(folder: Path, form: str) -> Path:
    """Write an organised cloud of twelve points."""
    data = b''.join(ascii_lines()) if form == 'ascii' else rows()
    if form == 'binary_compressed':
        packed = lzf.compress(as_columns(data), 2000)
        data = struct.pack('<II', len(packed), len(data)) + packed
    path = folder / f'{form}.pcd'
    path.write_bytes(HEADER.format(form).encode() + data)
    return path


def body(path: Path) -> bytes:
    """Return what follows the header."""
    data = path.read_bytes()
    return data[data.index(b'\n', data.index(b'DATA')) + 1 :]


def unpacked(path: Path) -> Any:
    """Return the columns of a compressed file."""
    packed, size = struct.unpack('<II', body(path)[:8])
    data = lzf.decompress(body(path)[8:], size)
    assert packed == len(body(path)) - 8
    assert size == len(data)
    return data


def header(path: Path) -> dict[str, str]:
    """Return the lines of the header by their first word."""
    lines = path.read_bytes().split(b'DATA')[0].decode().splitlines()
    return {line.split()[0]: line for line in lines if not line.startswith('#')}


def test_incompressible(tmp_path: Path) -> None:
    """Bytes that LZF cannot make smaller are written all the same."""
    fields = b'FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1200\nHEIGHT 1\nDATA binary_compressed\n'
    data = np.random.default_rng(1).random((3, 1200), np.float32).tobytes()
    packed = lzf.compress(data, 2 * len(data))
    path = tmp_path / 'cloud.pcd'
    path.write_bytes(fields + struct.pack('<II', len(packed), len(data)) + packed)
    assert unpacked(copied(path, Change())) == data


@pytest.mark.parametrize('form', FORMS)
def test_columns(tmp_path: Path, form: str) -> None:
    """Fields of one number are columns; padding and fields of several numbers are not."""
    path = make(tmp_path, form)
    assert list(open_cloud(path).columns) == ['x', 'y', 'z', 'ring', 'time']
    written = np.frombuffer(rows(), ROW)
    expected: list[Any] = [written[name] for name in ('x', 'ring', 'time')]
    if form == 'ascii':
        i = np.arange(12) % 7
        expected = [np.float32(i + 0.1), i, 1710000000 + i * 1.1]
    for found, values in zip(columns(path, 'x', 'ring', 'time'), expected, strict=True):
        np.testing.assert_array_equal(found, values)


@pytest.mark.parametrize('form', FORMS)
def test_copies_keep_bytes(tmp_path: Path, form: str) -> None:
    """Points keep their bytes; a cloud with removed points is not organised."""
    path, keep, added = make(tmp_path, form), every_third(12), verdict(12)
    copy = copied(path, Change(keep=keep))
    kept = np.frombuffer(rows(), (np.void, ROW.itemsize))[keep].tobytes()
    expected = {
        'ascii': b''.join(np.array(ascii_lines(), object)[keep]),
        'binary': kept,
        'binary_compressed': as_columns(kept),
    }
    assert (unpacked(copy) if 'compressed' in form else body(copy)) == expected[form]
    changed = {'WIDTH': 'WIDTH 8', 'HEIGHT': 'HEIGHT 1', 'POINTS': 'POINTS 8'}
    assert header(copy) == header(path) | changed
    assert b'# a comment of its own\n' in copy.read_bytes()
    copy = copied(path, Change(added=added))
    more = {'FIELDS': ' '.join(added), 'SIZE': '1 4 2', 'TYPE': 'U F U', 'COUNT': '1 1 1'}
    changed = {name: f'{header(path)[name]} {text}' for name, text in more.items()}
    assert header(copy) == header(path) | changed
    if form == 'ascii':
        lines = body(copy).splitlines()
        assert [line.rsplit(b' ', 3)[0] + b'\n' for line in lines] == ascii_lines()
    elif form == 'binary':
        wider = np.frombuffer(body(copy), np.uint8).reshape(12, -1)
        assert wider.shape[1] == ROW.itemsize + 7
        assert wider[:, : ROW.itemsize].tobytes() == rows()
    else:
        assert unpacked(copy).startswith(as_columns(rows()))


def test_other_headers_and_line_ends(tmp_path: Path) -> None:
    """COUNT, POINTS and the last line's end may be missing; words may be small; CRLF stays."""
    path = tmp_path / 'cloud.pcd'
    head = 'fields x y z\nsize 4 4 4\ntype F F F\nwidth 2\nheight 1\ndata ascii\n'
    path.write_bytes(f'{head}1 2 3\n4 5 6'.replace('\n', '\r\n').encode())
    assert [column.tolist() for column in columns(path)] == [[1, 4], [2, 5], [3, 6]]
    copy = copied(path, Change(added=verdict(2)))
    assert columns(copy, 'z')[0].tolist() == [3, 6]
    assert b'COUNT' not in copy.read_bytes()
    assert copy.read_bytes().splitlines(keepends=True)[-2].endswith(b'\r\n')
    path.write_bytes(path.read_bytes() + b'\n \n\n')
    assert len(columns(path, 'x')[0]) == 2


@pytest.mark.parametrize(
    ('old', 'new', 'sentence'),
    [
        ('POINTS 12', 'POINTS 11', 'must be WIDTH × HEIGHT = 12, got 11'),
        ('DATA ascii', 'DATA zip', "must be ascii, binary or binary_compressed, got 'zip'"),
        ('FIELDS x y', 'FIELDS x x', 'must be of different names, got x'),
        ('SIZE 4 4', 'SIZE 4', 'must be of one length, got 8, 7, 8 and 8'),
        ('WIDTH 4\n', '', 'must be complete, got no WIDTH'),
        ('WIDTH 4', 'WIDTH four', "WIDTH of .* must be a whole number, got 'four'"),
        ('+0.250', 'zero', 'must be readable, got "could not convert'),
        ('+0.250', '+0.250 7', 'point 1 of .* must be of 14 numbers, got 15'),
        ('F F F U', 'Q F F U', 'must be I or U of 1, 2, 4 or 8 bytes, or F of 4 or 8, got Q of 4'),
    ],
)
def test_refused(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    """A header that cannot be true is refused in one sentence."""
    check_refused(make(tmp_path, 'ascii'), old, new, sentence)
