# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The decoder: every maker's time and lines are found, and what cannot be true is refused."""

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from helpers import ROOT
from helpers.clouds import SECOND, STAMP, cloud, table
from naive import alpha_beta_gamma as naive
from sensor_msgs.msg import PointCloud2

from lidar_outlier_filter.core.points.columns import LINES, find_unit, to_nanoseconds
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.parameters.yaml_files import read_yaml

CONFIG = ROOT / 'config'
COUNT = 1000
FACTOR = {'s': SECOND, 'ms': 1_000_000, 'us': 1000, 'ns': 1}


def decoder(values: dict[str, object] | None = None) -> tuple[Decoder, list[str], list[str]]:
    """Make a decoder, and the lists of what it informs and warns of."""
    informed: list[str] = []
    warned: list[str] = []
    parameters = FilterParameters().changed(values or {})
    return Decoder(parameters, informed.append, warned.append), informed, warned


def decode(msg: PointCloud2, **values: object) -> Points:
    """Read one cloud with the parameters given."""
    return decoder(values)[0].decode(msg)


def exact(values: Any, unit: str, start: int = 0) -> list[int]:
    """Turn times into whole nanoseconds by exact arithmetic."""
    return [start + round(Fraction(value.item()) * FACTOR[unit]) for value in values]


# Time -------------------------------------------------------------------------------------------

SWEEP = np.linspace(0, 0.1, COUNT)
NANOSECONDS = np.rint(SWEEP * 1e9)
EPOCH = 1.7e9

CONVENTIONS = {
    'Velodyne': ('time', 'f4', SWEEP, 's', STAMP),
    'Velodyne, stamped at the end': ('time', 'f4', SWEEP - 0.1, 's', STAMP),
    'Ouster': ('t', 'u4', NANOSECONDS, 'ns', STAMP),
    'Hesai, Robosense': ('timestamp', 'f8', EPOCH + SWEEP, 's', 0),
    'Hesai, unsynchronised': ('timestamp', 'f8', 4321.5 + SWEEP, 's', 0),
    'Livox': ('timestamp', 'f8', (EPOCH + SWEEP) * 1e9, 'ns', 0),
    'Livox, older': ('offset_time', 'u4', NANOSECONDS, 'ns', STAMP),
    'Autoware': ('time_stamp', 'u4', NANOSECONDS, 'ns', STAMP),
    'PCL, relative': ('t_offset', 'u8', NANOSECONDS, 'ns', STAMP),
    'PCL, absolute': ('timestamp', 'u8', (STAMP + NANOSECONDS), 'ns', 0),
    'float64 seconds': ('time_offset', 'f8', SWEEP, 's', STAMP),
    'float64 nanoseconds': ('time_offset', 'f8', NANOSECONDS, 'ns', STAMP),
}


@pytest.mark.parametrize('order', ['<', '>'])
@pytest.mark.parametrize('maker', CONVENTIONS)
@pytest.mark.parametrize('line', LINES[:4])
def test_time_conventions(maker: str, order: str, line: str) -> None:
    """The time of every maker is found by itself, to the nanosecond, and each name of lines."""
    name, kind, times, unit, start = CONVENTIONS[maker]
    rows = table(COUNT, order, **{line: ('u2', 7), name: (kind, times)})
    reader, informed, warned = decoder()
    points = reader.decode(cloud(rows))
    assert points.t.dtype == np.int64
    assert points.t.tolist() == exact(rows[name], unit, start)
    reference = 'from the header stamp' if start else 'absolute'
    assert informed == [
        f"times from field '{name}' ({unit}, {reference}), scan lines by field '{line}'"
    ]
    assert set(points.line.tolist()) == {7}
    assert not warned


FAMILIES = {
    'velodyne': {'time': ('f4', SWEEP - 0.1), 'ring': ('u2', 3)},
    'ouster': {'t': ('u4', NANOSECONDS), 'ring': ('u1', 3)},
    'hesai': {'timestamp': ('f8', EPOCH + SWEEP), 'ring': ('u2', 3)},
    'robosense': {'timestamp': ('f8', EPOCH + SWEEP), 'ring': ('u2', 3)},
    'livox': {'timestamp': ('f8', (EPOCH + SWEEP) * 1e9), 'line': ('u1', 3)},
    'autoware': {'time_stamp': ('u4', NANOSECONDS), 'channel': ('u2', 3)},
}


