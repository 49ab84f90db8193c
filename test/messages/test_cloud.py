# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The cloud codec: any layout is read without a copy, and split byte for byte."""

import copy
import re
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from helpers.clouds import TYPES, cloud, dump, point_bytes, table, to_ros, to_rosbags, values
from sensor_msgs.msg import PointCloud2, PointField

from lidar_outlier_filter.core.annotations import Rows
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.messages.cloud import first_numbers, split, structured

BOTH_KINDS = pytest.mark.parametrize('kind', [copy.deepcopy, to_rosbags], ids=['ros', 'rosbags'])


def odd_rows(shape: tuple[int, ...], order: str = '<', seed: int = 0) -> Rows:
    """Make points with mixed types, padding between and behind the fields, and random bytes."""
    rng = np.random.default_rng(seed)
    kinds = [order + 'u2', order + 'f4', ('u1', (3,)), order + 'f4', order + 'f4', order + 'u4']
    layout: Any = {
        'names': ['ring', 'x', 'rgb', 'z', 'y', 't'],
        'formats': kinds,
        'offsets': [1, 4, 9, 13, 20, 27],
        'itemsize': 35,
    }
    noise = bytearray(rng.bytes(35 * int(np.prod(shape))))
    rows: Rows = np.frombuffer(noise, np.dtype(layout)).reshape(shape)
    return rows


def random_verdict(count: int, rejected: float = 0.3, seed: int = 1) -> Verdict:
    """Make a verdict of that many points; some are untested."""
    rng = np.random.default_rng(seed)
    score = rng.uniform(0, 5, count).astype(np.float32)
    detectors = np.where(rng.uniform(size=count) < rejected, 1, 0).astype(np.uint16)
    score[(detectors == 0) & (rng.uniform(size=count) < 0.2)] = np.nan
    undecided = np.isnan(score).astype(np.uint16)
    reason = np.where(detectors, rng.integers(1, 256, count), 0).astype(np.uint8)
    return Verdict(score, detectors, undecided, detectors != 0, reason)


# Reading ----------------------------------------------------------------------------------------


@pytest.mark.parametrize('seed', range(40))
def test_any_layout(seed: int) -> None:
    """Fields of any type, at any offset, overlapping, with padding anywhere, are read in place."""
    rng = np.random.default_rng(seed)
    msg = PointCloud2(is_bigendian=bool(seed % 2))
    names = ['x', 'y', 'z', *(f'field {i}' for i in range(rng.integers(5)))]
    for name in rng.permutation(names):
        field = PointField(name=str(name), offset=int(rng.integers(40)))
        field.datatype, field.count = int(rng.choice(list(TYPES))), int(rng.integers(1, 4))
        if name in 'xyz':
            field.count = 1
        msg.fields.append(field)
    ends = [f.offset + f.count * struct.calcsize(TYPES[f.datatype][1]) for f in msg.fields]
    msg.point_step = max(ends) + int(rng.integers(3))
    msg.height, msg.width = int(rng.integers(1, 4)), int(rng.integers(1, 5))
    msg.row_step = msg.width * msg.point_step + int(rng.integers(3))
    msg.data.frombytes(rng.bytes(msg.height * msg.row_step + int(rng.integers(3))))
    given = to_rosbags(msg) if seed % 4 < 2 else msg
    view = structured(given)
    assert view.dtype.itemsize == msg.point_step
    assert np.shares_memory(view, np.frombuffer(given.data, np.uint8))
    for name in names:
        expected = np.array(values(msg, name))
        np.testing.assert_array_equal(view[name].reshape(expected.shape), expected, name)


def change(which: str, /, **attributes: object) -> Callable[[Any], None]:
    """Make a function that sets attributes of one field."""

    def apply(msg: Any) -> None:
        field = next(field for field in msg.fields if field.name == which)
        for attribute, value in attributes.items():
            setattr(field, attribute, value)

    return apply


def resize(**attributes: int) -> Callable[[Any], None]:
    """Make a function that sets sizes of the message."""

    def apply(msg: Any) -> None:
        for attribute, value in attributes.items():
            setattr(msg, attribute, value)

    return apply


