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
from lidar_outlier_lab.simulation.scenes.mapping_streets import STREAM, STREETS, street
from lidar_outlier_lab.simulation.world.drive import (
    Drive,
    Returns,
    about,
    gather,
    join,
    merge,
    second_echoes,
)
from lidar_outlier_lab.simulation.world.recording import FRAME, OWN_FRAME, START, Cloud
from lidar_outlier_lab.simulation.world.sensors import TRUTH, ProfileScanner
from lidar_outlier_lab.simulation.world.trajectory import Route

UTM, FAR = (450_000.0, 5_400_000.0, 100.0), (2000.0, 0.0, 0.0)  # metres
GPS_WEEK = 1_749_945_600 * SECOND  # when the week of ``START`` began, nanoseconds
COPIED = 0.9  # share of the shots that dual mode publishes twice
LONGEST_ODD = 3.7  # turns of a message that is cut at odd places


class MessagePart(NamedTuple):
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
COLUMNS: dict[str, tuple[str, Callable[[MessagePart], Any]]] = {
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


@dataclass(frozen=True)
class Form:
    """How a drive is sent.

    Attributes
    ----------
    sentence : what the form is
    turns : of a message; 0: cut at odd places
    packet : shots of a message, instead
    columns : beside x, y, z and the truth: ``name`` or ``name=column``, a key of ``COLUMNS``
    together, tick : shots that have one time, that of the first, 0: all of a line; nanoseconds of
        the clock's steps
    rows : an organised cloud, whose rows are turns
    offset, xyz : is added to x, y, z, metres; their type
    own : in the sensor's frame, at the moment of each shot
    drive : how the drive goes, a key of ``DRIVES``
    heads : two: another one, which looks to the other side, its shots between those of the first
    echoes : two: 'copies' of most returns, or the 'second' of the shots that have one

    """

    sentence: str
    columns: str = 'intensity t line'
    turns: int = 10
    packet: int = 0
    together: int = 1
    tick: int = 1
    rows: bool = False
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    xyz: str = '<f4'
    own: bool = False
    drive: str = 'street'
    heads: int = 1
    echoes: str = 'one'


PLAIN, ECHOES = 'intensity t', 'intensity t line return_number'
PACKET, DATAGRAM = 384, 9984  # shots
_FORMS = {
    # How it is cut
    'line': Form('running line number, 10 turns a message'),
    'turn': Form('one turn a message, no line field', PLAIN, turns=1),
    'turns_10': Form('10 turns a message, no line field', PLAIN),
    'turns_25': Form('25 turns a message, no line field', PLAIN, turns=25),
    'second': Form('one second a message, no line field', PLAIN, turns=150),
    'packets_line': Form('packets of 384 shots, line number', packet=PACKET),
    'packets': Form('packets of 384 shots, no line field', PLAIN, packet=PACKET),
    'odd': Form('cut at odd places, no line field', PLAIN, turns=0),
    # Lines numbered afresh
    'afresh': Form('line 0 to 9 in each message', 'intensity t line=line_of_message'),
    'rows': Form('organised, rows are turns, no line field', PLAIN, rows=True),
    # Coordinates
    'utm': Form('UTM, float64', offset=UTM, xyz='<f8'),
    'utm_turns_10': Form('UTM, float64, no line field', PLAIN, offset=UTM, xyz='<f8'),
    'far': Form('2000 m from the origin, float32', offset=FAR),
    'far_turns_10': Form('2000 m from the origin, no line field', PLAIN, offset=FAR),
    # Shared times
    'time_of_line': Form('one time a line, line number', together=0),
    'time_of_24': Form('24 shots share a time, line number', packet=DATAGRAM, together=24),
    'time_of_24_plain': Form('the same, no line field', PLAIN, packet=DATAGRAM, together=24),
    'time_of_384': Form('384 shots share a time, line number', packet=DATAGRAM, together=384),
    'time_of_384_plain': Form('the same, no line field', PLAIN, packet=DATAGRAM, together=384),
    'ticks': Form('clock of 25 µs, no line field', PLAIN, tick=25_000),
    # Names and units
    'gps_time': Form('seconds of the GPS week, float64', 'intensity gps_time=gps'),
    'GPSTime': Form('the same, in capitals', 'intensity GPSTime=gps'),
    'Time': Form('seconds after the stamp, float32', 'intensity Time=seconds'),
    'stamps': Form('as laser_geometry, one turn a message', 'intensity stamps=seconds', turns=1),
    'unix_us': Form('unix time in µs, float64', 'intensity timestamp=unix_us line'),
    'milliseconds': Form('ms after the stamp, float32', 'intensity time=milliseconds line'),
    'ring_0': Form('ring = 0 for all', 'intensity t ring=zero'),
    'ring_packet': Form('ring = number of the packet', 'intensity t ring=number', packet=PACKET),
    'line_float': Form('line number as float32', 'intensity t line=line_float'),
    'line_byte': Form('line number % 256', 'intensity t line=line_byte'),
    'profile': Form('line number named profile', 'intensity t profile=line'),
    'scan_line': Form('line number named scan_line', 'intensity t scan_line=line'),
    'scan_angle': Form('scan_angle, no line field', 'intensity t scan_angle'),
    # Several returns of a shot
    'copies': Form('dual mode, most shots twice', ECHOES, echoes='copies'),
    'echoes': Form('second echoes, line number', ECHOES, echoes='second'),
    'echoes_plain': Form('second echoes, no line', 'intensity t return_number', echoes='second'),
    # Other scanners, each with the good form first
    'heads_line': Form('two heads, lines of both', 'intensity t line=line_of_heads', heads=2),
    'heads_field': Form('two heads, field head, no line field', 'intensity t head', heads=2),
    'heads_field_line': Form('two heads, field head, line', 'intensity t head line', heads=2),
    'heads': Form('two heads, which no field separates', PLAIN, heads=2),
    'stands_line': Form('a vehicle that stands, line number', drive='stands'),
    'stands': Form('a vehicle that stands, no line field', PLAIN, drive='stands'),
    'swings_line': Form('swinging mirror, line number', drive='swings'),
    'swings': Form('swinging mirror, no line field', PLAIN, drive='swings'),
    'facets_line': Form('four facets, a line each', drive='facets'),
    'facets': Form('four facets, no line field', PLAIN, drive='facets'),
}
TWO_HEADS = Form('two heads', f'{ECHOES} head', heads=2, echoes='second')
TOPICS = ('/lidar/left/points', '/lidar/right/points')
_OWN = ('line', 'turn', 'turns_10', 'packets', 'odd', 'afresh', 'rows', 'stands', 'facets')
FORMS = MappingProxyType(
    _FORMS
    | {
        f'{name}_own': replace(form, sentence=f"{form.sentence}; sensor's frame", own=True)
        for name, form in _FORMS.items()
        if name in _OWN
    }
)


def _scanner(drive: Drive) -> ProfileScanner:
    """Return the sensor of a drive, which must be a profile scanner."""
    if not isinstance(drive.sensor, ProfileScanner):
        raise FilterError('the sensor', 'a profile scanner', type(drive.sensor).__name__)
    return drive.sensor


def _stands(drive: Drive) -> Drive:
    return replace(drive, trajectory=Route(((0.0, 0.0, 0.0),)))


def _swings(drive: Drive) -> Drive:
    return replace(drive, sensor=replace(_scanner(drive), view=np.radians(200.0), swings=True))


def _facets(drive: Drive) -> Drive:
    """Let four facets look down 120° each; as many shots as before."""
    sensor, four = _scanner(drive), 4
    facets = replace(
        sensor,
        view=np.radians(120.0),
        shots_per_line=sensor.shots_per_line // four,
        lines_per_second=four * sensor.lines_per_second,
    )
    return replace(drive, sensor=facets, lines=four * drive.lines)


# What is changed in a street's drive
DRIVES: dict[str, Callable[[Drive], Drive]] = {
    'street': lambda drive: drive,
    'stands': _stands,
    'swings': _swings,
    'facets': _facets,
}


def form_clouds(
    name: str,
    seed: int = 1,
    draw: Callable[[int], Drive] = street,
    share: float | None = None,
) -> Iterator[Cloud]:
    """Send a drive of a profile scanner in a form; the same seed has the same returns in all.

    Parameters
    ----------
    name : one of ``FORMS``
    seed : from 0
    draw : makes the drive of a seed
    share : of the strongest returns that are outliers; None: as the drive has it

    Raises
    ------
    FilterError
        If there is no such form, or the drive cannot have such a share.

    """
    if name not in FORMS:
        raise FilterError('the form', f'one of {", ".join(FORMS)}', name)
    yield from send(FORMS[name], seed, draw, share)


def send(
    form: Form, seed: int, draw: Callable[[int], Drive], share: float | None = None
) -> Iterator[Cloud]:
    """Do as :func:`form_clouds`, in any form."""
    seen = _seen(draw, seed, form.drive, share, own=form.own, heads=form.heads, echoes=form.echoes)
    together = form.together or seen.shots_per_line
    clock = seen.shot // together * together * seen.interval + seen.late
    clock -= clock % form.tick
    turn, frame = seen.shot // seen.shots_per_line, OWN_FRAME if form.own else FRAME
    for number, (begin, end) in enumerate(pairwise([0, *_ends(form, seen, seed)])):
        inside = slice(*np.searchsorted(seen.time, (begin, end)))
        part = MessagePart(
            points=seen.points[inside],
            shot=seen.shot[inside],
            head=seen.head[inside],
            echo=seen.echo[inside],
            t=clock[inside],
            begin=begin - begin % form.tick,
            number=number,
            turn=turn[inside],
            first=begin // (seen.interval * seen.shots_per_line),
        )
        rows = _rows(form, part)
        if form.rows:
            rows = _organised(rows, part, (form.turns, seen.shots_per_line))
        yield Cloud(START + part.begin, START + end, rows, frame=frame)


def mapping(
    name: str,
    seed: int,
    share: float | None,
    progress: Callable[[float], object],
    form: str | None = None,
) -> Iterator[Cloud]:
    """Simulate one of ``STREETS`` in a form; None: two heads, each with second echoes and a topic.

    Of a share, second echoes count as well.
    """
    draw = STREETS[name]
    if form is None:
        made = send(TWO_HEADS, seed, draw, share)
        made = (
            replace(cloud, points=cloud.points[cloud.points['head'] == head], topic=topic)
            for cloud in made
            for head, topic in enumerate(TOPICS)
        )
    else:
        made = form_clouds(form, seed, draw, share)
    drive = draw(seed)
    end = drive.shots * drive.sensor.interval
    for cloud in made:
        yield cloud
        progress((cloud.sent - START) / end)


class _DriveReturns(NamedTuple):
    """All N returns of a drive in the order of ``time``, nanoseconds; see :class:`MessagePart`.

    ``late`` is how much later the shots of a head come than those of the first, nanoseconds.
    """

    points: Rows
    time: Ints
    shot: Ints
    head: Ints
    echo: Ints
    late: Ints
    shots: int
    shots_per_turn: int
    shots_per_line: int
    interval: int


@lru_cache(maxsize=4)
def _seen(  # noqa: PLR0913  what makes the returns
    draw: Callable[[int], Drive],
    seed: int,
    kind: str,
    share: float | None,
    *,
    own: bool,
    heads: int,
    echoes: str,
) -> _DriveReturns:
    """Simulate what a drive measures."""
    base = draw(seed)
    drive = replace(DRIVES[kind](base), in_own_frame=own)
    sensor = _scanner(drive)
    parts: list[tuple[int, int, Returns]] = []
    for head in range(heads):
        turned = replace(sensor, yaw=-sensor.yaw if head else sensor.yaw)
        one = replace(drive, sensor=turned, seed=drive.seed + head)
        block = gather(one)
        first = merge(block.clean, block.spoilt) if share is None else about(block, share)
        parts += [(head, echo, some) for echo, some in _echoes(one, first, echoes)]
    returns, counts = join([part[2] for part in parts]), [len(part[2].shot) for part in parts]
    heads_of = np.repeat([part[0] for part in parts], counts)
    echoes_of = np.repeat([part[1] for part in parts], counts)
    late = heads_of * (sensor.interval // 2)
    time = returns.shot * sensor.interval + late
    order = np.lexsort((echoes_of, time))
    return _DriveReturns(
        points=returns.points[order],
        time=time[order],
        shot=returns.shot[order],
        head=heads_of[order],
        echo=echoes_of[order],
        late=late[order],
        shots=drive.shots,
        shots_per_turn=_scanner(base).shots_per_line,
        shots_per_line=sensor.shots_per_line,
        interval=sensor.interval,
    )


def _echoes(drive: Drive, first: Returns, echoes: str) -> Iterator[tuple[int, Returns]]:
    """Yield the returns of the shots: their first ones, their second ones, with their number."""
    yield 1, first
    if echoes == 'second':
        yield 2, second_echoes(drive, first.shot)
    elif echoes == 'copies':
        lot = np.random.default_rng([drive.seed, STREAM, 1]).random(len(first.shot))
        yield 2, first.take(lot < COPIED)


def _ends(form: Form, seen: _DriveReturns, seed: int) -> list[int]:
    """Return when each message ends, nanoseconds after the first shot."""
    end = seen.shots * seen.interval
    if form.turns or form.packet:
        # A packet holds the shots of all heads.
        step = form.packet // form.heads or form.turns * seen.shots_per_turn
        return [*range(step * seen.interval, end, step * seen.interval), end]
    rng = np.random.default_rng([seed, STREAM, 2])
    most = int(LONGEST_ODD * seen.shots_per_turn)
    ends = np.cumsum(rng.integers(1, most, 2 * seen.shots // most + 100)) * seen.interval
    return [*ends[ends < end].tolist(), end]


def _rows(form: Form, part: MessagePart) -> Rows:
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


def _organised(rows: Rows, part: MessagePart, shape: tuple[int, int]) -> Rows:
    """Put the shots of each turn into a row; those without echo are NaN."""
    table = np.zeros(shape, rows.dtype)
    for axis in 'xyz':
        table[axis] = np.nan
    table[part.turn - part.first, part.shot % shape[1]] = rows
    return table