@pytest.mark.parametrize('family', FAMILIES)
def test_families(family: str) -> None:
    """The file of a sensor family says of its clouds what is found without it."""
    msg = cloud(table(COUNT, **FAMILIES[family]))
    reader, informed, warned = decoder(read_yaml(CONFIG / f'{family}.yaml'))
    found, by_itself, _ = decoder()
    points, expected = reader.decode(msg), found.decode(msg)
    assert points.t.tolist() == expected.t.tolist()
    assert set(points.line.tolist()) == {3}
    assert informed == by_itself
    assert not warned


def test_nanoseconds_survive() -> None:
    """Stamps keep what they hold: a float64's seconds, a uint64's or a header's nanoseconds."""
    msg = cloud(table(3, t=('u4', [0, 1, 2])), STAMP + 123_456_789)
    assert decode(msg).t.tolist() == [STAMP + 123_456_789 + i for i in range(3)]
    fine = EPOCH + np.arange(COUNT) * 2.0**-22
    t = decode(cloud(table(COUNT, timestamp=('f8', fine)))).t
    np.testing.assert_array_equal(np.abs(np.diff(t) - 1e9 * 2.0**-22) < 1, True)  # noqa: FBT003
    finest = STAMP + np.arange(COUNT) * 7
    t = decode(cloud(table(COUNT, timestamp=('u8', finest)))).t
    assert t.tolist() == finest.tolist()


@pytest.mark.parametrize(('reference', 'start'), [('stamp', STAMP), ('absolute', 0)])
@pytest.mark.parametrize('unit', FACTOR)
@pytest.mark.parametrize('kind', ['u4', 'f4', 'f8'])
def test_parameters_override(kind: str, unit: str, reference: str, start: int) -> None:
    """Field, unit and reference are those of the parameters, whatever the cloud suggests."""
    rows = table(4, time=('f4', 5), clock=(kind, [1, 2, 3, 400]))
    values = {'time_field': 'clock', 'time_unit': unit, 'time_reference': reference}
    assert decode(cloud(rows), **values).t.tolist() == exact(rows['clock'], unit, start)


