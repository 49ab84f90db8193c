# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Structured arrays go the way of a PointCloud2, and come back as arrays, byte for byte."""

from __future__ import annotations

import re
from collections import Counter
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from helpers.clouds import SECOND, STAMP, cloud, cut, drive

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.messages.array_cloud import as_given, as_message
from lidar_outlier_filter.messages.cloud import structured
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.library import CloudFilter
from lidar_outlier_filter.pipeline.pipeline import Pipeline

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lidar_outlier_filter.annotations import Rows
    from lidar_outlier_filter.pipeline.pipeline import SplitCloud

SHORT: dict[str, object] = {'block': 0.01, 'halo': 0.002, 'chain': ['alpha_beta_gamma']}
# All that a dtype of numpy may hold: padding, subarrays, texts, times, nested fields, half floats.
ODD: list[Any] = [
    ('note', 'S3'),
    ('x', 'f8'),
    ('flags', 'u1', (2, 2)),
    ('y', 'f4'),
    ('when', '<M8[ns]'),
    ('good', '?'),
    ('pair', [('a', 'i2'), ('b', 'f4')]),
    ('z', 'f4'),
    ('half', 'f2'),
    ('ring', 'u1'),
    ('none', 'f4', (0,)),
    ('time', 'f4'),
]


def odd_rows(count: int, *, order: Any = '<', seed: int = 0) -> Rows:
    """Make a wavy floor with a few points above it, of the odd dtype, with noise all between."""
    kind = np.dtype(ODD, align=True).newbyteorder(order)
    rng = np.random.default_rng(seed)
    rows = np.frombuffer(bytearray(rng.bytes(count * kind.itemsize)), kind)
    rows['good'] = False
    rows['x'], rows['y'] = rng.uniform(-5, 5, (2, count))
    rows['z'] = rng.normal(-2, 0.02, count)
    rows['ring'], rows['time'] = np.arange(count) % 4, np.arange(count) * 1e-5
    rows['z'][:: max(count // 7, 1)] += 3
    return rows


def lists(rows: Rows) -> list[bytes]:
    """Return the bytes of each point, padding too."""
    plain = np.ascontiguousarray(rows.view(np.dtype((np.void, rows.dtype.itemsize))))
    return [point.tobytes() for point in plain.reshape(-1)]


def run(clouds: Iterable[Any], parameters: dict[str, object]) -> list[SplitCloud]:
    """Filter a recording."""
    clean = CloudFilter(parameters)
    answers = [answer for given in clouds for answer in clean.push(given)]
    return answers + clean.flush()


def assert_partition(rows: Rows, answer: SplitCloud) -> None:
    """Every point is in one of the two, with all its bytes, in order, and both have the dtype."""
    points, parts = lists(rows), [lists(answer.cleaned), lists(answer.outliers)]
    assert answer.cleaned.dtype == answer.outliers.dtype == rows.dtype
    assert Counter(parts[0]) + Counter(parts[1]) == Counter(points)
    for part in parts:
        rest = iter(points)
        assert all(point in rest for point in part)


@pytest.mark.parametrize('order', ['<', '>'])
@pytest.mark.parametrize('count', [0, 1, 700])
def test_partition(count: int, order: str) -> None:
    """Nothing is lost and no byte changes, whatever the dtype holds."""
    rows = odd_rows(count, order=order)
    before = rows.tobytes()
    clean = CloudFilter(chain=['lof'])
    (answer,) = clean.push(rows, 'mine', stamp=STAMP) + clean.flush()
    assert_partition(rows, answer)
    assert answer.tag == 'mine'
    assert answer.cleaned.ndim == 1
    assert rows.tobytes() == before
    assert (answer.outliers.size > 0) == (count == 700)
    assert clean.statistics.points == count
    # What comes out belongs to the caller.
    answer.cleaned['z'] = 0
    assert rows.tobytes() == before


@pytest.mark.parametrize(
    'part',
    [np.s_[::-1], np.s_[3::2], np.s_[5:400]],
    ids=['backwards', 'every other', 'some'],
)
def test_parts_of_arrays(part: slice) -> None:
    """An array whose points do not lie together in memory is one like any other."""
    rows = odd_rows(600)[part]
    clean = CloudFilter(chain=['lof'])
    (answer,) = clean.push(rows, stamp=STAMP) + clean.flush()
    copied = CloudFilter(chain=['lof'])
    (expected,) = copied.push(rows.copy(), stamp=STAMP) + copied.flush()
    assert_partition(rows, answer)
    np.testing.assert_array_equal(answer.outliers['x'], expected.outliers['x'])
    assert answer.outliers.size > 0


def test_recarray() -> None:
    """A recarray is an array."""
    rows = odd_rows(300).view(np.recarray)
    clean = CloudFilter(chain=['lof'])
    (answer,) = clean.push(rows, stamp=STAMP) + clean.flush()
    assert lists(answer.cleaned) + lists(answer.outliers)
    assert answer.cleaned.size + answer.outliers.size == 300


@pytest.mark.parametrize('chain', ['alpha_beta_gamma', 'boosted_trees', 'lof'])
def test_arrays_are_judged_as_messages(chain: str) -> None:
    """Absolute times need no stamp, and the answer is that to the message with these points."""
    parts = cut(drive(5), 5, 12)
    parameters = {**SHORT, 'chain': [chain]}
    arrays = run(parts, parameters)
    messages = run((cloud(part) for part in parts), parameters)
    assert len(arrays) == len(messages) == 13
    for part, array, message in zip(parts, arrays, messages, strict=True):
        assert_partition(part, array)
        assert b''.join(lists(array.outliers)) == bytes(message.outliers.data)
        assert b''.join(lists(array.cleaned)) == bytes(message.cleaned.data)
    assert sum(answer.outliers.size for answer in arrays) > 5


def test_relative_times() -> None:
    """Times count from the stamp; where they do and there is none, the cloud is refused."""
    rows = drive(6)[['x', 'y', 'z', 'ring', 'tick']]
    clean = CloudFilter({**SHORT, 'time_field': 'tick'})
    sentence = 'the stamp must be given, in nanoseconds, for an array whose times count from it'
    with pytest.raises(CloudError, match=f'^{sentence}, got none$'):
        clean.push(rows)
    assert clean.statistics.refusals == {'the stamp': 1}
    answers = clean.push(rows, stamp=STAMP) + clean.push(rows, stamp=np.int64(STAMP + SECOND))
    answers += clean.flush()
    expected = CloudFilter({**SHORT, 'time_field': 'tick'})
    messages = expected.push(cloud(rows)) + expected.push(cloud(rows, STAMP + SECOND))
    messages += expected.flush()
    for answer, message in zip(answers, messages, strict=True):
        assert b''.join(lists(answer.outliers)) == bytes(message.outliers.data)
        assert answer.outliers.size > 0


def test_no_times() -> None:
    """An array without times has those of its order, from its stamp."""
    rows = odd_rows(500)[['x', 'y', 'z']]
    clean = CloudFilter(chain=['lof'])
    with pytest.raises(CloudError, match='the stamp must be given'):
        clean.push(rows)
    for stamp in (STAMP, STAMP + SECOND):
        assert len(clean.push(rows, stamp=stamp)) == (stamp > STAMP)
    assert clean.flush()[0].outliers.size > 0


def test_organised() -> None:
    """An array of rows and columns keeps its shape where it is to, and scores are added."""
    rows = odd_rows(800).reshape(4, 200)
    clean = CloudFilter({'chain': ['lof'], 'keep_organized': True, 'scores': True})
    (answer,) = clean.push(rows, stamp=STAMP) + clean.flush()
    assert answer.cleaned.shape == (4, 200)
    holes = np.isnan(answer.cleaned['x'])
    assert np.count_nonzero(holes) == answer.outliers.size > 0
    added = (
        'outlier_score',
        'outlier_detectors',
        'outlier_detector_number',
        'outlier_reason',
    )
    assert answer.cleaned.dtype.names == (*(rows.dtype.names or ()), *added)
    assert (answer.outliers['outlier_score'] > 1).all()
    assert set(answer.outliers['outlier_detectors'].tolist()) == {4}
    assert set(answer.outliers['outlier_detector_number'].tolist()) == {3}
    for name in ('note', 'flags', 'when', 'half', 'ring'):
        np.testing.assert_array_equal(answer.cleaned[name], rows[name])
    np.testing.assert_array_equal(answer.outliers['x'], rows['x'][holes])


def test_scores_of_big_endian_arrays() -> None:
    """The scores have the byte order of the other fields."""
    answers = []
    for order in '<>':
        clean = CloudFilter({'chain': ['lof'], 'scores': True})
        answers += clean.push(odd_rows(700, order=order), stamp=STAMP) + clean.flush()
    little, big = (answer.outliers for answer in answers)
    for name in ('outlier_score', 'outlier_detectors'):
        np.testing.assert_array_equal(little[name], big[name])
        assert big.dtype[name].byteorder == '>'
    assert little.size > 0


def test_pass_by() -> None:
    """An array that is not to be filtered comes back whole."""
    rows = odd_rows(50)
    clean = Pipeline(FilterParameters().changed({'chain': ['lof']}))
    (answer,) = clean.pass_through(rows, 'too much') + clean.flush()
    assert_partition(rows, answer)
    assert answer.outliers.size == 0


def test_view_and_back() -> None:
    """The view of the fields has the values of the array, without a copy; messages are left."""
    rows = odd_rows(40).reshape(4, 10)
    msg = as_message(rows, 5)
    assert np.shares_memory(msg.data, rows)
    assert (msg.header.stamp.sec, msg.header.stamp.nanosec) == (0, 5)
    view = structured(msg)
    for name in ('x', 'y', 'z', 'ring', 'time'):
        np.testing.assert_array_equal(view[name], rows[name])
    np.testing.assert_array_equal(view['flags'], rows['flags'].reshape(4, 10, 4))
    for name in ('note', 'when', 'pair', 'half', 'none'):
        assert name not in (view.dtype.names or ())
    assert lists(as_given(msg)) == lists(rows)
    assert as_given(msg).shape == (4, 10)
    message = cloud(drive(1))
    assert as_given(as_message(message)) is message


AXES: list[Any] = [('x', 'f4'), ('y', 'f4'), ('z', 'f4')]
REFUSALS: list[tuple[Any, str]] = [
    (
        np.zeros((5, 3)),
        'a cloud must be a structured array with the fields x, y and z, or a PointC',
    ),
    (np.zeros((5, 3)), ', got an array of float64, (5, 3)'),
    ([1, 2, 3], ', or a PointCloud2, got list'),
    (SimpleNamespace(header=None, data=b''), ', or a PointCloud2, got SimpleNamespace'),
    (np.zeros(5, AXES[:2]), 'the fields must be with x, y and z, got x, y'),
    (np.zeros(5, []), 'the fields must be with x, y and z, got none'),
    (np.zeros((2, 2, 2), AXES), 'the shape of a cloud must be (N,) or (height, width), got (2, 2,'),
    (np.zeros((), AXES), 'the shape of a cloud must be (N,) or (height, width), got ()'),
    (np.zeros(5, [*AXES, ('a', 'O')]), 'the fields must be without Python objects, got '),
    (np.zeros(5, [*AXES[:2], ('z', 'f2')]), "field 'z' must be a single number of at most 64 bits"),
    (
        np.zeros(5, [*AXES[:2], ('z', 'f4', (2,))]),
        "field 'z' must be a single number of at most 64",
    ),
    (np.zeros(5, [*AXES[:2], ('z', '>f4')]), 'the byte order of the fields must be the same for'),
    (np.ma.MaskedArray(np.zeros(5, AXES)), 'a cloud must be without a mask, got a masked array'),
]


@pytest.mark.parametrize(('wrong', 'sentence'), REFUSALS, ids=[text for _, text in REFUSALS])
def test_refusals(wrong: Any, sentence: str) -> None:
    """What is no cloud is refused in one sentence, counted, and changes nothing."""
    clean = CloudFilter(chain=['lof'])
    with pytest.raises(CloudError, match=re.escape(sentence)):
        clean.push(wrong)
    assert clean.statistics.refused == 1
    assert clean.push(odd_rows(20), stamp=STAMP) == []
    assert len(clean.flush()) == 1


@pytest.mark.parametrize('stamp', [1.5, '1', None])
def test_refused_stamps(stamp: Any) -> None:
    """The stamp is a whole number; a message has its own."""
    clean = CloudFilter(chain=['lof'])
    if stamp is None:
        with pytest.raises(CloudError, match='the stamp must be that of the message'):
            clean.push(cloud(drive(1)), stamp=STAMP)
    else:
        with pytest.raises(CloudError, match='the stamp must be a whole number of nanoseconds'):
            clean.push(odd_rows(20), stamp=stamp)


def test_refused_arrays_leave_the_lines() -> None:
    """A cloud that is none takes nothing back from the one before."""
    rows = drive(2)
    parameters = {**SHORT, 'line_source': 'angle', 'angle_plane': 'xy'}
    expected = run(np.array_split(rows, 5), parameters)
    clean = CloudFilter(parameters)
    answers = []
    for part in np.array_split(rows, 5):
        answers += clean.push(part)
        with pytest.raises(CloudError):
            clean.push(np.zeros(3))
    answers += clean.flush()
    for one, other in zip(answers, expected, strict=True):
        assert lists(one.outliers) == lists(other.outliers)
