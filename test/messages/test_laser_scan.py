# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""2-D scans: the points of laser_geometry, and verdicts in scans of the same shape."""

import copy
import itertools
import math
import struct
from typing import Any

import numpy as np
import pytest
from helpers import ROOT
from helpers.clouds import STORE
from helpers.laser_scans import Scanner
from helpers.profile_scanner import odometry
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import LaserScan, MultiEchoLaserScan

from lidar_outlier_filter import CloudFilter, detect_outliers
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_filter.messages.laser_scan import as_cloud
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.parameters.yaml_files import read_yaml
from lidar_outlier_filter.pipeline.motion import Odometry
from lidar_outlier_filter.pipeline.pipeline import Pipeline, SplitCloud

SCANNER = Scanner()
NUMBERS = tuple(
    name for name in LaserScan.get_fields_and_field_types() if name not in {'ranges', 'intensities'}
)


def project_laser(msg: LaserScan) -> dict[int, tuple[float, ...]]:
    """Project as projectLaser_ of laser_geometry 2.10 does: x, y, z, stamp of each range it keeps.

    https://github.com/ros-perception/laser_geometry/blob/rolling/src/laser_geometry.cpp
    """

    def single(value: float) -> float:
        return float(struct.unpack('f', struct.pack('f', value))[0])

    found: dict[int, tuple[float, ...]] = {}
    for i, distance in enumerate(msg.ranges):
        angle = msg.angle_min + float(i) * msg.angle_increment
        if distance < msg.range_max and distance >= single(msg.range_min):
            x, y = distance * math.cos(angle), distance * math.sin(angle)
            found[i] = single(x), single(y), 0.0, i * msg.time_increment
    return found


def run(messages: list[Any], parameters: Any = None) -> tuple[CloudFilter, list[SplitCloud]]:
    """Filter a stream; refused scans have no output."""
    stream, outputs = CloudFilter(parameters), []
    for msg in messages:
        try:
            outputs += stream.push(msg)
        except CloudError as err:
            assert ' must be ' in str(err)  # noqa: PT017
    return stream, outputs + stream.flush()


def flat(ranges: Any) -> Any:
    """Return all ranges."""
    if len(ranges) and hasattr(ranges[0], 'echoes'):
        return np.concatenate([np.asarray(beam.echoes, np.float32) for beam in ranges])
    return np.asarray(ranges, np.float32)


def test_points_are_those_of_laser_geometry() -> None:
    """To the bit; every other range is a missing return. Times are those of the shots."""
    msg = SCANNER.scan(3)
    expected = project_laser(msg)
    points = Decoder(FilterParameters()).decode(as_cloud(msg))
    assert np.flatnonzero(points.valid).tolist() == list(expected)
    assert 500 < len(expected) < SCANNER.shots - 5
    found = np.array(list(expected.values()))
    assert (points.xyz[points.valid] == found[:, :3]).all()
    begin = msg.header.stamp.sec * 10**9 + msg.header.stamp.nanosec
    assert (points.t[points.valid] - begin == np.rint(found[:, 3] * 1e9)).all()


def test_echoes_of_a_shot_have_its_direction_and_time() -> None:
    """As if each echo were a scan of its own."""
    msg = SCANNER.several_echoes(1)
    points = Decoder(FilterParameters()).decode(as_cloud(msg))
    beam = np.repeat(np.arange(SCANNER.shots), [len(one.echoes) for one in msg.ranges])
    angle = msg.angle_min + beam * msg.angle_increment
    valid = points.valid
    assert np.allclose(np.arctan2(points.xyz[:, 1], points.xyz[:, 0])[valid], angle[valid])
    assert np.allclose(points.range[valid], flat(msg.ranges)[valid])
    assert (
        np.unique(points.t[valid], return_inverse=True)[1]
        == np.unique(beam[valid], return_inverse=True)[1]
    ).all()


def test_shots_are_placed_by_their_own_times() -> None:
    """Where the vehicle moves, as points of a cloud are."""
    parameters, speed = FilterParameters().changed({'motion.source': 'odometry'}), 20.0
    motion = Odometry(parameters)
    stream, seen = Pipeline(parameters, motion=motion), []
    stream.show.append(lambda cloud, _: seen.append(cloud.points.xyz))
    for t in np.arange(-0.1, 0.2, 0.01).tolist():
        motion.take(odometry(t, [speed * t, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]))
    stream.process(SCANNER.scan(0))
    stream.flush()
    expected = np.array(list(project_laser(SCANNER.scan(0)).values()))
    expected[:, 0] += speed * expected[:, 3]
    assert np.allclose(seen[0], expected[:, :3], atol=1e-6)


