# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""One drive of a profile scanner in the forms that drivers send it in.

All forms of one drive have the same returns, each with its ``label`` and ``surface``. They differ
in how they are cut into messages, in their columns, in their frame, and in what their clock tells.

    for cloud in form_clouds('packets_384', seed=1):
        outputs += CloudFilter().push(cloud.points, stamp=cloud.stamp)
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Ints, Rows
from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation.truth import Cause
from lidar_outlier_lab.simulation.scenes.random_streets import LANES, Town, lay_out
from lidar_outlier_lab.simulation.world.drive import (
    Disturbances,
    Drive,
    join,
    second_echoes,
    simulate,
)
from lidar_outlier_lab.simulation.world.particles import ThinFall
from lidar_outlier_lab.simulation.world.recording import FRAME, OWN_FRAME, START, Cloud
from lidar_outlier_lab.simulation.world.scene import Scene, barrier_arm
from lidar_outlier_lab.simulation.world.sensors import TRUTH, ProfileScanner
from lidar_outlier_lab.simulation.world.trajectory import Route

STREAM = 6207  # of random numbers, which nothing else uses
INTERVAL = 6667  # nanoseconds between shots: 149.99 turns of 1000 shots a second
SHOTS = 1000  # of a turn
LINES = 180
YAW = np.radians(45.0)
SPEED = 9.0  # metres per second
UTM = (450_000.0, 5_400_000.0, 100.0)
GPS_WEEK = 1_749_945_600 * SECOND  # when the week of ``START`` began, nanoseconds
COPIED = 0.9  # share of the shots that dual mode publishes twice
LONGEST_ODD = 3.7  # turns of a message that is cut at odd places


class Part(NamedTuple):
    """The N points of a message, in the order of their shots.

    Attributes
    ----------
    points : (N,) as simulated
    shot, head, echo : (N,) number of the shot; of the head, from 0; of the return, from 1
    t : (N,) what the clock says, nanoseconds after ``START``
    begin : that of the message
    number : of the message, from 0
    turn : (N,) number of the turn, from 0
    first : that of the message's first turn

    """

    points: Rows
    shot: Ints
    head: Ints
    echo: Ints
    t: Ints
    begin: int
    number: int
    turn: Ints
    first: int


# What a column holds: its type, and its values.
COLUMNS: dict[str, tuple[str, Callable[[Part], Any]]] = {
    'intensity': ('<f4', lambda part: part.points['intensity']),
    't': ('<u4', lambda part: part.t - part.begin),
    'seconds': ('<f4', lambda part: (part.t - part.begin) / SECOND),
    'milliseconds': ('<f4', lambda part: (part.t - part.begin) / 1e6),
    'unix': ('<f8', lambda part: (START + part.t) / SECOND),
    'unix_us': ('<f8', lambda part: (START + part.t) / 1e3),
    'gps': ('<f8', lambda part: (START - GPS_WEEK + part.t) / SECOND),
    'line': ('<u4', lambda part: part.turn),
    'line_of_message': ('<u2', lambda part: part.turn - part.first),
    'line_of_heads': ('<u4', lambda part: 2 * part.turn + part.head),
    'line_byte': ('<u1', lambda part: part.turn % 256),
    'line_float': ('<f4', lambda part: part.turn),
    'zero': ('<u2', lambda _: 0),
    'number': ('<u2', lambda part: part.number),
    'head': ('<u1', lambda part: part.head),
    'return_number': ('<u1', lambda part: part.echo),
    'scan_angle': ('<f4', lambda part: part.points['scan_angle']),
}
TEN = 10 * SHOTS


@dataclass(frozen=True)
class Form:
    """How a drive is sent.

    Attributes
    ----------
    sentence : what the form is
    shots : of a message; 0: cut at odd places
    columns : beside x, y, z and the truth: ``name`` or ``name=column``, a key of ``COLUMNS``
    together, tick : shots that have one time, that of the first; nanoseconds of the clock's steps
    rows : an organised cloud, whose rows are turns
    offset, xyz : is added to x, y, z, metres; their type
    own : in the sensor's frame, at the moment of each shot
    drive : how the drive goes, a key of ``DRIVES``
    heads : two: another one, which looks to the other side, its shots between those of the first
    echoes : two: 'copies' of most returns, or the 'second' of the shots that have one

    """

    sentence: str
    shots: int = TEN
    columns: str = 'intensity t line'
    together: int = 1
    tick: int = 1
    rows: bool = False
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    xyz: str = '<f4'
    own: bool = False
    drive: str = 'street'
    heads: int = 1
    echoes: str = 'one'


