# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""LAS and LAZ: every byte of header, records and points that is not to change is kept."""

import struct
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from helpers.cloud_files import columns, copied, every_third, number, patch, verdict
from helpers.copc import LASZIP, write_copc
from numpy.typing import NDArray

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.cloud_file import Change, open_cloud

REAL = (
    'autzen-point-format-3.las',
    'autzen_trim.laz',
    'plane.laz',
    'sample_lareunion_epsg2975.laz',
    'test_semis_2021_0382_6565_LA93_IGN69_cropped.laz',
)


def raw(path: Path) -> NDArray[np.void]:
    """Read the point records as they are."""
    points: NDArray[np.void] = laspy.read(path).points.array
    return points


def records(path: Path, *, extended: bool = False) -> list[bytes]:
    """Read the (extended) variable length records as they are, that of LASzip left out."""
    data, found = path.read_bytes(), []
    offset = number(data, 235, 8) if extended else number(data, 94, 2)
    count = number(data, 243, 4) if extended else number(data, 100, 4)
    for _ in range(count):
        head, width = (60, 8) if extended else (54, 2)
        end = offset + head + number(data, offset + 20, width)
        if number(data, offset + 18, 2) != LASZIP:
            found.append(data[offset:end])
        offset = end
    return found


def make(path: Path, point_format: int = 3, version: str = '1.4', count: int = 1000) -> Path:
    """Write a file whose points are noise, bit for bit, with an extra dimension."""
    header = laspy.LasHeader(point_format=point_format, version=version)
    header.scales, header.offsets = [0.01, 0.02, 0.03], [1e5, -2e6, 0.5]
    header.add_extra_dim(laspy.ExtraBytesParams('heat', np.int32, scales=[0.1], offsets=[5.0]))
    size = header.point_format.size
    bits = np.random.default_rng(point_format).bytes(size * count)
    points = laspy.ScaleAwarePointRecord(
        np.frombuffer(bits, header.point_format.dtype()),
        header.point_format,
        header.scales,
        header.offsets,
    )
    header.vlrs.append(laspy.VLR('someone', 77, 'a note', b'\0\xff' * 20))
    with laspy.open(path, 'w', header=header) as writer:
        writer.write_points(points)
        if version == '1.4':
            more = [laspy.VLR('someone', 78, 'a long note', b'\1\2\3' * 50_000)]
            writer.write_evlrs(laspy.vlrs.vlrlist.VLRList(more))
    return path