@pytest.mark.parametrize('unit', FACTOR)
def test_absolute_times_begin_after_10_s(unit: str) -> None:
    """Up to 10 s after the stamp times may be relative; beyond they are of a clock of their own."""
    for largest, start in ((10 * SECOND, STAMP), (10 * SECOND + SECOND, 0)):
        rows = table(2, ring=('u2', 3), time=('u8', [0, largest // FACTOR[unit]]))
        assert decode(cloud(rows), time_unit=unit).t.tolist() == [start, start + largest]


def test_times_of_zero_tell_no_unit() -> None:
    """A short first message at time 0 leaves the unit open: the next one tells it."""
    reader, informed, _ = decoder()
    reader.decode(cloud(table(2, time=('f8', [0, 0]))))
    later = cloud(table(COUNT, time=('f8', np.arange(COUNT) * 1e5)), STAMP)
    assert (np.diff(reader.decode(later).t) == 100_000).all()
    assert ['(ns, ' in text for text in informed] == [False, True]
    reader.decode(cloud(table(2, time=('f8', [0, 9]))))
    assert len(informed) == 2


def test_units_of_functions() -> None:
    """The guess depends on type and size, as its docstring says; invalid points count nothing."""
    guesses = [
        ('f4', 0.1, 's'),
        ('f4', 1e8, 's'),
        ('f8', 10.0, 's'),
        ('f8', 10.5, 's'),
        ('f8', 11.0, 'ns'),
        ('f8', 1e9, 's'),
        ('f8', 2.2e9, 's'),
        ('f8', 2.4e9, 'ns'),
        ('f8', 1.7e12, 'ms'),
        ('f8', 1.7e15, 'us'),
        ('u8', 1.7e15, 'us'),
        ('f8', 1.7e18, 'ns'),
        ('f8', 1e14, 'ns'),
        ('u4', 5, 'ns'),
        ('u8', 5, 'ns'),
    ]
    for kind, size, unit in guesses:
        assert find_unit(np.array([0.0, size]), np.dtype(kind)).name == unit, (kind, size)
    values = np.array([1.5, np.nan, -0.25])
    valid = np.array([True, False, True])
    assert to_nanoseconds(values, valid, 'us').tolist() == [1500, 0, -250]


@pytest.mark.parametrize('per_message', [384, 5000])
@pytest.mark.parametrize(
    ('unit', 'begin', 'reference'),
    [('ns', 1.5, 'a counter of 32 bits'), ('us', 4294.0, 'a counter of 32 bits')],
)
def test_a_clock_that_wraps(per_message: int, unit: str, begin: float, reference: str) -> None:
    """A uint32 that does not count from the stamps goes on, through messages, wraps and gaps."""
    count = 20_000
    exact = (int(begin * SECOND) + np.arange(count) * 300_000) // FACTOR[unit]
    rows = table(count, ring=('u1', 0), t=('u4', exact % 2**32))
    rows['x'][::7] = np.nan
    rows['t'][::7] = 0
    reader, informed, _ = decoder({'time_unit': unit})
    begins = range(0, count, per_message)
    t = np.concatenate(
        [
            reader.decode(cloud(rows[i : i + per_message], STAMP + i * 300_000 + i % 999)).t
            for i in begins
        ]
    )
    valid = np.arange(count) % 7 > 0
    there = exact[valid] * FACTOR[unit]
    start = STAMP - there[0] if unit == 'ns' else 0
    assert (t[valid] - start).tolist() == there.tolist()
    assert informed == [f"times from field 't' ({unit}, {reference}), scan lines by field 'ring'"]


def test_a_clock_noticed_late() -> None:
    """A message whose times are near 0 may count from its stamp; a later one shows that not."""
    reader, informed, _ = decoder({'time_unit': 'ns'})
    for i in range(20):
        rows = table(100, ring=('u1', 0), t=('u4', i * 100_000_000 + np.arange(100)))
        t = reader.decode(cloud(rows, STAMP + i * 100_000_000)).t
    assert t.tolist() == (STAMP + 1_900_000_000 + np.arange(100)).tolist()
    assert len(informed) == 2


# Missing fields ---------------------------------------------------------------------------------


NO_TIME = 'no time field: times follow from points_per_second 1000'
NO_ROWS = 'no line field: each row is a scan line (line_source)'
T, RING = {'t': ('u4', range(6))}, {'ring': ('u1', 0)}


@pytest.mark.parametrize('height', [1, 2])
@pytest.mark.parametrize(
    ('columns', 'warnings'),
    [
        (RING, [[NO_TIME], [NO_TIME]]),
        (T, [[], [NO_ROWS]]),
        ({}, [[NO_TIME], [NO_TIME, NO_ROWS]]),
        (T | RING, [[], []]),
    ],
)
def test_missing_fields(height: int, columns: dict[str, Any], warnings: list[list[str]]) -> None:
    """One warning names what there is instead: the order of points, their rows or messages."""
    reader, _, warned = decoder({'points_per_second': 1000.0})
    msg = cloud(table(6, **columns).reshape(height, -1))
    first, second = reader.decode(msg), reader.decode(msg)
    if 't' not in columns:  # the points of a column are fired together
        after = [i * 1_000_000 for i in range(6)] if height == 1 else [0, 2_000_000, 4_000_000] * 2
        assert (first.t - STAMP).tolist() == (second.t - STAMP).tolist() == after
    if 'ring' not in columns and height == 1:
        assert set(first.line.tolist()).isdisjoint(second.line.tolist())
    if 'ring' not in columns and height == 2:
        assert first.line.tolist() == second.line.tolist() == [0, 0, 0, 1, 1, 1]
    expected = warnings[height - 1]
    assert [one.partition(' there is ')[2] for one in warned] == ['; '.join(expected)] * bool(
        expected
    )


def test_lines_by_parameter() -> None:
    """The field or source that the parameters name is taken, without a warning."""
    rows = table(6, t=('u4', 0), ring=('u2', 9), group=('u2', range(6))).reshape(2, 3)
    asked: list[tuple[dict[str, object], list[int]]] = [
        ({'line_field': 'group'}, [0, 1, 2, 3, 4, 5]),
        ({'line_source': 'row'}, [0, 0, 0, 1, 1, 1]),
        ({'line_source': 'message'}, [1] * 6),
    ]
    for values, lines in asked:
        reader, _, warned = decoder(values)
        assert reader.decode(cloud(rows)).line.tolist() == lines
        assert not warned


PAIR = np.ones(3, [(n, 'f4') for n in 'xyz'] + [('t', 'f4'), ('pair', 'u4', (2,)), ('s', 'f8')])
FLAT = np.ones((2, 3), [('x', 'i2'), ('y', 'u1'), ('z', 'f8'), ('t', 'u4')])
SCORED = table(3, outlier_detectors=('u2', 0))
REFUSALS: list[tuple[Any, dict[str, object], str]] = [
    (PAIR, {'time_field': 'tick'}, "^time_field 'tick' must be one of the fields x, y, z, t, pair"),
    (PAIR, {'time_field': 'pair'}, "field 'pair' must be a single number"),
    (PAIR, {'line_field': 'lane'}, "^line_field 'lane' must be one of the fields x, y, z, t, pair"),
    (PAIR, {'line_field': 'pair'}, "field 'pair' must be a single number"),
    (
        PAIR,
        {'line_source': 'field'},
        'the line field must be of a usual name, such as',
    ),
    (PAIR, {'line_source': 'angle', 'angle_field': 'phi'}, "^angle_field 'phi' must be one of"),
    (PAIR, {'sigma_field': 'std'}, "^sigma_field 'std' must be one of the fields"),
    (
        PAIR[['x', 'y', 'z']],
        {'points_per_second': 0.0},
        'the time field must be of a usual name',
    ),
    (FLAT, {'keep_organized': True}, "field 'x' must be a float, to become NaN"),
    (SCORED, {'scores': True}, 'must be without outlier_score, outlier_detectors, '),
    (SCORED[:0], {'scores': True}, 'must be without outlier_score, outlier_detectors, '),
]


@pytest.mark.parametrize(('rows', 'values', 'sentence'), REFUSALS)
def test_refused_fields(rows: Any, values: dict[str, object], sentence: str) -> None:
    """A field that a parameter asks for must be there, and fit; without it the cloud is read."""
    packed = rows.astype(np.dtype([(n, rows.dtype[n]) for n in rows.dtype.names]))
    with pytest.raises(CloudError, match=sentence):
        decode(cloud(packed), **values)
    assert len(decode(cloud(packed))) == rows.size


# Lines ------------------------------------------------------------------------------------------


def turns(count: int, per_turn: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Make the angles of a mirror that turns, in [-π, π), and begins at none of its ends."""
    angle = 1.0 + np.arange(count) * (2 * np.pi / per_turn)
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)


PLANES = ('xy', 'yz', 'zx')


@pytest.mark.parametrize('way', [*PLANES, 'rad', 'deg', 'rad backwards', 'whole degrees'])
@pytest.mark.parametrize('cuts', [(), (5, 5, 17, 130, 131, 499), tuple(range(1, 500))])
def test_angle_wraps(way: str, cuts: tuple[int, ...]) -> None:
    """A line ends where the angle wraps, by field or by plane, however the points are cut."""
    angle = turns(500, 37)
    values: dict[str, object] = {'line_source': 'angle'}
    if way in PLANES:
        columns: dict[str, Any] = {way[0]: ('f4', np.cos(angle)), way[1]: ('f4', np.sin(angle))}
        values['angle_plane'] = way
    else:
        angle = angle[::-1] if 'backwards' in way else angle
        given = np.rad2deg(angle) if 'deg' in way else angle
        given, kind = (np.rint(given), 'i2') if 'whole' in way else (given, 'f8')
        columns = {'phi': (kind, given)}
        values |= {'angle_field': 'phi', 'angle_unit': 'rad' if 'rad' in way else 'deg'}
    rows = table(500, t=('u4', range(500)), **columns)
    reader = decoder(values)[0]
    parts = np.split(rows, cuts)
    lines = np.concatenate([reader.decode(cloud(part)).line for part in parts])
    assert len(parts) == len(cuts) + 1
    assert (lines - lines[0]).tolist() == naive.angle_lines(angle.tolist())
    assert lines[-1] - lines[0] >= 13


def test_angle_of_missing_returns() -> None:
    """A missing return has no angle: it is in the line it stands in, and wraps nothing."""
    angle = turns(500, 37)
    rows = table(500, t=('u4', range(500)), y=('f4', np.cos(angle)), z=('f4', np.sin(angle)))
    no_return = np.random.default_rng(4).uniform(size=500) < 0.2
    for name in 'xyz':
        rows[name][no_return] = 0
    lines = decode(cloud(rows), line_source='angle').line
    assert (lines[~no_return]).tolist() == naive.angle_lines(angle[~no_return].tolist())
    np.testing.assert_array_equal(np.diff(lines) >= 0, True)  # noqa: FBT003
    np.testing.assert_array_equal(lines[1:][no_return[1:]], lines[:-1][no_return[1:]])


# What is not valid ------------------------------------------------------------------------------


@pytest.mark.parametrize('order', ['<', '>'])
@pytest.mark.parametrize('kind', ['f4', 'f8'])
def test_missing_returns(kind: str, order: str) -> None:
    """NaN (signalling, too) and Inf in any coordinate and 0 0 0 are missing returns."""
    nan, inf = np.nan, np.inf
    no_return: list[Any] = [
        (nan, 1, 1),
        (1, nan, 1),
        (1, 1, nan),
        (inf, 1, 1),
        (1, -inf, 1),
        (0, -0.0, 0),
    ]
    points: list[Any] = [(0, 0, 1e-30), (1, 0, 0), (0, -1, 1), (1e9, 1, 1)]
    rows = np.zeros(10, [(name, order + kind) for name in 'xyz'] + [('t', order + 'u4')])
    for i, point in enumerate(no_return + points):
        for name, value in zip('xyz', point, strict=True):
            rows[name][i] = value
    bits, signalling = {'f4': ('u4', 0x7FA00001), 'f8': ('u8', 0x7FF4000000000001)}[kind]
    rows['x'].view(order + bits)[0] = signalling
    read = decode(cloud(rows))
    assert read.valid.tolist() == [False] * 6 + [True] * 4
    np.testing.assert_array_equal(read.xyz[6:], np.array(points, kind).astype(float))


@pytest.mark.parametrize('wrong', [0, -1, 9e-10, 1e-170, 1.1e9, np.inf, np.nan])
def test_sigma(wrong: float) -> None:
    """A standard deviation comes along or is refused; that of a missing return is not read."""
    rows = table(4, t=('u4', 0), std=('f8', [1e-9, 1e9, 1, wrong]))
    with pytest.raises(CloudError, match=r"^field 'std' must be from 1e-09 to 1e\+09 m, got "):
        decode(cloud(rows), sigma_field='std')
    rows['x'][3] = 0
    sigma = decode(cloud(rows), sigma_field='std').sigma
    assert sigma is not None
    np.testing.assert_array_equal(sigma, rows['std'])
    assert decode(cloud(rows)).sigma is None


@pytest.mark.parametrize('kind', ['f4', 'f8'])
@pytest.mark.parametrize('axis', 'xyz')
def test_absurd_coordinates(axis: str, kind: str) -> None:
    """A return farther away than the Moon was never measured; beside a NaN it is not read."""
    reader, informed, _ = decoder()
    rows = np.ones(3, [(name, kind) for name in 'xyz'] + [('t', 'u4')])
    for sign in (1, -1):
        rows[axis][1] = sign * 1e9
        assert decode(cloud(rows)).valid.all()
        rows[axis][1] = sign * np.nextafter(rows[axis].dtype.type(1e9), np.inf)
        with pytest.raises(CloudError, match=r'the coordinates of a point must be within 1e\+09 m'):
            reader.decode(cloud(rows))
        assert not informed
        rows[axis][1] = sign * np.finfo(kind).max
        with pytest.raises(CloudError, match='NaN or Inf, got'):
            reader.decode(cloud(rows))
    rows['xyz'['xyz'.index(axis) - 1]][1] = np.nan
    assert reader.decode(cloud(rows)).valid.tolist() == [True, False, True]


@pytest.mark.parametrize('kind', ['f4', 'f8'])
@pytest.mark.parametrize('bad', [np.nan, np.inf, -np.inf, 1e30, -1e30])
def test_bad_stamps(kind: str, bad: float) -> None:
    """A point's time must be finite and possible; that of a missing return is not read."""
    reader = decoder()[0]
    rows = table(5, time=(kind, [0, 0.01, 0.02, bad, 0.04]))
    with pytest.raises(CloudError, match='the time of a point must be finite and within 73 years'):
        reader.decode(cloud(rows))
    rows['x'][3] = 0
    expected = exact(rows['time'][[0, 1, 2, 4]], 's', STAMP)
    assert reader.decode(cloud(rows)).t.tolist() == [*expected[:3], 0, expected[3]]


@pytest.mark.parametrize('bad', [np.nan, np.inf, 1e308])
def test_refused_cloud_decides_no_convention(bad: float) -> None:
    """How clouds are read is found out from the first one that is taken, and said then."""
    reader, informed, warned = decoder()
    rows = table(3, timestamp=('f8', bad))
    for _ in range(2):
        with pytest.raises(CloudError, match='the time of a point'):
            reader.decode(cloud(rows))
    assert not informed
    assert not warned
    rows['timestamp'] = EPOCH
    assert reader.decode(cloud(rows)).t.tolist() == [1_700_000_000 * SECOND] * 3
    assert len(informed) == 1


@pytest.mark.parametrize('shape', [(0,), (0, 4), (4, 0)])
def test_empty_cloud(shape: tuple[int, ...]) -> None:
    """A cloud without points has none, and decides nothing; it need not even have fields."""
    reader, informed, warned = decoder()
    empty = cloud(table(0, t=('u4', 0)).reshape(shape))
    blank = cloud(table(0))
    blank.fields, blank.point_step = [], 0
    for msg in (empty, blank):
        points = reader.decode(msg)
        assert len(points) == 0
        assert points.xyz.shape == (0, 3)
    assert not informed
    assert not warned
