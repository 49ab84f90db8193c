# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A profile scanner in its own frame is filtered as well as its georeferenced twin."""

from collections.abc import Iterable, Mapping
from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest
from helpers.clouds import SECOND, STAMP, cloud, table
from helpers.nodes import Ros
from helpers.profile_scanner import MOVING, SHOTS, SOR, Drive, Moving, rejected, seconds
from helpers.scans import sweep
from nav_msgs.msg import Odometry as OdometryMessage
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2

from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.pipeline import Pipeline, SplitCloud


def still(
    clouds: Iterable[PointCloud2], extra: Mapping[str, object] | None = None
) -> list[SplitCloud]:
    """Filter clouds as they are."""
    clean = Pipeline(FilterParameters().changed({**SOR, **(extra or {})}))
    outputs = [output for msg in clouds for output in clean.process(msg, msg)]
    return outputs + clean.flush()


def f1(drive: Drive, found: NDArray[np.bool_]) -> float:
    """Return the harmonic mean of precision and recall."""
    hits = np.count_nonzero(found & drive.wrong)
    return float(2 * hits / (np.count_nonzero(found) + np.count_nonzero(drive.wrong)))


def test_as_good_as_the_georeferenced_twin() -> None:
    """The same points in both frames: the same verdicts; without motion they are much worse."""
    drive = Drive(1.0)
    own = drive.clouds(drive.own)
    moving = Moving()
    found = rejected(drive, moving.run(own, drive.odometry()))
    twin = rejected(drive, still(drive.clouds(drive.fixed)))
    without_pose = rejected(drive, still(own))
    assert moving.filter.statistics.without_pose == 0
    # Between the poses, 10 ms apart, the vehicle of the simulation does not move quite so evenly.
    assert np.count_nonzero(found != twin) <= 2
    assert f1(drive, twin) > 0.97
    assert f1(drive, found) > f1(drive, twin) - 0.002
    assert f1(drive, without_pose) < f1(drive, twin) - 0.1


