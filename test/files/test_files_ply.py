# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""PLY: comments, other elements and their lists are kept, in text and both byte orders."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import numpy as np
import pytest
from helpers.cloud_files import columns, copied, every_third, verdict

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.cloud_file import Change, open_cloud

if TYPE_CHECKING:
    from pathlib import Path

HEADER = """ply
format {form} 1.0
comment made by hand
obj_info of nothing in particular
element camera 2
property list uchar float lens
property double angle
element vertex 6
property float x
comment in between
property double y
property float32 z
property uchar class
{faces}end_header
"""
FACES = """element face 2
property list uchar int vertex_indices
element edge 1
property int weight
"""
FORMS = {'ascii': '', 'binary_little_endian': '<', 'binary_big_endian': '>'}
POINTS = [(i / 4, -i / 8, float(i), 250 + i) for i in range(6)]


def camera(order: str) -> bytes:
    """Two elements, of different length, in front of the vertices."""
    if not order:
        return b'3 1.50 0.5 2 90\n0 45\n'
    return struct.pack(order + 'BfffdBd', 3, 1.5, 0.5, 2, 90, 0, 45)


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


def make(folder: Path, form: str, *, with_faces: bool = False) -> Path:
    """Write six points between other elements."""
    order = FORMS[form]
    path = folder / f'{form}.ply'
    header = HEADER.format(form=form, faces=FACES if with_faces else '').encode()
    tail = faces(order) if with_faces else b''
    path.write_bytes(header + camera(order) + b''.join(vertices(order)) + tail)
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
def test_some_points(tmp_path: Path, form: str) -> None:
    """A copy of some points has their bytes between all that is around them."""
    path = make(tmp_path, form)
    keep = every_third(6)
    copy = copied(path, Change(keep=keep))
    kept = [point for point, stays in zip(vertices(FORMS[form]), keep, strict=True) if stays]
    header = HEADER.format(form=form, faces='').replace('vertex 6', 'vertex 4').encode()
    assert copy.read_bytes() == header + camera(FORMS[form]) + b''.join(kept)


@pytest.mark.parametrize('form', FORMS)
def test_added_columns(tmp_path: Path, form: str) -> None:
    """Added columns stand behind the others, which keep their bytes, as does all else."""
    path = make(tmp_path, form, with_faces=True)
    added = verdict(6)
    copy = copied(path, Change(added=added))
    for name, values in added.items():
        assert columns(copy, name)[0].dtype.newbyteorder('=') == values.dtype
        np.testing.assert_array_equal(columns(copy, name)[0], values)
    text = (
        'property uchar outlier\nproperty float outlier_score\nproperty ushort outlier_detectors\n'
    )
    header = HEADER.format(form=form, faces=text + FACES).encode()
    data = copy.read_bytes()
    assert data.startswith(header + camera(FORMS[form]) + vertices(FORMS[form])[0].rstrip(b'\n'))
    assert data.endswith(faces(FORMS[form]))
    before = columns(path)
    assert [one.tobytes() for one in columns(copy)[:4]] == [one.tobytes() for one in before]


def test_vertices_that_faces_name_stay(tmp_path: Path) -> None:
    """No vertex is removed while faces count on its number."""
    for form in FORMS:
        path = make(tmp_path, form, with_faces=True)
        with pytest.raises(CloudError, match=r'marked, got removed: its elements face name v'):
            copied(path, Change(keep=every_third(6)))


def test_line_ends(tmp_path: Path) -> None:
    """CRLF stays CRLF, in what is added too."""
    path = make(tmp_path, 'ascii', with_faces=True)
    path.write_bytes(path.read_bytes().replace(b'\n', b'\r\n'))
    before = columns(path)
    assert copied(path, Change()).read_bytes() == path.read_bytes()
    copy = copied(path, Change(added=verdict(6)))
    assert copy.read_bytes().count(b'\n') == copy.read_bytes().count(b'\r\n')
    assert [one.tobytes() for one in columns(copy)[:4]] == [one.tobytes() for one in before]


@pytest.mark.parametrize(
    ('old', 'new', 'sentence'),
    [
        ('ascii', 'latin', "got 'latin'"),
        ('element vertex', 'element point', 'must be one, got 0'),
        ('property float x', 'property list uchar int x', 'must be without lists, got a list'),
        ('property double y', 'property double x', 'must be of different names, got x'),
        ('property float x', 'property x', "got 'property x\\n'"),
        ('property float x', 'property half x', "got 'half'"),
        ('0.25 ', 'no ', 'must be readable, got "could not convert'),
        ('0.25 ', '0.25 7 ', 'point 2 of {} must be of 4 numbers, as it says, got 5'),
    ],
)
def test_refused(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    """A file that makes no sense is refused in one sentence."""
    path = make(tmp_path, 'ascii')
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(CloudError) as caught:
        columns(path)
    assert sentence.format(path) in str(caught.value)
