# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The tuner learns from points that are moved as the filter moves them."""

from pathlib import Path

import numpy as np
import pytest
from helpers.profile_scanner import (
    ANGLES,
    MAP,
    POSITION,
    REPLAYED,
    Drive,
    Moving,
    Recorded,
    WithoutFirstPoses,
    pose,
    rejected,
)
from rclpy.expand_topic_name import expand_topic_name
from scipy.spatial.transform import Rotation

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.topics import resolve
from lidar_outlier_filter.recordings.replay import replay
from lidar_outlier_filter.tuning.inject import Injection
from lidar_outlier_filter.tuning.training import together


@pytest.fixture(scope='module')
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """Record half a second."""
    return Recorded(tmp_path_factory.mktemp('motion'), Drive(0.5))


def test_points_are_moved_as_in_a_replay(recorded: Recorded, tmp_path: Path) -> None:
    """The tuner judges each point as the filter would, and not as without motion."""
    drive = recorded.drive
    data = recorded.training(REPLAYED)
    mine = data.judge(FilterParameters().changed(REPLAYED))
    expected = rejected(drive, Moving().run(drive.clouds(drive.own), drive.odometry()))
    np.testing.assert_array_equal(mine.rejected, expected)
    report = replay(recorded.bag, tmp_path / 'out', parameters=REPLAYED)
    assert report.topics[0].rejected == np.count_nonzero(mine.rejected)
    assert (data.refused, data.without_pose) == (0, 0)
    np.testing.assert_array_equal(data.bad, drive.wrong)
    still: dict[str, object] = {**REPLAYED, 'motion.source': 'none'}
    without_pose = recorded.training(still).judge(FilterParameters().changed(still))
    assert np.count_nonzero(without_pose.rejected != expected) > 50


def test_clouds_without_poses_are_judged_apart(tmp_path: Path) -> None:
    """Clouds before the first pose are judged in their own frame, as in a replay."""
    recorded = Recorded(tmp_path, WithoutFirstPoses(0.6))
    data = recorded.training(REPLAYED)
    assert data.without_pose == 3
    assert together([data, data]).without_pose == 6
    report = replay(recorded.bag, tmp_path / 'out', parameters=REPLAYED)
    parameters = FilterParameters().changed(REPLAYED)
    assert report.topics[0].rejected == np.count_nonzero(data.judge(parameters).rejected)
    seen = np.arange(len(data)) % 3 > 0
    score = data.judge(parameters, seen).score
    assert np.isnan(score[~seen]).all()
    assert not np.isnan(score[seen]).all()


def test_injected_points_keep_their_distance(recorded: Recorded) -> None:
    """An injected point is where the sensor would have seen it from where it was at its time."""
    data = recorded.training(REPLAYED, injection=Injection(share=0.02))
    assert np.count_nonzero(data.bad) > 500
    t = recorded.drive.t.astype(np.float64) * 1e-9
    position, rotation = pose(t)
    eye = position + rotation.apply(POSITION) + MAP
    xyz = np.concatenate([cloud.xyz for cloud in data.clouds])
    distance = np.concatenate([cloud.range for cloud in data.clouds])
    # Poses are interpolated between those of every 10 ms.
    np.testing.assert_allclose(distance, np.linalg.norm(xyz - eye, axis=1), atol=0.02)
    own = np.concatenate([cloud.in_own_frame.xyz for cloud in data.clouds])
    mounting = Rotation.from_euler('xyz', ANGLES)
    expected = (rotation * mounting).inv().apply(xyz - eye)
    np.testing.assert_allclose(own, expected, rtol=1e-3, atol=0.02)


@pytest.mark.parametrize('topic', ['odom', '/odom', '~/odom', 'a/b', '/a/b'])
def test_names_of_topics(topic: str) -> None:
    """They are those that ROS gives the node."""
    assert resolve(topic) == expand_topic_name(topic, 'outlier_filter_node', '/')


def test_command_says_what_was_not_moved(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Clouds without poses are said of."""
    recorded = Recorded(tmp_path, WithoutFirstPoses(0.6))
    given: dict[str, object] = {**REPLAYED, 'chain': '[sor]'}
    words = [word for name, value in given.items() for word in ('--set', f'{name}={value}')]
    words += ['--labels', str(recorded.labels), '--folds', '2']
    words += ['--keep', 'sor.radius', '--keep', 'sor.min_neighbors']
    assert main(['tune', str(recorded.bag), *words, '--output', str(tmp_path / 'tuned.yaml')]) == 0
    printed = capsys.readouterr()
    assert '3 of its clouds had no poses, and were judged in their own' in printed.out + printed.err
