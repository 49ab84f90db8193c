# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Columns by their names, units of time by what makes sense of a lidar, and clocks that wrap."""

import numpy as np
import pytest
from helpers import ROOT

from lidar_outlier_filter.core.points import columns
from lidar_outlier_filter.core.points.columns import INTENSITIES, LINES, TIMES, Names
from lidar_outlier_filter.errors import CloudError

SECOND = 1_000_000_000
EPOCH = 1_700_000_000

FOUND = [
    (TIMES, 'x y z Time Ring', 'Time'),
    (TIMES, 'T time', 'time'),
    (TIMES, 'GpsTime', 'GpsTime'),
    (TIMES, 'adjusted_gps_time', 'adjusted_gps_time'),
    (TIMES, 'scalar_GPS_Time', 'scalar_GPS_Time'),
    (TIMES, 'time_us', 'time_us'),
    (TIMES, 'Time [s]', 'Time [s]'),
    (TIMES, 'Timestamp(ns)', 'Timestamp(ns)'),
    (TIMES, 'stamps', 'stamps'),
    (TIMES, 'stamp', 'stamp'),
    (TIMES, 'times_seen', ''),
    (TIMES, 'point_s', ''),
    (LINES, 'LASER_ID channel', 'channel'),
    (LINES, 'Laser ID', 'Laser ID'),
    (LINES, 'scalar_ring', 'scalar_ring'),
    (LINES, 'scalar_ring Ring', 'Ring'),
    (LINES, 'scanline', 'scanline'),
    (LINES, 'scan_line', 'scan_line'),
    (LINES, 'profile', 'profile'),
    (LINES, 'scanner_channel', ''),
    (INTENSITIES, 'I', 'I'),
    (INTENSITIES, 'i Intensity', 'i'),
    (INTENSITIES, 'scalar_Intensity', 'scalar_Intensity'),
]


@pytest.mark.parametrize(('usual', 'names', 'found'), FOUND)
def test_names(usual: Names, names: str, found: str) -> None:
    """As written before any case, and any case before separators, prefixes and units."""
    split = [names] if ' [' in names or names == 'Laser ID' else names.split()
    assert columns.choose(split, usual) == (found, [])


def test_the_page_lists_the_names() -> None:
    """All of them, in their order."""
    page = (ROOT / 'doc' / 'numpy.md').read_text(encoding='utf-8')
    for usual in (TIMES, LINES, INTENSITIES):
        assert f'| {", ".join(f"`{name}`" for name in usual)} |' in page


def test_objections() -> None:
    """A column that cannot be what its name says is passed over, with a note."""
    found = columns.choose(['ring', 'line'], LINES, {'ring': 'not whole', 'line': ''}.__getitem__)
    assert found == ('line', ["'ring', which is not used: not whole"])