REFUSALS = [
    (change('t', datatype=0), "the datatype of a field must be from 1 to 11, got 0 for 't'"),
    (change('t', datatype=12), "the datatype of a field must be from 1 to 11, got 12 for 't'"),
    (change('t', count=0), "the count of a field must be at least 1, got 0 for 't'"),
    (change('t', name='x'), "the names of the fields must be given and different, got 'x'"),
    (change('t', name=''), "the names of the fields must be given and different, got ''"),
    (change('t', name='t' * 10_000), 'the names of the fields must be at most 10000 characters'),
    (change('z', name='Z'), 'the fields must be with x, y and z, got x, y, Z, t'),
    (change('y', count=2), "field 'y' must be a single number, got 2"),
    (change('t', offset=13), "point_step must be at least 17, the end of field 't', got 16"),
    (change('t', count=2**31), f"at least {12 + 4 * 2**31}, the end of field 't', got 16"),
    (resize(point_step=0), "point_step must be at least 4, the end of field 'x', got 0"),
    (resize(row_step=63), 'row_step must be at least width × point_step = 64, got 63'),
    (resize(width=2**32 - 1), f'width × point_step = {16 * (2**32 - 1)}, got 64'),
    (resize(height=2**32 - 1), f'row_step × height = {64 * (2**32 - 1)} bytes, got 128'),
]


@BOTH_KINDS
@pytest.mark.parametrize(('spoil', 'sentence'), REFUSALS)
def test_refusals(kind: Callable[..., Any], spoil: Callable[[Any], None], sentence: str) -> None:
    """What contradicts itself is refused in one sentence."""
    msg = kind(cloud(table(8, t=('u4', 0)).reshape(2, 4)))
    structured(msg)
    spoil(msg)
    with pytest.raises(CloudError, match=re.escape(sentence)):
        structured(msg)


# Splitting --------------------------------------------------------------------------------------


@BOTH_KINDS
@pytest.mark.parametrize('order', ['<', '>'])
@pytest.mark.parametrize('shape', [(50,), (5, 10)])
@pytest.mark.parametrize('share', [0.0, 0.3, 1.0])
def test_split_is_a_partition(
    kind: Callable[..., Any], order: str, shape: tuple[int, ...], share: float
) -> None:
    """Every point is in one of the two clouds, in order, with every byte, padding too."""
    msg = kind(cloud(odd_rows(shape, order), row_padding=7))
    verdict = random_verdict(50, share)
    before = dump(msg)
    clouds = split(msg, verdict)
    assert dump(msg) == before
    points = point_bytes(msg)
    for result, chosen in zip(
        clouds, (verdict.detectors == 0, verdict.detectors != 0), strict=True
    ):
        expected = [point for point, is_in in zip(points, chosen, strict=True) if is_in]
        assert bytes(result.data) == b''.join(expected)
        assert type(result) is type(msg)
        assert type(result.data) is type(msg.data)
        assert (result.header, result.fields) == (msg.header, msg.fields)
        assert (result.height, result.width) == (1, len(expected))
        assert (result.point_step, result.row_step) == (35, 35 * len(expected))
        assert (result.is_bigendian, result.is_dense) == (msg.is_bigendian, msg.is_dense)
        assert bytes(as_sent(result).data) == bytes(result.data)


def as_sent(msg: Any) -> PointCloud2:
    """Send a message and receive it."""
    return to_ros(to_rosbags(msg) if isinstance(msg, PointCloud2) else msg)


@BOTH_KINDS
@pytest.mark.parametrize('shape', [(0,), (0, 5), (5, 0)])
@pytest.mark.parametrize('options', [{}, {'scores': True}, {'keep_organized': True}])
def test_split_of_nothing(
    kind: Callable[..., Any], shape: tuple[int, ...], options: dict[str, Any]
) -> None:
    """A cloud without points gives two such, in the layout that those with points have."""
    msg = kind(cloud(odd_rows(shape)))
    layout = split(kind(cloud(odd_rows((2,)))), random_verdict(2), **options)[0]
    for result in split(msg, Verdict.untested(0), **options):
        assert result.width * result.height == len(result.data) == result.row_step == 0
        assert (result.header, result.fields) == (msg.header, layout.fields)
        assert result.point_step == layout.point_step
        assert type(result.data) is type(msg.data)
        assert as_sent(result).width == result.width