@pytest.fixture
def real(real_data: Path, tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    """Copy a real file to where its output may be put beside it."""
    path = tmp_path / str(request.param)
    path.write_bytes((real_data / 'clouds' / path.name).read_bytes())
    return path


@pytest.mark.parametrize('real', REAL, indirect=True)
def test_real_files(real: Path) -> None:
    """Header, records and points of a copy are those of the file, except for changes."""
    before, points = real.read_bytes(), raw(real)
    copy = copied(real, Change())
    after = copy.read_bytes()
    assert after[:94] == before[:94]
    assert after[104:227] == before[104:227]
    assert records(copy) == records(real)
    assert raw(copy).tobytes() == points.tobytes()
    if real.suffix == '.las':
        assert after == before
    chosen = every_third(len(points))
    kept = laspy.read(copied(real, Change(keep=chosen)))
    assert kept.points.array.tobytes() == points[chosen].tobytes()
    assert kept.header.point_count == chosen.sum()
    np.testing.assert_allclose(kept.header.mins, kept.xyz.min(axis=0))
    np.testing.assert_allclose(kept.header.maxs, kept.xyz.max(axis=0))
    by_return = np.bincount(np.array(kept.return_number), minlength=16)[1:16]
    np.testing.assert_array_equal(kept.header.number_of_points_by_return, by_return)


@pytest.mark.parametrize('point_format', range(11))
@pytest.mark.parametrize('suffix', ['.las', '.laz'])
def test_every_point_format(tmp_path: Path, point_format: int, suffix: str) -> None:
    """In any format of a point, marks change its class or its flag alone."""
    if suffix == '.laz' and point_format in {4, 5, 9, 10}:
        return  # LAZ leaves waveforms to others
    path = make(tmp_path / f'made{suffix}', point_format)
    before = raw(path)
    third = np.arange(len(before)) % 3
    change = Change(noise=third == 0, high=third == 1, withheld=third == 2)
    old = point_format < 6
    name, mask = ('raw_classification', 31) if old else ('classification', 255)
    flags, bit = ('raw_classification', 128) if old else ('classification_flags', 4)
    expected = before.copy()
    for number_of, chosen in ((7, third == 0), (18, third == 1)):
        expected[name][chosen] = (before[name][chosen] & ~np.uint8(mask)) | number_of
    expected[flags][third == 2] |= bit
    assert raw(copied(path, change)).tobytes() == expected.tobytes()


@pytest.mark.parametrize('suffix', ['.las', '.laz'])
def test_las_1_0(tmp_path: Path, suffix: str) -> None:
    """The first version is read and copied; the copy says the version of the file."""
    path = patch(make(tmp_path / f'old{suffix}', 1, '1.2'), 25, b'\0')
    copy = copied(path, Change(noise=np.ones(1000, np.bool_)))
    assert copy.read_bytes()[24:26] == b'\1\0'
    assert open_cloud(copy).about['LAS'] == '1.0'
    for name, values in zip(open_cloud(path).columns, columns(path), strict=True):
        expected = np.full(1000, 7) if name == 'classification' else values
        np.testing.assert_array_equal(columns(copy, name)[0], expected)


def test_header_and_records(tmp_path: Path) -> None:
    """Copies keep the header's texts, the records, and bytes between them."""
    path = make(tmp_path / 'made.las')
    patch(path, 26, b'SYSTEM\0behind the zero, no ASCII:\xff'[:32])
    patch(path, 90, struct.pack('<HH', 0, 0))  # no date
    offset = number(path.read_bytes(), 94, 2)
    patch(path, offset, b'\xbb\xaasixteen letters!')
    patch(path, offset + 22, b'a note\0behind the zero \xff')
    assert copied(path, Change()).read_bytes() == path.read_bytes()
    copy = copied(path, Change(keep=every_third(1000)))
    assert copy.read_bytes()[:94] == path.read_bytes()[:94]
    assert records(copy) == records(path)
    assert records(copy, extended=True) == records(path, extended=True)
    header = laspy.LasHeader(point_format=1, version='1.2')
    header.extra_header_bytes, header.extra_vlr_bytes = b'behind the header', b'behind them'
    with laspy.open(path, 'w', header=header) as writer:
        writer.write_points(laspy.ScaleAwarePointRecord.zeros(5, header=header))
    assert copied(path, Change()).read_bytes() == path.read_bytes()


@pytest.mark.parametrize('legacy', [True, False])
def test_legacy_counts(tmp_path: Path, *, legacy: bool) -> None:
    """LAS 1.4 repeats its counts for older readers where it did before, and only there."""
    path = make(tmp_path / 'made.las', point_format=1)
    returns = np.bincount(laspy.read(path).return_number, minlength=6)[1:6]
    counts = struct.pack('<6I', 1000, *returns) if legacy else bytes(24)
    patch(path, 107, counts)
    assert copied(path, Change()).read_bytes() == path.read_bytes()
    keep = every_third(1000)
    copy = copied(path, Change(keep=keep))
    kept = np.bincount(laspy.read(copy).return_number, minlength=6)[1:6]
    expected = struct.pack('<6I', keep.sum(), *kept) if legacy else bytes(24)
    assert copy.read_bytes()[107:131] == expected


@pytest.mark.parametrize('point_format', [3, 7])
def test_added_columns(tmp_path: Path, point_format: int) -> None:
    """Added columns are extra dimensions behind existing ones; everything else is kept."""
    path = make(tmp_path / 'made.laz', point_format)
    added = verdict(1000)
    copy = copied(path, Change(added=added))
    before, after = laspy.read(path), laspy.read(copy)
    names = list(before.point_format.dimension_names)
    assert list(after.point_format.dimension_names) == [*names, *added]
    for name in raw(path).dtype.names or ():
        assert after.points.array[name].tobytes() == before.points.array[name].tobytes()
    for name, values in added.items():
        assert after[name].dtype == values.dtype
        np.testing.assert_array_equal(after[name], values)
    np.testing.assert_array_equal(after['heat'], before['heat'])
    assert b'someone' in b''.join(records(copy))
    assert records(copy, extended=True) == records(path, extended=True)


def test_descriptions_of_extra_dimensions(tmp_path: Path) -> None:
    """Those of the file stay, byte by byte; an added one says its least and largest value."""
    path, count = tmp_path / 'extra.las', 50
    header = laspy.LasHeader(version='1.4', point_format=6)
    named = laspy.ExtraBytesParams
    header.add_extra_dims([named('height', np.int16, no_data=[-9999]), named('amp', 'u2', 'dB')])
    points = laspy.LasData(header)
    points.X = np.arange(count)
    points.height = np.full(count, -9999)
    points.write(path)
    score = np.linspace(0.25, 4, count).astype(np.float32)
    score[:2] = np.nan
    added: dict[str, np.ndarray[Any, Any]] = {
        'score': score,
        'bits': np.full(count, 64, np.uint16),
        'none': score * np.nan,
    }
    (before,) = (one[54:] for one in records(path) if one[2:11] == b'LASF_Spec')
    for keep in (None, score < 3):
        copy = copied(path, Change(keep, added=added))
        (after,) = (one[54:] for one in records(copy) if one[2:11] == b'LASF_Spec')
        assert after[: len(before)] == before
        said = [after[begin : begin + 192] for begin in range(len(before), len(after), 192)]
        assert [one[3] for one in said] == [6, 6, 0]
        largest = np.nanmax(score[slice(None) if keep is None else keep])
        limits = [
            struct.unpack_from('<d16xd', said[0], 64),
            struct.unpack_from('<Q16xQ', said[1], 64),
        ]
        assert limits == [(np.nanmin(score), largest), (64, 64)]
        copy.unlink()


def test_las_and_laz_are_one_format(tmp_path: Path) -> None:
    """A copy is compressed if its name says so, and the points are the same."""
    path = make(tmp_path / 'made.las', 6)
    packed = copied(path, Change(), 'made.laz')
    assert number(packed.read_bytes(), 104, 1) == 6 | 128
    assert copied(packed, Change(), 'again.las').read_bytes() == path.read_bytes()


@pytest.mark.parametrize('point_format', [3, 8])
def test_each_column_alone(tmp_path: Path, point_format: int) -> None:
    """Only what a column needs of a LAZ file is unpacked: its values are those of the whole.

    x, y and z are scaled, as are extra dimensions that have a scale.
    """
    path = make(tmp_path / 'made.laz', point_format)
    file, whole = open_cloud(path), laspy.read(path)
    for name in file.columns:
        (found,) = (np.concatenate(parts) for parts in zip(*file.read([name]), strict=True))
        np.testing.assert_array_equal(found, np.array(whole[name]), err_msg=name)
    z, heat = columns(path, 'z', 'heat')
    np.testing.assert_array_equal(z, raw(path)['Z'] * 0.03 + 0.5)
    np.testing.assert_array_equal(heat, raw(path)['heat'] * 0.1 + 5.0)


@pytest.mark.parametrize(
    ('offset', 'value', 'must_be'),
    [
        (131, 0.0, 'such that coordinates differ'),
        *((131, value, 'all coordinates are finite') for value in (np.nan, np.inf, -1e300)),
        *((163, value, 'all coordinates are finite') for value in (np.nan, np.inf)),
    ],
)
def test_scales_and_offsets(tmp_path: Path, offset: int, value: float, must_be: str) -> None:
    """Coordinates that are not finite, or all the same, are refused."""
    path = make(tmp_path / 'made.las', version='1.2')
    patch(path, 163, struct.pack('<d', -1e300))
    assert len(open_cloud(path)) == 1000
    patch(path, offset, struct.pack('<d', value))
    with pytest.raises(CloudError, match=must_be):
        open_cloud(path)


def test_copc(tmp_path: Path) -> None:
    """All levels are read, in the order of the file; the copy is LAZ without the records of COPC.

    Its points lie otherwise.
    """
    path = tmp_path / 'made.copc.laz'
    points = write_copc(path)
    x, time = columns(path, 'x', 'gps_time')
    np.testing.assert_array_equal(x, points['x'])
    np.testing.assert_array_equal(time, points['gps_time'])
    copy = copied(path, Change(noise=every_third(len(points))), 'made.laz')
    after = laspy.read(copy)
    np.testing.assert_array_equal(after['gps_time'], points['gps_time'])
    assert (np.array(after.classification)[every_third(len(points))] == 7).all()
    assert [record[-4:] for record in records(copy)] == [b'kept']
    assert [record[-9:] for record in records(copy, extended=True)] == [b'kept, too']


def test_chunks_that_differ_in_size(tmp_path: Path) -> None:
    """Of these the last one says how many points it has, in older point formats, too."""
    path = tmp_path / 'made.laz'
    points = write_copc(path, point_format=3)
    np.testing.assert_array_equal(columns(path, 'x')[0], points['x'])
    patch(path, 247, struct.pack('<Q', len(points) - 100))
    with pytest.raises(CloudError, match=f'{len(points)} points instead of {len(points) - 100}'):
        columns(path, 'x')


def test_what_would_get_lost(tmp_path: Path) -> None:
    """Waveforms in the file itself, and columns named as those of the verdict, are refused."""
    path = make(tmp_path / 'made.las', 4)
    copy = copied(path, Change(added=verdict(1000)))
    with pytest.raises(CloudError, match=r'must be without outlier, got x, y, z, intensity'):
        copied(copy, Change(added=verdict(1000)))
    patch(path, 6, b'\2\0')
    with pytest.raises(CloudError, match='with its waveforms in a file of their own'):
        open_cloud(path)
