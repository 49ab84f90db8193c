# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The library: numpy in, numpy out, and the same verdict as on every other way."""

import re
from typing import Any

import numpy as np
import pytest
from helpers.clouds import SECOND, STAMP, cloud, drive, to_rosbags
from numpy.typing import NDArray

from lidar_outlier_filter import (
    CloudError,
    CloudFilter,
    FilterError,
    ParameterError,
    Verdict,
    detect_outliers,
)
from lidar_outlier_filter.core.annotations import Floats, Rows
from lidar_outlier_filter.core.detectors.plugins import BUILTIN
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.parameters.filter import FilterParameters

# Recorded clouds carry them: they never change.
NAMES = 'alpha_beta_gamma quadric lof sor hierarchical elevation boosted_trees scan_shadows'
NAMES += ' ring_outlier dual_return crop_box mixed_pixels field_range'
BITS = {name: 1 << number for number, name in enumerate(NAMES.split())}
# The default rejects next to nothing of a clean recording.
STRICT, LESS_STRICT = {'boosted_trees.threshold': 0.5}, {'boosted_trees.threshold': 0.85}
WITHOUT_LINES = ('quadric', 'lof', 'sor', 'hierarchical', 'elevation')
COLUMNS = ('score', 'detectors', 'undecided', 'outlier')


def floor(count: int = 1500, seed: int = 1) -> Floats:
    """Make a rough floor with a point in fifty above it, and a few missing returns."""
    rng = np.random.default_rng(seed)
    xyz = np.column_stack([rng.uniform(-10, 10, (count, 2)), rng.normal(-2, 0.02, count)])
    xyz[::50, 2] += rng.uniform(1, 5, len(xyz[::50]))
    xyz[7::400] = np.nan
    xyz[8::400] = 0
    xyz[9::400, 1] = np.inf
    return xyz


def assert_same(one: Verdict, other: Verdict) -> None:
    """Two verdicts agree bit by bit."""
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), name)


def drive_of(rows: Rows) -> tuple[Floats, NDArray[np.int64], NDArray[np.uint16]]:
    """Take positions, times in nanoseconds and rings of a drive."""
    xyz = np.column_stack([rows[axis].astype(float) for axis in 'xyz'])
    return xyz, rows['tick'].astype(np.int64), rows['ring']


# What comes out ---------------------------------------------------------------------------------


def test_bits() -> None:
    """Those of all detectors are as they were when clouds were recorded with them."""
    assert {name: one.bit for name, one in BUILTIN.items()} == BITS


@pytest.mark.parametrize('name', WITHOUT_LINES)
def test_verdict(name: str) -> None:
    """Columns have their types, outliers are those with a larger score than 1, with its bit."""
    xyz = floor()
    before = xyz.copy()
    verdict = detect_outliers(xyz, chain=[name])
    assert isinstance(verdict, Verdict)
    dtypes = [getattr(verdict, column).dtype.name for column in COLUMNS]
    assert dtypes == ['float32', 'uint16', 'uint16', 'bool']
    assert verdict.score.shape == verdict.outlier.shape == (len(xyz),)
    np.testing.assert_array_equal(verdict.outlier, verdict.score > 1)
    assert (verdict.detectors[verdict.outlier] & BITS[name]).all()
    assert not verdict.detectors[~verdict.outlier].any()
    assert np.count_nonzero(verdict.outlier[::50]) > 0.8 * len(xyz[::50])
    np.testing.assert_array_equal(xyz, before)


def test_missing_returns() -> None:
    """NaN, Inf and 0 0 0 are kept, untested, and change no other verdict."""
    xyz = floor()
    no_return = ~np.isfinite(xyz).all(axis=1) | (xyz == 0).all(axis=1)
    verdict = detect_outliers(xyz)
    assert np.count_nonzero(no_return) == 12
    assert np.isnan(verdict.score[no_return]).all()
    assert not verdict.outlier[no_return].any()
    assert not verdict.undecided[no_return].any()
    assert_same(verdict.take(~no_return), detect_outliers(xyz[~no_return]))


