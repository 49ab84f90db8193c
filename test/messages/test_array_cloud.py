# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Structured arrays go the way of a PointCloud2, and come back as arrays, byte for byte."""

from collections import Counter
from collections.abc import Iterable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.clouds import SECOND, STAMP, cloud, cut, drive

from lidar_outlier_filter.core.annotations import Rows
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.messages.cloud import SCORE_FIELDS
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.library import CloudFilter
from lidar_outlier_filter.pipeline.pipeline import Pipeline, SplitCloud

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
    results = [result for given in clouds for result in clean.push(given)]
    return results + clean.flush()


def assert_partition(rows: Rows, result: SplitCloud) -> None:
    """Every point is in one of the two, with all its bytes, in order, and both have the dtype."""
    points, parts = lists(rows), [lists(result.cleaned), lists(result.outliers)]
    assert result.cleaned.dtype == result.outliers.dtype == rows.dtype
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
    (result,) = clean.push(rows, 'mine', stamp=STAMP) + clean.flush()
    assert_partition(rows, result)
    assert result.tag == 'mine'
    assert result.cleaned.ndim == 1
    assert rows.tobytes() == before
    assert (result.outliers.size > 0) == (count == 700)
    assert clean.statistics.points == count
    # What comes out belongs to the caller.
    result.cleaned['z'] = 0
    assert rows.tobytes() == before


@pytest.mark.parametrize('part', [np.s_[::-1], np.s_[3::2], np.s_[5:400]])
def test_parts_of_arrays(part: slice) -> None:
    """An array whose points do not lie together in memory is one like any other."""
    rows = odd_rows(600).view(np.recarray)[part]
    clean = CloudFilter(chain=['lof'])
    (result,) = clean.push(rows, stamp=STAMP) + clean.flush()
    copied = CloudFilter(chain=['lof'])
    (expected,) = copied.push(rows.copy(), stamp=STAMP) + copied.flush()
    assert_partition(rows, result)
    np.testing.assert_array_equal(result.outliers['x'], expected.outliers['x'])
    assert result.outliers.size > 0


@pytest.mark.parametrize('chain', ['alpha_beta_gamma', 'boosted_trees', 'lof'])
def test_arrays_are_judged_as_messages(chain: str) -> None:
    """Absolute times need no stamp, and the result is that of the message with these points."""
    parts = cut(drive(5), 5, 12)
    parameters = {**SHORT, 'chain': [chain]}
    arrays = run(parts, parameters)
    messages = run((cloud(part) for part in parts), parameters)
    assert len(arrays) == len(messages) == 13
    for part, array, message in zip(parts, arrays, messages, strict=True):
        assert_partition(part, array)
        assert b''.join(lists(array.outliers)) == bytes(message.outliers.data)
        assert b''.join(lists(array.cleaned)) == bytes(message.cleaned.data)
    assert sum(result.outliers.size for result in arrays) > 5


def test_relative_times() -> None:
    """Times count from the stamp; without a stamp the cloud is refused."""
    rows = drive(6)[['x', 'y', 'z', 'ring', 'tick']]
    clean = CloudFilter({**SHORT, 'time_field': 'tick'})
    sentence = 'the stamp must be given, in nanoseconds, for an array whose times count from it'
    with pytest.raises(CloudError, match=f'^{sentence}, got none$'):
        clean.push(rows)
    assert clean.statistics.refusals == {'the stamp': 1}
    results = clean.push(rows, stamp=STAMP) + clean.push(rows, stamp=np.int64(STAMP + SECOND))
    results += clean.flush()
    expected = CloudFilter({**SHORT, 'time_field': 'tick'})
    messages = expected.push(cloud(rows)) + expected.push(cloud(rows, STAMP + SECOND))
    messages += expected.flush()
    for result, message in zip(results, messages, strict=True):
        assert b''.join(lists(result.outliers)) == bytes(message.outliers.data)
        assert result.outliers.size > 0


