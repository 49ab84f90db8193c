# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What every format promises: bytes, order and types are kept; headers are not trusted."""

from pathlib import Path

import numpy as np
import pytest
from helpers.cloud_files import columns, copied, every_third, verdict
from helpers.hostile import COUNT, FORMATS, whole_file

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files import cloud_file, points
from lidar_outlier_filter.files.clean import clean_file
from lidar_outlier_filter.files.cloud_file import Change, copy_suffix, open_cloud
from lidar_outlier_filter.files.judged_file import describe_file
from lidar_outlier_filter.parameters.filter import FilterParameters

EXACT = [kind for kind in FORMATS if kind not in {'laz', 'pcd binary_compressed', 'e57', 'db'}]
MODULES = ('rows', 'las', 'e57', 'parquet', 'sqlite')


@pytest.fixture
def path(tmp_path: Path, kind: str) -> Path:
    """Write a cloud of the format."""
    path = tmp_path / f'cloud.{kind.split(maxsplit=1)[0]}'
    whole_file(kind, path)
    return path


def copy_of(path: Path, change: Change) -> Path:
    """Copy a cloud, changed."""
    return copied(path, change, f'copy{copy_suffix(path)}')


@pytest.mark.parametrize('kind', EXACT)
def test_a_copy_is_the_file(path: Path) -> None:
    """Without a change, every byte is that of the file."""
    assert copy_of(path, Change()).read_bytes() == path.read_bytes()


@pytest.mark.parametrize('kind', FORMATS)
def test_order(path: Path) -> None:
    """Columns are returned in the requested order, and repeatedly."""
    z, x = columns(path, 'z', 'x')
    for name, values in (('x', x), ('z', z)):
        assert len(values) == COUNT
        np.testing.assert_array_equal(columns(path, name)[0], values)
    assert not np.array_equal(x, z)


@pytest.mark.parametrize('kind', [kind for kind in FORMATS if kind != 'ptx'])
def test_added_columns(path: Path) -> None:
    """They stand behind the others, with their types; the others stay as they are."""
    added = verdict(COUNT)
    before = dict(zip(open_cloud(path).columns, columns(path), strict=True))
    copy = copy_of(path, Change(added=added))
    table = 't_verdict' if path.suffix == '.db' else None
    names = list(open_cloud(copy, table).columns)
    assert names[-3:] == list(added)
    for name, values in (added if table else before | added).items():
        found = columns(copy, name, table=table)[0]
        np.testing.assert_array_equal(found.astype(values.dtype), values)
        assert table or path.suffix == '.csv' or found.dtype.itemsize == values.dtype.itemsize


@pytest.mark.parametrize('kind', FORMATS)
@pytest.mark.parametrize('keep', [every_third(COUNT), np.zeros(COUNT, np.bool_)])
def test_removed_points(path: Path, keep: np.typing.NDArray[np.bool_]) -> None:
    """The others stay as they are; in a grid a missing return takes the place of a point."""
    file = open_cloud(path)
    if file.whole:
        with pytest.raises(CloudError, match='must be marked, got removed'):
            copy_of(path, Change(keep=keep))
        return
    copy = copy_of(path, Change(keep=keep))
    if not keep.any() and not file.gaps:
        with pytest.raises(CloudError, match='must be of at least one point, got 0'):
            open_cloud(copy)
        return
    kept = slice(None) if file.gaps else keep
    for name, before in zip('xyz', columns(path, *'xyz'), strict=True):
        found = columns(copy, name)[0]
        np.testing.assert_array_equal(found, np.where(keep, before, np.nan)[kept])
        assert found.dtype == before.dtype


@pytest.mark.parametrize('kind', FORMATS)
def test_chunks(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Chunk by chunk, points and copies are the same as at once."""
    change = Change() if path.suffix == '.ptx' else Change(added=verdict(COUNT))
    at_once, copy = columns(path), copy_of(path, change).read_bytes()
    for module in MODULES:
        monkeypatch.setattr(f'lidar_outlier_filter.files.{module}.CHUNK_ROWS', 7)
    for one, other in zip(columns(path), at_once, strict=True):
        assert one.tobytes() == other.tobytes()
    (path.parent / 'copied').rename(path.parent / 'before')
    if path.suffix not in {'.db', '.laz'}:
        assert copy_of(path, change).read_bytes() == copy


@pytest.mark.parametrize('kind', FORMATS)
@pytest.mark.parametrize('share', [0.0, 0.02, 0.3, 0.6, 0.9])
def test_truncated(path: Path, share: float) -> None:
    """A file that ends too early is refused in one sentence; a table has fewer rows, whole ones."""
    data = path.read_bytes()
    cut = data[: int(share * len(data))]
    path.write_bytes(cut)
    if path.suffix == '.csv' and share > 0.1:
        path.write_bytes(cut[: cut.rindex(b'\n') + 1])
        assert len(open_cloud(path)) == cut.count(b'\n') - 1
        return
    if path.suffix == '.csv':
        path.write_bytes(cut[: len('x y z\n')])
    with pytest.raises(CloudError, match=r' must be ') as caught:
        columns(path)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize(
    'kind', [kind for kind in FORMATS if kind.split()[0] in {'las', 'pcd', 'ply', 'ptx'}]
)
def test_wrong_counts(path: Path, kind: str) -> None:
    """A count of more or fewer points than there are is refused, before memory is allocated."""
    data = path.read_bytes()
    if b'element face' in data:  # lists, which may have any length
        head, _, body = data.partition(b'element face 1\nproperty list uchar int vertex_indices\n')
        data = head + body[: -8 if 'ascii' in kind else -13]
    rows = {'pcd': b'WIDTH %d', 'ply': b'vertex %d', 'ptx': b'%d\n5'}.get(kind.split(maxsplit=1)[0])
    for said in (1, COUNT // 5 - 1, COUNT + 1, 10**9, 2**40):
        if rows is None:
            path.write_bytes(data[:247] + said.to_bytes(8, 'little') + data[255:])
        else:
            count = COUNT // 10 if kind == 'ptx' else COUNT
            other = data.replace(b'POINTS %d' % COUNT, b'POINTS %d' % said)
            path.write_bytes(other.replace(rows % count, rows % said, 1))
        with pytest.raises(CloudError, match=r' must be '):
            columns(path)


@pytest.mark.parametrize('kind', ['pcd binary', 'ply binary_little_endian', 'parquet'])
def test_signalling_nan(tmp_path: Path, kind: str) -> None:
    """Of a signalling NaN, which any bytes may be, no warning comes: the point is missing."""
    path = tmp_path / f'a.{kind.partition(" ")[0]}'
    whole_file(kind, path)
    (x, *_) = next(cloud_file.read(open_cloud(path), ['x']))
    data = path.read_bytes()
    assert data.count(x[3].tobytes()) == 1
    path.write_bytes(data.replace(x[3].tobytes(), b'\x01\x00\x80\x7f'))
    loaded = points.load(open_cloud(path), ('x', 'y', 'z'), FilterParameters())
    assert np.flatnonzero(~loaded.points.valid).tolist() == [3]
    describe_file(path)


def test_a_file_that_warned(real_data: Path, tmp_path: Path) -> None:
    """A file is refused in one sentence, without a warning before it."""
    path = real_data / 'hostile' / 'warning.ply'
    with pytest.raises(CloudError, match='must be within'):
        clean_file(path, tmp_path / 'out.ply', FilterParameters())