PLAIN = 'intensity t'
_MAP_FORMS = {
    # How it is cut
    'line': Form('running line number, 10 turns a message'),
    'turn': Form('one turn a message, no line field', SHOTS, PLAIN),
    'turns_10': Form('10 turns a message, no line field', TEN, PLAIN),
    'turns_25': Form('25 turns a message, no line field', 25 * SHOTS, PLAIN),
    'second': Form('one second a message, no line field', 150 * SHOTS, PLAIN),
    'packets_line': Form('packets of 384 shots, line number', 384),
    'packets': Form('packets of 384 shots, no line field', 384, PLAIN),
    'odd': Form('cut at odd places, no line field', 0, PLAIN),
    # Lines numbered afresh
    'afresh': Form('line 0 to 9 in each message', columns='intensity t line=line_of_message'),
    'rows': Form('organised, rows are turns, no line field', TEN, PLAIN, rows=True),
    # Coordinates
    'utm': Form('UTM, float64', offset=UTM, xyz='<f8'),
    'utm_turns_10': Form('UTM, float64, no line field', TEN, PLAIN, offset=UTM, xyz='<f8'),
    'far': Form('2000 m from the origin, float32', offset=(2000.0, 0.0, 0.0)),
    'far_turns_10': Form('the same, no line field', TEN, PLAIN, offset=(2000.0, 0.0, 0.0)),
    # Shared times
    'time_of_line': Form('one time a line, line number', together=SHOTS),
    'time_of_24': Form('24 shots share a time, line number', 9984, together=24),
    'time_of_24_plain': Form('24 shots share a time, no line field', 9984, PLAIN, 24),
    'time_of_384': Form('384 shots share a time, line number', 9984, together=384),
    'time_of_384_plain': Form('384 shots share a time, no line field', 9984, PLAIN, 384),
    'ticks': Form('clock of 25 µs, no line field', TEN, PLAIN, tick=25_000),
    # Names and units
    'gps_time': Form('gps_time: seconds of the week', columns='intensity gps_time=gps'),
    'GPSTime': Form('GPSTime: seconds of the week', columns='intensity GPSTime=gps'),
    'Time': Form('Time: seconds after the stamp', columns='intensity Time=seconds'),
    'stamps': Form('stamps, as laser_geometry', SHOTS, 'intensity stamps=seconds'),
    'unix_us': Form('unix time in µs, float64', columns='intensity timestamp=unix_us line'),
    'milliseconds': Form('ms after the stamp, float32', columns='intensity time=milliseconds line'),
    'ring_0': Form('ring = 0 for all', columns='intensity t ring=zero'),
    'ring_packet': Form('ring = number of the packet', 384, 'intensity t ring=number'),
    'line_float': Form('line number as float32', columns='intensity t line=line_float'),
    'line_byte': Form('line number % 256', columns='intensity t line=line_byte'),
    'profile': Form('line number named profile', columns='intensity t profile=line'),
    'scan_line': Form('line number named scan_line', columns='intensity t scan_line=line'),
    'scan_angle': Form('scan_angle, no line field', TEN, 'intensity t scan_angle'),
    # Several returns of a shot
    'copies': Form(
        'dual mode, most shots twice', columns='intensity t line return_number', echoes='copies'
    ),
    'echoes': Form(
        'second echoes, line number', columns='intensity t line return_number', echoes='second'
    ),
    'echoes_plain': Form(
        'second echoes, no line field', columns='intensity t return_number', echoes='second'
    ),
    # Other scanners, each with the good form first
    'heads_line': Form(
        'two heads, all lines numbered', 2 * TEN, 'intensity t line=line_of_heads', heads=2
    ),
    'heads_field': Form(
        'two heads, field head, no line field', 2 * TEN, 'intensity t head', heads=2
    ),
    'heads_field_line': Form(
        'two heads, field head, lines of each', 2 * TEN, 'intensity t head line', heads=2
    ),
    'heads': Form('two heads, not told apart', 2 * TEN, PLAIN, heads=2),
    'stands_line': Form('a vehicle that stands, line number', drive='stands'),
    'stands': Form('a vehicle that stands, no line field', TEN, PLAIN, drive='stands'),
    'swings_line': Form('swinging mirror, line number', drive='swings'),
    'swings': Form('swinging mirror, no line field', TEN, PLAIN, drive='swings'),
    'facets_line': Form('four facets, a line each', drive='facets'),
    'facets': Form('four facets, no line field', TEN, PLAIN, drive='facets'),
}
_OWN = ('line', 'turn', 'turns_10', 'packets', 'odd', 'afresh', 'rows', 'stands', 'facets')
FORMS = MappingProxyType(
    _MAP_FORMS
    | {
        f'{name}_own': replace(form, sentence=f"{form.sentence}; sensor's frame", own=True)
        for name, form in _MAP_FORMS.items()
        if name in _OWN
    }
)