@pytest.mark.parametrize('order', ['<', '>'])
def test_organised_with_scores(order: str) -> None:
    """An array of rows and columns keeps its shape; scores are added in its byte order."""
    rows = odd_rows(800, order=order).reshape(4, 200)
    clean = CloudFilter({'chain': ['lof'], 'keep_organized': True, 'scores': True})
    (result,) = clean.push(rows, stamp=STAMP) + clean.flush()
    assert result.cleaned.shape == (4, 200)
    holes = np.isnan(result.cleaned['x'])
    assert np.count_nonzero(holes) == result.outliers.size > 0
    assert result.cleaned.dtype.names == (*(rows.dtype.names or ()), *SCORE_FIELDS)
    assert result.cleaned.dtype['outlier_score'].str == f'{order}f4'
    assert (result.outliers['outlier_score'] > 1).all()
    assert set(result.outliers['outlier_detectors'].tolist()) == {4}
    assert set(result.outliers['outlier_detector_number'].tolist()) == {3}
    for name in ('note', 'flags', 'when', 'half', 'ring'):
        np.testing.assert_array_equal(result.cleaned[name], rows[name])
    np.testing.assert_array_equal(result.outliers['x'], rows['x'][holes])


def test_pass_by() -> None:
    """An array that is not to be filtered comes back whole."""
    rows = odd_rows(50)
    clean = Pipeline(FilterParameters().changed({'chain': ['lof']}))
    (result,) = clean.process(rows, bypassed='too much') + clean.flush()
    assert_partition(rows, result)
    assert result.outliers.size == 0


AXES: list[Any] = [('x', 'f4'), ('y', 'f4'), ('z', 'f4')]
REFUSALS: list[tuple[Any, float | None, str]] = [
    (np.zeros((5, 3)), None, 'a cloud must be a structured array .* got an array of float64'),
    ([1, 2, 3], None, 'a PointCloud2 or a LaserScan, got list'),
    (
        SimpleNamespace(header=None, data=b''),
        None,
        'a PointCloud2 or a LaserScan, got SimpleNamespace',
    ),
    (np.zeros(5, AXES[:2]), None, 'the fields must be with x, y and z, got x, y'),
    (np.zeros(5, []), None, 'a cloud must be a structured array'),
    (np.zeros((2, 2, 2), AXES), None, 'the shape of a cloud must be'),
    (np.zeros((), AXES), None, 'the shape of a cloud must be'),
    (np.zeros(5, [*AXES, ('a', 'O')]), None, 'the fields must be without Python objects'),
    (np.zeros(5, [*AXES[:2], ('z', 'f2')]), None, 'the fields must be with x, y and z, got x, y'),
    (np.zeros(5, [*AXES[:2], ('z', 'f4', (2,))]), None, "field 'z' must be a single number"),
    (np.zeros(5, [*AXES[:2], ('z', '>f4')]), None, 'the byte order of the fields must be the same'),
    (np.ma.MaskedArray(np.zeros(5, AXES)), None, 'a cloud must be without a mask'),
    (np.ones(5, AXES), None, 'the stamp must be given, in nanoseconds'),
    (odd_rows(20), 1.5, 'the stamp must be a whole number of nanoseconds'),
    (cloud(drive(1)), STAMP, 'the stamp must be that of the message'),
]


@pytest.mark.parametrize(('wrong', 'stamp', 'sentence'), REFUSALS)
def test_refusals(wrong: Any, stamp: Any, sentence: str) -> None:
    """An invalid cloud or stamp is refused and counted, and the next cloud is accepted."""
    clean = CloudFilter(chain=['lof'])
    with pytest.raises(CloudError, match=sentence):
        clean.push(wrong, stamp=stamp)
    assert clean.statistics.refused == 1
    assert clean.push(odd_rows(20), stamp=STAMP) == []
    assert len(clean.flush()) == 1