@pytest.mark.parametrize('kind', ['f4', '>f4', 'f8', '>f8', 'f2', 'i2', 'i8', 'u4'])
@pytest.mark.parametrize('order', ['C', 'F'])
def test_types_of_numbers(kind: str, order: Any) -> None:
    """Numbers of any type and layout are judged by their values."""
    xyz = np.rint(10 * np.nan_to_num(floor(), posinf=3.0)) + 200
    expected = detect_outliers(xyz, chain=['sor'])
    assert expected.outlier.any()
    given = np.asarray(xyz.astype(kind), order=order)
    assert_same(detect_outliers(given, chain=['sor']), expected)
    backwards = detect_outliers(xyz.astype(kind)[::-1], chain=['sor'])
    assert_same(backwards.take(np.s_[::-1]), expected)
    assert_same(detect_outliers(given), detect_outliers(xyz))


# Times and lines --------------------------------------------------------------------------------


@pytest.mark.parametrize('chain', [None, ['alpha_beta_gamma'], ['boosted_trees', 'lof']])
def test_as_the_filter(chain: list[str] | None) -> None:
    """A recording in one block has the verdict of the filter, bit by bit; however it is given."""
    rows = drive(3)
    rows['timestamp'] = 0
    xyz, t, ring = drive_of(rows)
    parameters: dict[str, object] = {'block': 60.0, 'max_delay': 61.0, 'time_field': 'tick'}
    parameters |= {'scores': True, 'time_reference': 'stamp', **LESS_STRICT}
    stream = CloudFilter(parameters, chain=chain)
    results = [one for part in np.array_split(rows, 7) for one in stream.push(part, stamp=0)]
    results += stream.flush()
    found = np.concatenate([result.outliers for result in results])
    verdict = detect_outliers(xyz, t=t, line=ring, chain=chain, parameters=LESS_STRICT)
    assert 20 < np.count_nonzero(verdict.outlier) < 0.1 * len(rows)
    assert found['tick'].tolist() == rows['tick'][verdict.outlier].tolist()
    np.testing.assert_array_equal(found['outlier_score'], verdict.score[verdict.outlier])
    np.testing.assert_array_equal(found['outlier_detectors'], verdict.detectors[verdict.outlier])
    fields = {'time_field': 'tick', **LESS_STRICT}
    for given in (rows, cloud(rows), to_rosbags(cloud(rows))):
        assert_same(detect_outliers(given, chain=chain, parameters=fields), verdict)


def test_default_chains() -> None:
    """The default has scan lines only with times and lines, for arrays of either kind."""
    rows = drive(4)
    xyz, t, ring = drive_of(rows)
    unlined = detect_outliers(xyz, parameters={'boosted_trees.sensor': 'survey'})
    usual = detect_outliers(xyz, t=t, line=ring, chain=['boosted_trees'])
    assert set(usual.detectors.tolist()) == {0, BITS['boosted_trees']}
    assert_same(detect_outliers(xyz), unlined)
    assert_same(detect_outliers(xyz, t=t), unlined)
    assert_same(detect_outliers(xyz, line=ring), unlined)
    assert_same(detect_outliers(xyz, t=t, line=ring), usual)
    assert_same(detect_outliers(rows[['x', 'y', 'z']]), unlined)
    assert_same(detect_outliers(rows[['x', 'y', 'z', 'ring']]), unlined)
    assert_same(detect_outliers(rows[['x', 'y', 'z', 'timestamp']]), unlined)
    both = rows[['x', 'y', 'z', 'ring', 'timestamp']]
    assert set(detect_outliers(both).detectors.tolist()) == {0, BITS['boosted_trees']}
    by_message = {'line_source': 'message'}
    single = detect_outliers(rows[['x', 'y', 'z', 'timestamp']], parameters=by_message)
    assert set(single.detectors.tolist()) <= {0, BITS['boosted_trees']}
    assert not detect_outliers(rows[:0]).outlier.any()