@pytest.mark.parametrize('make', [SCANNER.scan, SCANNER.several_echoes])
def test_every_range_is_in_one_of_both(make: Any) -> None:
    """Bit for bit, NaN in the other; all else is kept, and what is rejected strays."""
    messages = [make(number) for number in range(20)]
    before = [serialize_message(msg) for msg in messages]
    _, outputs = run(messages)
    assert [serialize_message(msg) for msg in messages] == before
    found, stray = 0, 0
    for number, (msg, output) in enumerate(zip(messages, outputs, strict=True)):
        given, kept, rejected = (flat(one.ranges) for one in (msg, output.cleaned, output.outliers))
        out = ~np.isnan(rejected)
        assert np.isnan(kept[out]).all()
        assert (np.where(out, rejected, kept).view('u4') == given.view('u4')).all()
        for part in (output.cleaned, output.outliers):
            assert all(getattr(part, name) == getattr(msg, name) for name in NUMBERS)
            assert part.intensities == msg.intensities
            assert type(part) is type(msg)
            whole = deserialize_message(serialize_message(part), type(msg))
            assert (flat(whole.ranges).view('u4') == flat(part.ranges).view('u4')).all()
        if make == SCANNER.scan:
            _, strays = SCANNER.ranges(number)
            found, stray = found + int((out & strays).sum()), stray + int(strays.sum())
            assert np.count_nonzero(out & ~strays) <= 2
    assert found >= 0.9 * stray


def test_messages_of_rosbags_serve_alike() -> None:
    """With arrays of NumPy in them, and to the same bytes."""
    for kind, make in ((LaserScan, SCANNER.scan), (MultiEchoLaserScan, SCANNER.several_echoes)):
        data = [serialize_message(make(number)) for number in range(8)]
        name = f'sensor_msgs/msg/{kind.__name__}'
        others = [STORE.deserialize_cdr(one, name) for one in data]
        _, of_ros = run([deserialize_message(one, kind) for one in data])
        _, of_rosbags = run(others)
        for one, other in zip(of_ros, of_rosbags, strict=True):
            for part, same in ((one.cleaned, other.cleaned), (one.outliers, other.outliers)):
                assert serialize_message(part) == bytes(STORE.serialize_cdr(same, name))


def changed(**values: Any) -> LaserScan:
    """Make a scan that is not right."""
    msg = copy.copy(SCANNER.scan(0))
    for name, value in values.items():
        setattr(msg, f'_{name}', value)
    return msg


BROKEN = [
    (
        {'ranges': SCANNER.scan(0).ranges[:400]},
        'the ranges of a scan must be as many as steps from',
    ),
    (
        {'intensities': SCANNER.scan(0).intensities[:-1]},
        'intensities of a scan must be one for each of',
    ),
    ({'ranges': [1.0] * 100_001}, 'the ranges of a scan must be of at most 100000 shots'),
    ({'angle_min': math.nan}, 'angle_min of a scan must be finite, got nan'),
    ({'angle_min': 1e30}, 'angle_min and angle_max of a scan must be within a turn'),
    ({'angle_increment': 0.0}, 'angle_increment of a scan must be not 0, and 541 ranges'),
    ({'angle_increment': 0.1}, 'angle_increment of a scan must be not 0, and 541 ranges'),
    ({'angle_increment': -float(SCANNER.scan(0).angle_increment)}, 'about -540, got 541'),
    ({'angle_min': 2.0, 'angle_max': -2.0}, 'about -458, got 541'),
    ({'time_increment': -1e-5}, 'time_increment of a scan must be from 0 on'),
    ({'time_increment': math.inf}, 'time_increment of a scan must be finite, got inf'),
    ({'time_increment': 1e30}, 'time_increment of a scan must be from 0 on'),
    ({'time_increment': 1e3}, 'the time that a cloud spans must be at most'),
    ({'range_min': -0.1}, 'range_min of a scan must be 0 or more, and below range_max'),
    ({'range_min': 0.0, 'range_max': 0.0}, 'and below range_max, got 0 and 0 m'),
]


@pytest.mark.parametrize(('values', 'sentence'), BROKEN)
def test_what_no_scanner_says_is_refused(values: dict[str, Any], sentence: str) -> None:
    """In one sentence; it is counted, and the stream goes on as if it had not been."""
    stream = CloudFilter()
    with pytest.raises(CloudError) as err:
        stream.push(changed(**values))
    assert sentence in str(err.value)
    messages = [SCANNER.scan(number) for number in range(1, 6)]
    stream, outputs = run([messages[0], changed(**values), *messages[1:]])
    assert stream.statistics.refused == 1
    _, without = run(messages)
    for one, other in zip(outputs, without, strict=True):
        assert serialize_message(one.cleaned) == serialize_message(other.cleaned)


def test_what_scanners_do_say_is_not() -> None:
    """No times of shots, no upper limit, no range, an angle more; clockwise, as upside down."""
    back = {
        name: -getattr(SCANNER.scan(0), name)
        for name in ('angle_min', 'angle_max', 'angle_increment')
    }
    for values in (
        {'time_increment': 0.0},
        {'range_max': math.inf, 'scan_time': math.nan},
        {'ranges': SCANNER.scan(0).ranges[:0], 'intensities': SCANNER.scan(0).intensities[:0]},
        {'angle_max': SCANNER.scan(0).angle_max + SCANNER.scan(0).angle_increment},
        back,
    ):
        stream, outputs = run([changed(**values)])
        assert stream.statistics.refused == 0
        assert len(outputs[0].cleaned.ranges) == len(outputs[0].outliers.ranges)