def spinning(cuts: int) -> list[PointCloud2]:
    """Return three turns of a spinning sensor in so many clouds."""
    points = sweep(3, 0.1, 3.0, columns=240)
    start = int(points.t.min())
    columns: dict[str, Any] = {axis: ('f8', points.xyz[:, k]) for k, axis in enumerate('xyz')}
    columns['intensity'] = ('u1', points.line * 7 + points.t // 1000 % 11)
    rows = table(len(points), ring=('u2', points.line), t=('u4', points.t - start), **columns)
    rows = rows[np.argsort(rows['t'], kind='stable')]
    messages = []
    for part in np.array_split(rows, cuts):
        first = int(part['t'][0])
        part['t'] -= first
        messages.append(cloud(part, STAMP + first))
    return messages


@pytest.mark.parametrize(('cuts', 'delay'), [(3, 0.0), (1, 0.05), (41, 0.25)])
def test_spinning_sensor_is_judged_by_its_own_angles(cuts: int, delay: float) -> None:
    """The same verdicts with motion as without, byte for byte, and however clouds are cut."""
    boosted_trees = {'chain': ('boosted_trees',), 'scores': True}
    moving = Moving(boosted_trees)
    outputs = moving.run(spinning(cuts), Drive(0.4).odometry(), delay)
    assert moving.filter.statistics.without_pose == 0
    found = b''.join(bytes(output.outliers.data) for output in outputs)
    assert len(outputs) == cuts
    assert found == b''.join(
        bytes(one.outliers.data) for one in still(spinning(cuts), boosted_trees)
    )
    assert sum(output.outliers.width for output in outputs) > 100


def test_range_is_the_distance_from_the_sensor() -> None:
    """What grows with the range grows with that from the sensor, not from the map's origin."""
    drive = Drive(0.5)
    extra = {'sor.range_scaled': True, 'sor.range_factor': 0.1}
    found = rejected(drive, Moving(extra).run(drive.clouds(drive.own), drive.odometry()))
    assert np.count_nonzero(found) > 0
    # From the origin of the map nothing is near: its radius is 500 km, and nobody is alone.
    assert not rejected(drive, still(drive.clouds(drive.fixed), extra)).any()


def test_a_cloud_waits_for_its_poses() -> None:
    """Until the last one is there, and all behind it wait, too."""
    drive = Drive(0.5)
    clouds, odometry = drive.clouds(drive.own), drive.odometry()
    moving = Moving()
    assert [moving.filter.process(msg, msg) for msg in clouds] == [[]] * 5
    assert moving.filter.pending == 5
    assert moving.filter.oldest is clouds[0]
    outputs = []
    for msg in odometry:
        moving.motion.take(msg)
        made = moving.filter.advance()
        outputs += made
        # Block and halo of a cloud of 0.1 s end with the poses of the next one.
        assert len(outputs) <= max(0, (seconds(msg) + 1e-6) / 0.1 - 1)
    assert [output.tag for output in outputs] == clouds[:4]
    outputs += moving.filter.flush()
    assert (rejected(drive, outputs) == rejected(drive, Moving().run(clouds, odometry))).all()
    assert moving.filter.statistics.without_pose == 0


def test_without_odometry_no_cloud_waits_longer_than_max_delay() -> None:
    """By the time of the points: in a replay nobody else would let it go."""
    drive = Drive(1.0)
    clouds = drive.clouds(drive.own)
    moving = Moving({'max_delay': 0.45})
    counts = [len(moving.filter.process(msg, msg)) for msg in clouds]
    # A cloud goes on when one ends that is 0.5 s later, and is judged with the next one.
    assert counts == [0] * 6 + [1] * 4
    outputs = moving.filter.flush()
    assert len(outputs) == 6
    assert moving.filter.statistics.without_pose == 10


def test_max_delay_at_run_time() -> None:
    """Clouds that wait for their poses wait no longer than what is set meanwhile."""
    drive = Drive(1.0)
    moving = Moving({'max_delay': 60.0})
    *first, last = drive.clouds(drive.own)
    assert [moving.filter.process(msg, msg) for msg in first] == [[]] * 9
    parameters = FilterParameters().changed({**MOVING, 'max_delay': 60.0})
    moving.filter.change(parameters.changed({'max_delay': 0.45}))
    assert len(moving.filter.process(last, last)) == 4


def test_released_clouds_take_no_room() -> None:
    """Twice as many points as may be held pass, as long as they do not wait at once."""
    drive = Drive(1.0)
    moving = Moving({'max_points': 5 * 10 * SHOTS})
    assert len(moving.run(drive.clouds(drive.own), drive.odometry(), 0.1)) == 10
    assert moving.filter.statistics.refused == 0


def test_a_cloud_without_points_waits_for_no_pose() -> None:
    """Also at the very beginning."""
    drive = Drive(0.1)
    moving = Moving()
    (msg,) = drive.clouds(np.full_like(drive.own, np.nan))
    assert [output.tag for output in moving.filter.process(msg, msg)] == [msg]


def gapped(drive: Drive) -> tuple[list[OdometryMessage], NDArray[np.bool_]]:
    """Leave poses out; return the others, and which points of the drive have none around them."""
    odometry = [msg for msg in drive.odometry() if not 0.33 < seconds(msg) < 0.55]
    t = np.array([msg.header.stamp.sec * SECOND + msg.header.stamp.nanosec for msg in odometry])
    t -= STAMP
    before = np.searchsorted(t, drive.t, side='right') - 1
    return odometry, (t[before + 1] - t[before] > SECOND // 10) & (t[before] != drive.t)


def test_points_with_and_without_poses_are_judged_apart() -> None:
    """A gap in the odometry: its points are judged in their own frame, as if by themselves."""
    drive = Drive(1.0)
    odometry, lost = gapped(drive)
    moving = Moving({'motion.max_gap': 0.1})
    found = rejected(drive, moving.run(drive.clouds(drive.own), odometry))
    assert moving.filter.statistics.without_pose == 3
    assert np.count_nonzero(lost) == pytest.approx(0.22 * len(lost), abs=SHOTS)
    for part, xyz in ((lost, drive.own), (~lost, drive.fixed)):
        no_return = np.where(part[:, None], xyz, 0.0)
        alone = rejected(drive, still(drive.clouds(no_return)))
        assert np.count_nonzero(alone) > 0
        # A mixture would hide the outliers of some, or reject the good points of others.
        assert np.count_nonzero((found != alone)[part]) <= (0 if part is lost else 2)


@pytest.mark.parametrize('lines', [1, 3, 37, 100])
def test_a_gap_decides_for_each_point(lines: int) -> None:
    """The same points are moved, and get the same verdicts, however they are cut into clouds."""
    drive = Drive(1.0)
    odometry, _ = gapped(drive)
    # No pose of the last 0.1 s, either: nothing that is cut elsewhere may wait for another's.
    odometry = [msg for msg in odometry if 0.1 < seconds(msg) < 0.9]
    extra = {'motion.max_gap': 0.1}
    expected = rejected(drive, Moving(extra).run(drive.clouds(drive.own), odometry))
    found = rejected(drive, Moving(extra).run(drive.clouds(drive.own, lines), odometry, 0.05))
    assert np.count_nonzero(expected) > 0
    assert np.count_nonzero(found != expected) == 0


def test_refused_when_its_turn_has_come() -> None:
    """A cloud that is late is refused behind those before it, counted and said of."""
    drive = Drive(0.6)
    clouds = drive.clouds(drive.own)
    moving = Moving()
    result: list[str] = []
    moving.filter.refuse = lambda err: result.append(str(err))
    for msg in [*clouds, clouds[0]]:
        assert moving.filter.process(msg, msg) == []
    for msg in drive.odometry():
        moving.motion.take(msg)
    outputs = moving.filter.advance()
    assert result != []
    outputs += moving.filter.flush()
    assert [output.tag for output in outputs] == clouds
    assert moving.filter.statistics.refusals == {'the time of a cloud': 1}
    (sentence,) = result
    assert sentence.startswith('the time of a cloud must be at or after what is judged already')


def test_poses_that_make_no_sense_are_counted() -> None:
    """By what was wrong with them; the others serve."""
    drive = Drive(0.2)
    odometry = drive.odometry()
    odometry[5].pose.pose.orientation.w = np.nan
    odometry[7].header.stamp = odometry[3].header.stamp
    moving = Moving()
    moving.run(drive.clouds(drive.own), odometry)
    assert moving.filter.statistics.poses == {'a pose': 1, 'the time of a pose': 1}
    assert moving.filter.statistics.without_pose == 0


def test_a_recording_that_loops() -> None:
    """Clouds and odometry go back: what waits is let go, and the second loop is like the first."""
    drive = Drive(0.5)
    extra = {'time_jump': 0.2}
    clouds, odometry = drive.clouds(drive.own), drive.odometry()
    moving = Moving(extra)
    first = moving.filter.process(clouds[4], clouds[4])
    assert first == []
    assert len(moving.filter.process(clouds[0], clouds[0])) == 1  # without poses
    assert (moving.filter.statistics.without_pose, moving.filter.statistics.resets) == (1, 1)
    moving.filter.flush()
    loops = [moving.run(clouds, odometry) for _ in range(2)]
    assert [len(loop) for loop in loops] == [5, 5]
    assert (rejected(drive, loops[0]) == rejected(drive, loops[1])).all()


def looped(drive: Drive) -> tuple[Moving, list[PointCloud2], list[OdometryMessage]]:
    """Serve one loop of a recording: the poses of its clouds stay."""
    moving = Moving({'time_jump': 0.2, 'max_delay': 0.45})
    clouds, odometry = drive.clouds(drive.own), drive.odometry()
    for msg in odometry:
        moving.motion.take(msg)
    for msg in clouds:
        moving.filter.process(msg, msg)
    assert moving.filter.statistics.without_pose == 0
    return moving, clouds, odometry


@pytest.mark.parametrize('by_node', [False, True])
def test_poses_do_not_survive_a_clock_that_was_set_back(
    monkeypatch: pytest.MonkeyPatch, *, by_node: bool
) -> None:
    """A cloud of the next loop waits for the poses of the next loop, and is moved by them."""
    drive = Drive(0.5)
    moving, clouds, odometry = looped(drive)
    if by_node:
        assert len(moving.filter.reset()) == 1
    outputs = moving.filter.process(clouds[0], clouds[0])
    assert len(outputs) == (0 if by_node else 1)
    assert moving.filter.pending == 1
    assert moving.filter.advance() == []
    # Elsewhere this time: 50 m to the right.
    for msg in odometry:
        msg.pose.pose.position.y -= 50
    positions: list[float] = []
    chain = moving.filter._blocks.chain
    judge = chain.judge

    def note_and_judge(points: Points) -> Verdict:
        positions.append(float(points.xyz[:, 1].mean()))
        return judge(points)

    monkeypatch.setattr(chain, 'judge', note_and_judge)
    for msg in odometry:
        moving.motion.take(msg)
        moving.filter.advance()
    assert len(moving.filter.flush()) == 1
    assert moving.filter.statistics.without_pose == 0
    assert positions == [pytest.approx(drive.fixed[: 10 * SHOTS, 1].mean() - 50, abs=0.1)]
    assert moving.filter.statistics.resets == 1


def test_tf_needs_its_messages(ros: Ros) -> None:
    """Where tf2_msgs is not installed, the node is not made, and says why."""
    if find_spec('tf2_msgs') is None:
        sentence = (
            "motion.source must be 'none' or 'odometry' where tf2_msgs is not installed, got 'tf'"
        )
        with pytest.raises(ParameterError, match=f'^{sentence}$'):
            ros.filter('-p', 'motion.source:=tf')
    else:
        ros.filter('-p', 'motion.source:=tf')
