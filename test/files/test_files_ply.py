# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""PLY: comments, other elements and their lists are kept, in text and both byte orders."""

import struct
from pathlib import Path

import pytest
from helpers.cloud_files import check_refused, columns, copied, every_third, verdict

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.cloud_file import Change, open_cloud

HEADER = """ply
format {form} 1.0
comment made by hand
element vertex 6
property float x
comment in between
property double y
property float z
property uchar class
{more}end_header
"""
FACES = 'element face 2\nproperty list uchar int vertex_indices\nelement edge 1\nproperty int a\n'
ADDED = 'property uchar outlier\nproperty float outlier_score\nproperty ushort outlier_detectors\n'
FORMS = {'ascii': '', 'binary_little_endian': '<', 'binary_big_endian': '>'}
POINTS = [(i / 4, -i / 8, float(i), 250 + i) for i in range(6)]


def vertices(order: str) -> list[bytes]:
    """Six points."""
    if not order:
        return [b'%g %.4f %.2f %d\n' % point for point in POINTS]
    return [struct.pack(order + 'fdfB', *point) for point in POINTS]


def faces(order: str) -> bytes:
    """Faces and an edge behind the vertices."""
    if not order:
        return b'3 0 1 2\n4 2 3 4 5\n-7\n'
    return struct.pack(order + 'B3iB4ii', 3, 0, 1, 2, 4, 2, 3, 4, 5, -7)


def make(folder: Path, form: str = 'ascii', *, with_faces: bool = False) -> Path:
    """Write six points, and other elements behind them."""
    path = folder / f'{form}.ply'
    header = HEADER.format(form=form, more=FACES if with_faces else '').encode()
    tail = faces(FORMS[form]) if with_faces else b''
    path.write_bytes(header + b''.join(vertices(FORMS[form])) + tail)
    return path


@pytest.mark.parametrize('form', FORMS)
def test_columns(tmp_path: Path, form: str) -> None:
    """The properties of vertices are columns, in their own types."""
    path = make(tmp_path, form, with_faces=True)
    found = columns(path)
    assert list(open_cloud(path).columns) == ['x', 'y', 'z', 'class']
    for column, expected in zip(found, zip(*POINTS, strict=True), strict=True):
        assert column.tolist() == list(expected)
    assert [column.dtype.itemsize for column in found] == [4, 8, 4, 1]


@pytest.mark.parametrize('form', FORMS)
def test_copies_keep_bytes(tmp_path: Path, form: str) -> None:
    """Points that stay and other elements keep their bytes; no vertex of a face is removed."""
    path, keep = make(tmp_path, form), every_third(6)
    copy = copied(path, Change(keep=keep))
    kept = [point for point, stays in zip(vertices(FORMS[form]), keep, strict=True) if stays]
    header = HEADER.format(form=form, more='').replace('vertex 6', 'vertex 4').encode()
    assert copy.read_bytes() == header + b''.join(kept)
    path = make(tmp_path, form, with_faces=True)
    with pytest.raises(CloudError, match=r'marked, got removed: its elements face name v'):
        copied(path, Change(keep=keep))
    data = copied(path, Change(added=verdict(6))).read_bytes()
    first = vertices(FORMS[form])[0].rstrip(b'\n')
    assert data.startswith(HEADER.format(form=form, more=ADDED + FACES).encode() + first)
    assert data.endswith(faces(FORMS[form]))


def test_line_ends(tmp_path: Path) -> None:
    """CRLF stays CRLF, also in added lines."""
    path = make(tmp_path, with_faces=True)
    path.write_bytes(path.read_bytes().replace(b'\n', b'\r\n'))
    before = columns(path)
    copy = copied(path, Change(added=verdict(6)))
    assert copy.read_bytes().count(b'\n') == copy.read_bytes().count(b'\r\n')
    assert [one.tobytes() for one in columns(copy)[:4]] == [one.tobytes() for one in before]


@pytest.mark.parametrize(
    ('old', 'new', 'sentence'),
    [
        ('ascii', 'latin', "got 'latin'"),
        ('element vertex', 'element point', 'the first element of .* must be vertex, got point'),
        ('property float x', 'property list uchar int x', 'must be without lists, got a list'),
        ('property float x', 'property list float int x', 'must be a whole number'),
        ('property double y', 'property double x', 'must be of different names, got x'),
        ('property float x', 'property x', "got 'property x"),
        ('property float x', 'property half x', "got 'half'"),
        ('0.25 ', 'no ', 'must be readable, got "could not convert'),
        ('0.25 ', '0.25 7 ', 'point 2 of .* must be of 4 numbers, got 5'),
    ],
)
def test_refused(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    """A header that cannot be true is refused in one sentence."""
    check_refused(make(tmp_path), old, new, sentence)


def test_room_for_elements(tmp_path: Path) -> None:
    """Elements behind binary vertices must fit into the file; a vertex has a size."""
    path = make(tmp_path, 'binary_little_endian', with_faces=True)
    data = path.read_bytes()
    path.write_bytes(data.replace(b'element edge 1', b'element edge 9'))
    with pytest.raises(CloudError, match='the bytes of all elements of'):
        open_cloud(path)
    path.write_bytes(b'ply\nformat binary_little_endian 1.0\nelement vertex 3\nend_header\n')
    with pytest.raises(CloudError, match='must be with properties, got none'):
        open_cloud(path)