def test_parameters_that_clouds_have() -> None:
    """Names of fields do not matter here; no score is added, which is said; a scan keeps all."""
    messages = [SCANNER.scan(number) for number in range(6)]
    _, expected = run(messages)
    said: list[str] = []
    other = {'time_field': 'no', 'time_unit': 'us', 'missing': 'drop', 'scores': True}
    stream = CloudFilter(other, warn=said.append)
    outputs = [one for msg in messages for one in stream.push(msg)] + stream.flush()
    assert said == ['scans have no room for scores, which are left out']
    assert stream.statistics.dropped == 0
    for one, same in zip(outputs, expected, strict=True):
        assert serialize_message(one.cleaned) == serialize_message(same.cleaned)


# Of the page: scans per second, shots and degrees between them; parameters.
FAST = [(15, 541, 0.5), (25, 1081, 0.25), (50, 541, 0.5)]
SLOWER = [(10, 361, 1.0), (10, 721, 0.5), (10, 1081, 0.25)]
CONFIG = read_yaml(ROOT / 'config' / 'laser_scan.yaml')
ROWS: dict[str, tuple[list[tuple[int, int, float]], dict[str, Any]]] = {
    '15 to 50 scans/s, 0.25° to 0.5° | the default': (FAST, {}),
    '15 to 50 scans/s, 0.25° to 0.5° | `config/laser_scan.yaml`': (FAST, CONFIG),
    '10 scans/s, 0.25° to 1° | the default': (SLOWER, {}),
    '10 scans/s, 0.25° to 1° | `config/laser_scan.yaml`': (SLOWER, CONFIG),
    '5 scans/s, 1° | the default': ([(5, 361, 1.0)], {}),
    '5 scans/s, 1° | `config/laser_scan.yaml`, `halo: 0.4`': (
        [(5, 361, 1.0)],
        CONFIG | {'halo': 0.4},
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize('row', ROWS)
def test_figures_of_the_page(row: str) -> None:
    """Of 60 scans each, standing, and at 0.5 and 1.5 m/s: the least and the most."""
    found, lost = [], []
    kinds, parameters = ROWS[row]
    for kind, speed in itertools.product(kinds, (0.0, 0.5, 1.5)):
        scanner = Scanner(*kind, speed)
        _, outputs = run([scanner.scan(number) for number in range(60)], parameters)
        out = np.concatenate([~np.isnan(flat(one.outliers.ranges)) for one in outputs])
        stray = np.concatenate([scanner.ranges(number)[1] for number in range(60)])
        found.append(np.count_nonzero(out & stray) / np.count_nonzero(stray))
        lost.append(np.count_nonzero(out & ~stray) / np.count_nonzero(~stray))
    cells = f'{min(found):.0%} to {max(found):.0%}', f'{min(lost):.2%} to {max(lost):.2%}'
    line = f'| {row} | {" | ".join(cells)} |'.replace('%', ' %')
    assert line in (ROOT / 'doc' / 'live.md').read_text('utf-8')


def test_a_single_scan() -> None:
    """The library judges one, too."""
    verdict = detect_outliers(SCANNER.scan(2))
    _, stray = SCANNER.ranges(2)
    assert len(verdict) == SCANNER.shots
    assert np.count_nonzero(verdict.outlier & stray) >= 0.5 * np.count_nonzero(stray)


SINGLES = st.floats(width=32)


@given(
    st.fixed_dictionaries({}, optional=dict.fromkeys(NUMBERS[1:], SINGLES)),
    st.lists(SINGLES, max_size=12),
    st.booleans(),
)
def test_anything(values: dict[str, float], ranges: list[float], bright: bool) -> None:  # noqa: FBT001
    """Processed in full, or refused in one sentence."""
    count = len(ranges)
    fits = {'angle_min': 0.0, 'angle_max': 0.1 * (count - 1), 'angle_increment': 0.1}
    arrays = {
        'ranges': np.array(ranges, 'f4'),
        'intensities': np.array(ranges[: count * bright], 'f4'),
    }
    msg: Any = STORE.deserialize_cdr(
        serialize_message(SCANNER.scan(0)), 'sensor_msgs/msg/LaserScan'
    )
    vars(msg).update({**fits, **values, **arrays})
    stream, outputs = run([msg], {'chain': ['sor']})
    assert len(outputs) + stream.statistics.refused == 1
    for one in outputs:
        out = ~np.isnan(one.outliers.ranges)
        both = np.where(out, one.outliers.ranges, one.cleaned.ranges)
        assert (both.view('u4') == msg.ranges.view('u4')).all()