def test_rows_are_lines() -> None:
    """The rows of an organised cloud are its lines, where it has times; the verdict is flat."""
    rows = drive(8)[:2000]
    table = np.zeros((4, 500), [('x', 'f4'), ('y', 'f4'), ('z', 'f4'), ('t', 'u4')])
    for name, field in zip(('x', 'y', 'z', 'tick'), 'xyzt', strict=True):
        table[field] = rows[name].reshape(4, 500)
    xyz, t, _ = drive_of(rows)
    expected = detect_outliers(xyz, t=t, line=np.repeat(np.arange(4), 500))
    verdict = detect_outliers(table)
    assert verdict.outlier.any()
    assert_same(verdict, expected)


def test_units_of_time() -> None:
    """Floats are seconds, integers nanoseconds, of whatever size."""
    rows = drive(5)
    xyz, t, ring = drive_of(rows)
    expected = detect_outliers(xyz, t=t, line=ring)
    for given in (t.astype('u4'), t + STAMP, t / SECOND, (t / SECOND).tolist(), -t.max() + t):
        assert_same(detect_outliers(xyz, t=given, line=ring), expected)
    for given in (ring.astype('i1'), ring.astype('>i8'), ring.tolist()):
        assert_same(detect_outliers(xyz, t=t, line=given), expected)
    other = detect_outliers(xyz, t=t[::-1] // 50 * 50, line=ring, chain=['alpha_beta_gamma'])
    alone = detect_outliers(xyz, t=t, line=ring, chain=['alpha_beta_gamma'])
    assert not np.array_equal(other.score, alone.score, equal_nan=True)
    # What a missing return has for a time does not matter.
    hole = ~np.isfinite(xyz).all(axis=1)
    seconds = t / SECOND
    seconds[hole] = np.nan
    assert hole.any()
    assert_same(detect_outliers(xyz, t=seconds, line=ring), expected)


# Chains and parameters --------------------------------------------------------------------------


def test_chain_and_parameters() -> None:
    """The chain may be among the parameters; these may be numpy's numbers, or a whole set."""
    xyz = floor()
    expected = detect_outliers(xyz, chain=['lof'], parameters={'lof.threshold': 1.5})
    assert expected.outlier.sum() < detect_outliers(xyz, chain=['lof']).outlier.sum()
    for threshold in (np.float64(1.5), np.float32(1.5)):
        values = {'lof.threshold': threshold, 'lof.min_pts': np.int64(20), 'chain': ('lof',)}
        assert_same(detect_outliers(xyz, parameters=values), expected)
    whole = FilterParameters().changed({'lof.threshold': 1.5, 'chain': ['lof']})
    assert_same(detect_outliers(xyz, parameters=whole), expected)
    other = detect_outliers(xyz, parameters=whole, chain=['sor'])
    assert_same(other, detect_outliers(xyz, chain=['sor']))
    assert_same(detect_outliers(xyz, parameters=whole, chain='sor'), other)
    assert CloudFilter(whole).parameters == whole
    assert CloudFilter({'lof.threshold': 1.5}, chain=['lof']).parameters == whole
    assert CloudFilter().parameters == FilterParameters()


# What is refused --------------------------------------------------------------------------------

XYZ = floor(100)
T, LINE = np.arange(100), np.zeros(100, int)
TABLE = np.ones(9, [('x', 'f4'), ('y', 'f4'), ('z', 'f4'), ('t', 'u4')])
MASKED = np.ma.MaskedArray(XYZ)
LACKS = 'chain must be without alpha_beta_gamma, as the cloud has no '
BY_LINES: dict[str, Any] = {'chain': ['alpha_beta_gamma', 'lof']}
TWICE: dict[str, Any] = {'chain': ['lof'], 'parameters': {'chain': ['lof']}}
BARE = TABLE[['x', 'y', 'z']]
REFUSALS: list[tuple[type[FilterError], Any, dict[str, Any], str]] = [
    (CloudError, XYZ.T, {}, 'the shape of xyz must be (N, 3), got (3, 100)'),
    (CloudError, [], {}, 'the shape of xyz must be (N, 3), got (0,)'),
    (CloudError, XYZ > 0, {}, 'xyz must be an array of numbers, got bool'),
    (CloudError, None, {}, 'xyz must be an array of numbers, got object'),
    (CloudError, [[1, 2, 3], [1]], {}, 'xyz must be an array of numbers, got rows of different'),
    (CloudError, MASKED, {}, 'xyz must be an array of numbers without a mask, got a masked'),
    (CloudError, XYZ, {'t': T[1:]}, 'the shape of t must be (100,), as xyz has 100 points, got'),
    (CloudError, XYZ, {'line': 3}, 'the shape of line must be (100,), as xyz has 100 points, got'),
    (CloudError, XYZ, {'line': LINE + 0.5}, 'line must be of whole numbers, got others'),
    (CloudError, XYZ, {'t': T * np.nan}, 'the time of a point must be finite and within 73 years'),
    (CloudError, TABLE, {'t': T[:9]}, 't must be a field of the cloud, got a separate ar'),
    (CloudError, TABLE[['x', 'y']], {}, 'the fields must be with x, y and z, got x, y'),
    (CloudError, XYZ, {'parameters': {'max_points': 9}}, 'the number of points judged in one pie'),
    (FilterError, XYZ * 1e200, {}, 'coordinates must be finite and at most 1e+150 m'),
    (ParameterError, XYZ, {'chain': ['loff']}, "got ['loff'] (did you mean 'lof'?)"),
    (ParameterError, XYZ, TWICE, 'chain must be given once'),
    (ParameterError, XYZ, {'parameters': ['lof']}, 'the parameters must be a mapping as in'),
    (ParameterError, XYZ, {'parameters': {'time_field': 'tick'}}, 'time_field must be unset for'),
    (ParameterError, XYZ, BY_LINES, LACKS + 'time of each point'),
    (ParameterError, XYZ, BY_LINES | {'t': T}, LACKS + 'scan line of each point'),
    (ParameterError, TABLE, BY_LINES, LACKS + 'scan line of each point'),
    (ParameterError, BARE, BY_LINES, LACKS + 'time of each point'),
]


@pytest.mark.parametrize(('error', 'xyz', 'others', 'sentence'), REFUSALS)
def test_refusals(
    error: type[FilterError], xyz: Any, others: dict[str, Any], sentence: str
) -> None:
    """What makes no sense is refused in one sentence: what, must be, got."""
    with pytest.raises(error, match=re.escape(sentence)) as refusal:
        detect_outliers(xyz, **others)
    assert type(refusal.value) is error


def test_names_of_fields_in_a_log() -> None:
    """A line break or an escape sequence in the name of a field reaches no log."""
    said: list[str] = []
    message = to_rosbags(cloud(drive(3)))
    for field in message.fields:
        if field.name not in {'x', 'y', 'z', 't', 'time'}:
            field.name = f'{field.name}\n\x1b[31m[FATAL] all is lost'
    stream = CloudFilter(chain=['sor'], inform=said.append, warn=said.append)
    stream.push(message)
    assert any('[FATAL]' in text for text in said)
    assert all(text.isprintable() for text in said)


def test_the_method_is_named_as_in_a_stream() -> None:
    """An array has no counts, so a sentence says how the default judged: a warning, if need be."""
    said, warned = list[str](), list[str]()
    detect_outliers(floor(), inform=said.append, warn=warned.append)
    assert said == ['judged by trees on the neighbours of each point']
    detect_outliers(floor(), chain='sor', inform=said.append, warn=warned.append)
    assert len(said) == 1
    assert not warned
    chain = Chain(FilterParameters())
    chain.methods['one, because another failed'] += 1
    chain.say_methods(said.append, warned.append)
    assert warned == ['judged by one, because another failed']


def test_much_is_rejected() -> None:
    """More than the default ever rejects of clean data is said, of arrays as of files."""
    rng = np.random.default_rng(2)
    xyz = rng.uniform(0, 20, (20_000, 3)) * (1, 1, 0.001)
    xyz[:1600, 2] += rng.uniform(3, 20, 1600)
    said: list[str] = []
    detect_outliers(xyz[1400:], warn=said.append)
    assert not said
    detect_outliers(xyz, warn=said.append)
    assert any('% of the points are rejected' in one for one in said)