def street(seed: int) -> Drive:
    """Draw a street and a drive through it, some hundreds of outliers of many causes."""
    rng = np.random.default_rng([seed, STREAM])
    town = Town(half_road=5.4, crown=0.06, kerb=0.12, trees=True)
    arm = barrier_arm((SPEED * 0.4, 5.0, 1.0), 4.6, rng.uniform(0.2, 0.5), 0.4)
    falls = ThinFall(Cause.SNOW, 1e-4, 8.0)
    turn = rng.uniform(-0.05, 0.05)
    return Drive(
        Scene((*lay_out(town, rng), arm), (falls,)),
        lines=LINES,
        sensor=ProfileScanner(
            lines_per_second=SECOND / (INTERVAL * SHOTS), shots_per_line=SHOTS, yaw=YAW
        ),
        trajectory=Route(((0.0, SPEED, 0.0), (0.8, SPEED, turn)), (0.0, LANES[0], 0.0)),
        disturbances=Disturbances(reflection=0.002, near_surface=0.0005),
        seed=seed,
    )


def _stands(drive: Drive) -> Drive:
    return replace(drive, trajectory=Route(((0.0, 0.0, 0.0),), (0.0, LANES[0], 0.0)))


def _mirror(**how: Any) -> Callable[[Drive], Drive]:
    return lambda drive: replace(drive, sensor=replace(drive.sensor, **how))


def _facets(drive: Drive) -> Drive:
    """Let four facets look down 120° each, the shots as many as before."""
    sensor, four = drive.sensor, 4
    shots, rate = sensor.shots_per_line // four, four * sensor.lines_per_second
    facets = {'view': np.radians(120.0), 'shots_per_line': shots, 'lines_per_second': rate}
    return replace(_mirror(**facets)(drive), lines=four * drive.lines)


# What is changed in a street's drive
DRIVES: dict[str, Callable[[Drive], Drive]] = {
    'street': lambda drive: drive,
    'stands': _stands,
    'swings': _mirror(view=np.radians(200.0), swings=True),
    'facets': _facets,
}