SHOTS = 30_000
PACKET = 384
# Kind, nanoseconds from point to point, first time in seconds; points that share a time.
TIMED = {
    'a sweep': (0.1 * SECOND / SHOTS, 0.0, 1),
    'a mirror at 1 MHz': (1000.0, 0.0, 1),
    'columns of 128': (380.0, 0.0, 128),
    'packets': (3300.0, 0.0, PACKET // 8),
    'since the start': (3300.0, 1500.25, 1),
    'since 1970': (3300.0, EPOCH + 0.5, 1),
}
FACTOR = {'s': SECOND, 'ms': 1_000_000, 'us': 1000, 'ns': 1}


@pytest.mark.parametrize('cut', [slice(None), slice(0, PACKET), slice(999, 999 + PACKET)])
@pytest.mark.parametrize('kind', ['f8', 'f4', 'i8', 'u4'])
@pytest.mark.parametrize('unit', FACTOR)
@pytest.mark.parametrize('timed', TIMED)
def test_units(timed: str, unit: str, kind: str, cut: slice) -> None:
    """The unit is found whatever the type, however the stream is cut; a surprising one is said."""
    step, start, share = TIMED[timed]
    offset = (np.arange(SHOTS) // share * share) * step
    exact = (start * SECOND + offset) / FACTOR[unit]
    exact = exact % 2**32 if kind == 'u4' else exact
    values = np.rint(exact).astype(kind) if kind[0] in 'iu' else exact.astype(kind)
    values = values[cut]
    if len(np.unique(values)) < PACKET / 2 / share:
        return  # such a field does not tell points apart
    found = columns.find_unit(values, values.dtype)
    assert found.name == unit
    assert found.is_known
    if usual := {'f4': 's', 'u4': 'ns'}.get(kind):
        assert bool(found.note) == (usual != unit)


def test_a_unit_in_the_name_or_of_few_points() -> None:
    """A unit in the name counts; few times keep the usual unit, and leave it open."""
    assert columns.find_unit(np.arange(500), np.dtype('u4'), 'time_ms').name == 'ms'
    few = columns.find_unit(np.array([0.0, 90.0, 99.5]), np.dtype('f4'))
    assert few == ('s', '', False)
    wild = columns.find_unit(np.arange(500) * 1e7, np.dtype('u4'), 't')
    assert wild.name == 'ns'
    assert 'no likely unit: in ns, points would be 0.01 s apart (time_unit)' in wild.note


def test_sparse_and_thinned_times() -> None:
    """Few returns in a message, or few points of a survey, are no reason for another unit."""
    sparse = np.sort(np.random.default_rng(1).uniform(0, 0.1, 150))
    assert columns.find_unit(sparse, np.dtype('f4')).name == 's'
    thinned = 321_000_000.5 + np.arange(500) * 0.01
    assert columns.find_unit(thinned, np.dtype('f8'), 'GpsTime').name == 's'


def test_times_that_are_too_coarse() -> None:
    """A float32 cannot hold absolute times."""
    times = np.full(500, EPOCH, np.float32)
    valid = np.ones(500, np.bool_)
    why = columns.too_coarse_times(times, valid)
    assert why == 'float32 of 1.7e+09 s come in steps of 1.3e+02 s'
    assert not columns.too_coarse_times(times.astype(np.float64), valid)
    assert not columns.too_coarse_times(np.linspace(0, 0.1, 500, dtype=np.float32), valid)


def test_whole_numbers() -> None:
    """Floats may number lines; fractions, or nothing for a return, may not."""
    values, valid = np.array([1.0, 2.0, np.nan, 4.0]), np.array([True, True, False, True])
    assert columns.whole_numbers(values, valid, 'ring').tolist() == [1, 2, 0, 4]
    assert not columns.not_whole(values, valid)
    values[1] = 2.5
    assert columns.not_whole(values, valid) == 'not of whole numbers'
    with pytest.raises(CloudError, match='ring must be of whole numbers'):
        columns.whole_numbers(values, valid, 'ring')


def test_a_clock_that_wraps_within_a_message() -> None:
    """Times go on; missing returns, and lines one after the other, do not matter."""
    exact = 2**32 - 500 + np.arange(1000)
    values, valid = (exact % 2**32).astype(np.uint32), np.ones(1000, np.bool_)
    values[700], valid[700] = 2**32 - 1, False
    assert columns.unwrapped(values, valid)[valid].tolist() == exact[valid].tolist()
    by_line = values.reshape(-1, 8).T.ravel()
    found = columns.unwrapped(by_line, valid.reshape(-1, 8).T.ravel())
    expected = exact.reshape(-1, 8).T.ravel()
    keep = valid.reshape(-1, 8).T.ravel()
    assert found[keep].tolist() == expected[keep].tolist()


def test_intensities_that_say_nothing() -> None:
    """All alike, or 0 for half of the points: unknown. Some zeros are weak returns."""
    assert columns.telling(None) is None
    assert columns.telling(np.zeros(9, np.float32)) is None
    assert columns.telling(np.full(9, 7, np.float32)) is None
    assert columns.telling(np.array([0, 7, 0, 7], np.float32)) is None
    half = np.array([0, 1, 0, 2], np.float32)
    np.testing.assert_array_equal(columns.telling(half), [np.nan, 1, np.nan, 2])
    some = np.array([0, 1, 3, 2, np.nan], np.float32)
    np.testing.assert_array_equal(columns.telling(some), some)
