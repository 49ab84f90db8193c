# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A mask from a recording, and back into a replay."""

from pathlib import Path

import numpy as np
import pytest
from helpers.clouds import cloud
from helpers.drives import write_messages
from helpers.own_vehicle import stamp, turn
from helpers.profile_scanner import MAP, Drive, nanoseconds
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from rosbags.typesys import Stores, get_typestore

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.core.points.mask import read_mask
from lidar_outlier_filter.errors import FilterError, ParameterError, RecordingError
from lidar_outlier_filter.messages.cloud import structured
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.topics import CLOUD, ODOMETRY
from lidar_outlier_filter.recordings.bags import Recording
from lidar_outlier_filter.recordings.own_vehicle import learn_mask
from lidar_outlier_filter.recordings.replay import replay

TURNS = 14


def record(
    path: Path,
    *,
    moves: bool = True,
    metres: float | None = None,
    parts: int = 1,
    turns: int = TURNS,
) -> Path:
    """Record turns, each cut into messages; with ``metres`` a turn, odometry too."""
    messages: list[tuple[str, int, bytes]] = []
    for number in range(turns + 1):
        time = stamp(number)
        if metres is not None:
            pose = Odometry()
            pose.header.stamp.sec, pose.header.stamp.nanosec = divmod(time, 10**9)
            pose.pose.pose.position.x = metres * number
            pose.pose.pose.orientation.w = 1.0
            messages.append(('/odom', time, serialize_message(pose)))
        rows = turn(number, place=None if moves else 0)
        cuts = np.array_split(rows, parts) if number < turns else ()
        messages += [('/lidar', time, serialize_message(cloud(some, time))) for some in cuts]
    odometry = {} if metres is None else {'/odom': ODOMETRY}
    return write_messages(path, {'/lidar': CLOUD, **odometry}, messages)


@pytest.mark.parametrize(('metres', 'parts'), [(None, 1), (1.2, 1), (None, 5)])
def test_learns_of_a_drive(metres: float | None, parts: int, tmp_path: Path) -> None:
    """A mask is learnt with odometry or by the scene, however turns were cut."""
    bag = record(tmp_path / 'drive', metres=metres, parts=parts)
    found = learn_mask(bag, FilterParameters())
    assert (found.topic, found.odometry) == ('/lidar', '' if metres is None else '/odom')
    assert found.turns == found.taken == TURNS
    assert found.mask.is_seen[2:12].any(axis=1).all()
    assert not found.mask.is_seen[12:].any()


@pytest.mark.parametrize('metres', [None, 0.01])
def test_a_vehicle_that_stands_is_refused(metres: float | None, tmp_path: Path) -> None:
    """Without movement no mask is learnt; odometry has precedence over the scene."""
    bag = record(tmp_path / 'stand', moves=metres is not None, metres=metres)
    with pytest.raises(RecordingError, match=f'got 1 of {TURNS}: the vehicle does not move'):
        learn_mask(bag, FilterParameters())


def test_what_cannot_be_learnt_of(tmp_path: Path) -> None:
    """Scan lines that are no rings, and a reach that no vehicle has."""
    bag = record(tmp_path / 'drive')
    by_message = FilterParameters().changed({'line_source': 'message'})
    with pytest.raises(FilterError, match='the rings of the sensor'):
        learn_mask(bag, by_message)
    for reach in (0.0, -1.0, 31.0, np.nan):
        with pytest.raises(RecordingError, match='the reach of the vehicle must be above 0'):
            learn_mask(bag, FilterParameters(), reach=reach)


@pytest.mark.parametrize('step', [0.7, 2.0])
def test_a_short_drive_is_not_said_to_stand(step: float, tmp_path: Path) -> None:
    """Too few turns are new places, but the vehicle moves."""
    bag = record(tmp_path / 'short', metres=step, turns=9)
    with pytest.raises(RecordingError, match=r'got [59] of 9: the drive is too short'):
        learn_mask(bag, FilterParameters())


@pytest.mark.parametrize('restarts', [False, True])
@pytest.mark.parametrize('with_odometry', [False, True])
@pytest.mark.parametrize('upright', [False, True])
def test_lines_of_a_profile_scanner_are_refused(
    tmp_path: Path, *, restarts: bool, with_odometry: bool, upright: bool
) -> None:
    """Their numbers run on, or restart in each message: no direction is a line and an azimuth.

    In the frame of the sensor, and in the map's.
    """
    drive = Drive(2.0)
    drive.line = drive.line % 10 if restarts else drive.line
    messages = [
        ('/lidar', nanoseconds(msg), serialize_message(msg))
        for msg in drive.clouds(drive.own if upright else drive.fixed - MAP)
    ]
    poses = drive.odometry() if with_odometry else []
    messages += [('/odom', nanoseconds(msg), serialize_message(msg)) for msg in poses]
    topics = {'/lidar': CLOUD} | ({'/odom': ODOMETRY} if with_odometry else {})
    bag = write_messages(tmp_path / 'drive', topics, sorted(messages, key=lambda one: one[1]))
    with pytest.raises(RecordingError, match='the rings of a sensor that spins, got lines '):
        learn_mask(bag, FilterParameters())


def test_command_and_replay(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The command writes a mask and its picture; a replay with it takes the vehicle out."""
    bag, mask, output = record(tmp_path / 'drive'), tmp_path / 'car.csv', tmp_path / 'cleaned'
    assert main(['mask', str(bag), '--output', str(mask)]) == 0
    said = capsys.readouterr().out
    assert '/lidar: 14 of 14 sweeps at new places (by the scene)' in said
    assert read_mask(mask).is_seen.any()
    assert (tmp_path / 'car.csv.png').read_bytes().startswith(b'\x89PNG')
    assert main(['mask', str(bag), '--output', str(mask)]) == 1  # never over another
    options = ['--set', f'mask={mask}', '--chain', 'sor']
    assert main(['replay', str(bag), '--output', str(output), *options]) == 0
    assert 'rejected by mask' in capsys.readouterr().out
    types = get_typestore(Stores.ROS2_JAZZY)
    found = own = 0
    with Recording(output) as source:
        for topic, _, data in source.messages():
            if topic.name == '/lidar/outliers':
                rows = structured(types.deserialize_cdr(data, CLOUD))
                found += int(np.count_nonzero(rows['own']))
            elif topic.name == '/lidar':
                own += int(np.count_nonzero(structured(types.deserialize_cdr(data, CLOUD))['own']))
    assert found == own > 0
    words = ['replay', str(bag), '--output', str(tmp_path / 'off'), '--set', 'mask=off']
    assert main([*words, '--chain', 'sor']) == 0


def test_one_mask_for_several_topics_is_refused(tmp_path: Path) -> None:
    """Each sensor sees the vehicle from elsewhere."""
    messages = [(name, stamp(0), serialize_message(cloud(turn(0)))) for name in ('/left', '/right')]
    write_messages(tmp_path / 'two', dict.fromkeys(('/left', '/right'), CLOUD), messages)
    with pytest.raises(ParameterError, match="mask must be 'off' for several topics"):
        replay(tmp_path / 'two', tmp_path / 'out', parameters={'mask': 'car.csv'})