def number_of(bits: int) -> int:
    """Count up to the lowest bit of a detector; the bit of the second phase is not one."""
    return next((n + 1 for n in range(15) if bits & 1 << n), 0)


def test_numbers_of_detectors() -> None:
    """Every sum of bits has the number of its lowest one."""
    bits = np.arange(1 << 16).astype(np.uint16)
    assert first_numbers(bits).tolist() == [number_of(one) for one in bits.tolist()]


@BOTH_KINDS
@pytest.mark.parametrize('order', ['<', '>'])
def test_scores(kind: Callable[..., Any], order: str) -> None:
    """Both clouds gain the score and the detectors behind each point, in its byte order."""
    msg = kind(cloud(odd_rows((5, 10), order), row_padding=7))
    verdict = random_verdict(50)
    before = dump(msg)
    clouds = split(msg, verdict, scores=True)
    assert dump(msg) == before
    rows = [
        point + struct.pack(order + 'fHBB', score, bits, number_of(bits), reason)
        for point, score, bits, reason in zip(
            point_bytes(msg), verdict.score, verdict.detectors, verdict.reason, strict=True
        )
    ]
    for result, chosen in zip(
        clouds, (verdict.detectors == 0, verdict.detectors != 0), strict=True
    ):
        expected = [row for row, is_in in zip(rows, chosen, strict=True) if is_in]
        assert bytes(result.data) == b''.join(expected)
        assert (result.point_step, result.row_step) == (43, 43 * len(expected))
        assert result.fields[:-4] == msg.fields
        added = [(f.name, f.offset, f.datatype, f.count) for f in result.fields[-4:]]
        assert added == [
            ('outlier_score', 35, 7, 1),
            ('outlier_detectors', 39, 4, 1),
            ('outlier_detector_number', 41, 2, 1),
            ('outlier_reason', 42, 2, 1),
        ]
        sent = structured(as_sent(result))['outlier_detectors']
        np.testing.assert_array_equal(sent, [verdict.detectors[chosen]])


@BOTH_KINDS
@pytest.mark.parametrize('row_padding', [0, 7])
@pytest.mark.parametrize('order', ['<', '>'])
def test_keep_organized(kind: Callable[..., Any], order: str, row_padding: int) -> None:
    """The cleaned cloud keeps its shape; x, y and z of the rejected, and nothing else, are NaN."""
    msg = kind(cloud(odd_rows((5, 10), order), row_padding=row_padding))
    msg.is_dense = True
    verdict = random_verdict(50)
    before = dump(msg)
    cleaned, outliers = split(msg, verdict, keep_organized=True)
    assert dump(msg) == before
    assert bytes(outliers.data) == bytes(split(msg, verdict)[1].data)
    assert (cleaned.height, cleaned.width) == (5, 10)
    assert (cleaned.point_step, cleaned.row_step) == (35, 350)
    assert not cleaned.is_dense
    nan = struct.pack(order + 'f', np.nan)
    for point, source, bits in zip(
        point_bytes(cleaned), point_bytes(msg), verdict.detectors, strict=True
    ):
        expected = bytearray(source)
        for offset in (4, 13, 20) if bits else ():
            expected[offset : offset + 4] = nan
        assert point == expected


def test_keep_organized_of_one_row_or_without_rejected() -> None:
    """A single row has no shape to keep; where nothing is rejected, a dense cloud is as it was."""
    row, verdict = cloud(odd_rows((50,))), random_verdict(50)
    assert split(row, verdict, keep_organized=True) == split(row, verdict)
    msg = cloud(odd_rows((5, 10)))
    msg.is_dense = True
    cleaned, outliers = split(msg, random_verdict(50, 0.0), keep_organized=True)
    assert dump(cleaned) == dump(msg)
    assert outliers.width == 0