def form_clouds(name: str, seed: int = 1, draw: Callable[[int], Drive] = street) -> Iterator[Cloud]:
    """Send a drive of a profile scanner in a form; the same seed has the same returns in all.

    Parameters
    ----------
    name : one of ``FORMS``
    seed : from 0
    draw : makes the drive of a seed

    Raises
    ------
    FilterError
        If there is no such form.

    """
    if name not in FORMS:
        raise FilterError('the form', f'one of {", ".join(FORMS)}', name)
    form = FORMS[name]
    seen = _seen(draw, seed, form.drive, own=form.own, heads=form.heads, echoes=form.echoes)
    turn = seen.shot // seen.shots_per_line
    clock = seen.shot // form.together * form.together * seen.interval + seen.late
    clock -= clock % form.tick
    frame = OWN_FRAME if form.own else FRAME
    ends = _ends(form, seen, seed)
    for number, (begin, end) in enumerate(pairwise([0, *ends])):
        inside = slice(*np.searchsorted(seen.time, (begin, end)))
        part = Part(
            *(column[inside] for column in (seen.points, seen.shot, seen.head, seen.echo, clock)),
            begin=begin - begin % form.tick,
            number=number,
            turn=turn[inside],
            first=begin // (seen.interval * seen.shots_per_line),
        )
        rows = _rows(form, part)
        if form.rows:
            shape = (form.shots // seen.shots_per_line, seen.shots_per_line)
            rows = _organised(rows, part, shape)
        yield Cloud(START + part.begin, START + end, rows, frame=frame)


class _Seen(NamedTuple):
    """All N returns of a drive in the order of ``time``, nanoseconds; see :class:`Part`.

    ``late`` is how much later the shots of a head come than those of the first.
    """

    points: Rows
    time: Ints
    shot: Ints
    head: Ints
    echo: Ints
    late: Ints
    shots: int
    shots_per_line: int
    interval: int


@lru_cache(maxsize=4)
def _seen(  # noqa: PLR0913  what makes the returns
    draw: Callable[[int], Drive], seed: int, kind: str, *, own: bool, heads: int, echoes: str
) -> _Seen:
    """Simulate what a drive measures."""
    drive = replace(DRIVES[kind](draw(seed)), in_own_frame=own)
    sensor, parts = drive.sensor, []
    for head in range(heads):
        turned = replace(sensor, yaw=-sensor.yaw if head else sensor.yaw)
        one = replace(drive, sensor=turned, seed=drive.seed + head)
        returns = [join([block for _, block in simulate(one)])]
        if echoes == 'second':
            returns.append(second_echoes(one, returns[0].shot))
        elif echoes == 'copies':
            lot = np.random.default_rng([seed, STREAM, 1]).random(len(returns[0].shot))
            returns.append(returns[0].take(lot < COPIED))
        parts += [(head, echo, *some) for echo, some in enumerate(returns, 1)]
    head, echo = (np.concatenate([np.full(len(p[2]), p[i]) for p in parts]) for i in (0, 1))
    shot, points = (np.concatenate([p[i] for p in parts]) for i in (2, 3))
    late = head * (sensor.interval // 2)
    time = shot * sensor.interval + late
    order = np.lexsort((echo, time))
    columns = (points, time, shot, head, echo, late)
    measures = (drive.shots, sensor.shots_per_line, sensor.interval)
    return _Seen(*(column[order] for column in columns), *measures)


def _ends(form: Form, seen: _Seen, seed: int) -> list[int]:
    """Return when each message ends, nanoseconds after the first shot."""
    end = seen.shots * seen.interval
    if form.shots:
        step = form.shots * seen.interval // form.heads
        return [*range(step, end, step), end]
    rng = np.random.default_rng([seed, STREAM, 2])
    most = int(LONGEST_ODD * seen.shots_per_line)
    lengths = rng.integers(1, most, 2 * seen.shots // most + 100)
    ends = np.cumsum(lengths) * seen.interval
    return [*ends[ends < end].tolist(), end]


def _rows(form: Form, part: Part) -> Rows:
    """Lay out the points of a message."""
    named = [column.partition('=')[::2] for column in form.columns.split()]
    columns = {name: COLUMNS[column or name] for name, column in named}
    layout = [(axis, form.xyz) for axis in 'xyz'] + [(n, kind) for n, (kind, _) in columns.items()]
    rows = np.zeros(len(part.shot), [*layout, *TRUTH])
    for axis, away in zip('xyz', form.offset, strict=True):
        rows[axis] = part.points[axis].astype(np.float64) + away
    for name, (_, values) in columns.items():
        rows[name] = values(part)
    for name, _ in TRUTH:
        rows[name] = part.points[name]
    return rows


def _organised(rows: Rows, part: Part, shape: tuple[int, int]) -> Rows:
    """Put the shots of each turn into a row; those without echo are NaN."""
    table = np.zeros(shape, rows.dtype)
    for axis in 'xyz':
        table[axis] = np.nan
    table[part.turn - part.first, part.shot % shape[1]] = rows
    return table
