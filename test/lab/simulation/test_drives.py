# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The simulator is checked, not believed: every number it states is measured in what it makes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Floats, Rows
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation.truth import Cause, Kind
from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.recordings.bags import Recording
from lidar_outlier_lab import _kernels
from lidar_outlier_lab.simulation.scenes.demo_street import demo_drive
from lidar_outlier_lab.simulation.scenes.spinning_streets import SENSORS, dry_turn, rings
from lidar_outlier_lab.simulation.weather.beams import beams_of
from lidar_outlier_lab.simulation.world.drive import Disturbances, Drive, Returns, simulate
from lidar_outlier_lab.simulation.world.particles import Puff
from lidar_outlier_lab.simulation.world.prisms import L2, MID_40, MID_360, FreeScanner, refract
from lidar_outlier_lab.simulation.world.recording import clouds, messages, record, to_message
from lidar_outlier_lab.simulation.world.scene import Rays, Scene, box, ground
from lidar_outlier_lab.simulation.world.sensors import SpinningScanner
from lidar_outlier_lab.simulation.world.trajectory import Route, Trajectory, rotation

QUIET = Disturbances(reflection=0.0, near_surface=0.0)
SMOOTH = Trajectory(speed_change=0.0, bump=0.0, sway=0.0)
FLAT = Scene((ground(-500.0, 500.0, 500.0),))
STANDING = Route(((0.0, 0.0, 0.0),), (0.0, 0.0, 0.0), bump=0.0, tremble=0.0, mount=(0.0, 0.0, 1.9))
SMALL = SpinningScanner(elevation=rings(-20.0, 4.0, 4), columns=500, column_time=200_000)


def returns(drive: Drive) -> Returns:
    """Cast a whole drive."""
    blocks = [block for _, block in simulate(drive)]
    joined = Returns(*(np.concatenate(parts) for parts in zip(*blocks, strict=True)))
    assert len(joined.shot) == len(joined.points)
    return joined


def turning(scene: Scene = FLAT, sensor: SpinningScanner = SMALL, turns: int = 2) -> Drive:
    """Turn a sensor that stands in a scene."""
    return Drive(scene, turns, sensor, STANDING, QUIET, in_own_frame=True)


def position(points: Rows) -> Floats:
    """Coordinates (3, N)."""
    return np.stack([points[axis] for axis in 'xyz']).astype(np.float64)


def origins(drive: Drive, shot: NDArray[np.int64]) -> Floats:
    """Where the scanner was at each shot (3, N)."""
    return drive.rays(shot).origin[:, :, 0]


# What shots meet ----------------------------------------------------------------------------------


def test_puff_follows_beer_lambert() -> None:
    """As many rays are sent back as the optical depth says, and none beyond a wall."""
    puff = Puff((10.0, 0.0, 0.0), (0.5, 0.5, 0.5), density=0.8)
    count = 100_000
    rng = np.random.default_rng(1).random(count)
    direction = np.zeros((3, count, 1))
    direction[0] = 1.0
    rays = Rays(np.zeros((3, count, 1)), direction, np.zeros(count))
    far = puff.meet(rays, np.full(count, np.inf), np.zeros(count), rng)
    met = np.isfinite(far)
    share = -np.expm1(-0.8 * 0.5 * np.sqrt(2 * np.pi))
    assert met.mean() == pytest.approx(share, abs=0.005)
    assert far[met].mean() < 10.0  # the near side is met more often
    wall = puff.meet(rays, np.full(count, 9.8), np.ones(count), rng)
    np.testing.assert_array_equal(far[far < 9.8], wall[np.isfinite(wall)])


def test_noise_on_a_flat_road() -> None:
    """Residuals have the stated standard deviation at all ranges and incidences, and no bias."""
    drive = Drive(FLAT, lines=100, trajectory=SMOOTH, disturbances=QUIET)
    shot, points = returns(drive)
    eye = origins(drive, shot)
    measured = np.linalg.norm(position(points) - eye, axis=0)
    fall = -(position(points) - eye)[2] / measured
    true = eye[2] / fall
    assert (points['label'] == Cause.GOOD).all()
    residual = (measured - true) / drive.sensor.range_sigma(true, fall)
    for low, high in ((2.0, 3.0), (3.0, 6.0), (6.0, 12.0), (12.0, 40.0)):
        some = residual[(true >= low) & (true < high)]
        assert len(some) > 1000
        assert abs(some.mean()) < 4.0 / np.sqrt(len(some))
        assert some.std() == pytest.approx(1.0, abs=3.0 / np.sqrt(len(some)))
    near = true < 2.6  # straight below the vehicle, where the scan plane leans by 15°
    assert (measured - true)[near].std() == pytest.approx(0.0083, abs=0.0003)


def test_shares_of_outliers() -> None:
    """Reflections and near-surface noise come in the stated shares, at the stated heights."""
    how = Disturbances(reflection=0.02, near_surface=0.01)
    _, points = returns(Drive(FLAT, lines=100, trajectory=SMOOTH, disturbances=how))
    height = position(points)[2]
    for cause, share, (low, high) in (
        (Cause.REFLECTION, how.reflection, how.reflection_height),
        (Cause.NEAR_SURFACE, how.near_surface, how.near_surface_height),
    ):
        some = points['label'] == cause
        assert some.mean() == pytest.approx(share, abs=4 * np.sqrt(share / len(points)))
        assert (points['surface'][some] == Kind.AIR).all()
        assert low - 0.05 < height[some].min() < height[some].max() < high + 0.05


@pytest.mark.parametrize(('gap', 'mixes'), [(0.5, True), (3.0, False)])
def test_mixed_pixels_lie_between_surfaces(gap: float, *, mixes: bool) -> None:
    """Edges closer together than a pulse give points between them; farther apart, none."""
    front = box((-500.0, 5.0, 0.0), (500.0, 5.01, 3.0), Kind.FACADE)
    back = box((-500.0, 5.0 + gap, 0.0), (500.0, 9.0, 9.0), Kind.FACADE)
    _, points = returns(Drive(Scene((front, back)), lines=200, disturbances=QUIET))
    mixed = points['label'] == Cause.MIXED
    assert mixed.any() == mixes
    y = position(points)[1]
    assert ((y[mixed] > 5.01) & (y[mixed] < 5.0 + gap)).all()
    # Good points stay on the surfaces, but for noise along the ray.
    off = np.minimum(np.abs(y - 5.0), np.abs(y - 5.0 - gap))[~mixed]
    assert np.percentile(off, 99.9) < 0.06


def test_strongest_echo() -> None:
    """Of two groups of rays the larger one is measured, of equal ones the nearer."""
    inf = np.inf
    distance = np.array(
        [[9, 9, 9, 9, 9, 5, 5], [9, 9, 9, 5, 5, 5, inf], [inf] * 7, [7, 7.2, 7.6, 7.8, 7, 7, 7]]
    )
    mean, share = _kernels.strongest(distance, 0.8)
    np.testing.assert_allclose(mean, [9.0, 5.0, inf, 50.6 / 7])
    np.testing.assert_allclose(share, [5 / 7, 3 / 7, 0.0, 1.0])
    # Exactly a pulse apart is one echo still.
    mean, share = _kernels.strongest(np.array([[5.0, 5.5, 6.0], [5.0, 5.5, 6.1]]), 0.5)
    np.testing.assert_allclose(mean, [5.5, 5.25])


def test_mirrors_put_what_is_before_them_behind_them() -> None:
    """A pane mirrors a wall, a wet road what stands on it: at the whole distance, straight on."""
    pane = box((-500.0, 6.0, 0.0), (500.0, 6.1, 9.0), Kind.GLASS)
    wall = box((-500.0, -4.1, 0.0), (500.0, -4.0, 9.0), Kind.FACADE)
    drive = Drive(
        Scene((ground(-500.0, 500.0, 3.9), pane, wall)),
        lines=60,
        trajectory=Trajectory(start=(0.0, 0.0), bump=0.0, sway=0.0, speed_change=0.0),
        disturbances=replace(QUIET, glass=0.5, wet=1.0, mirrored=1.0),
    )
    shot, points = returns(drive)
    _, y, z = position(points)
    ghost, twice = (points['label'] == cause for cause in (Cause.GHOST, Cause.REFLECTION))
    # The wall is 10 m before the pane, and appears 10 m behind it; of the road, as much.
    assert (ghost & (np.abs(y - 16.0) < 0.1)).sum() > 0.2 * ghost.sum()
    assert (y[ghost] > 6.0).all()
    shots = np.count_nonzero((points['surface'] == Kind.GLASS) & (points['label'] == Cause.GOOD))
    assert 0.1 < ghost.sum() / (shots + ghost.sum()) < 0.5
    # What stands on a road is mirrored upside down below it.
    assert twice.sum() > 50
    assert (z[twice] < 0.0).all()
    assert (np.abs(np.abs(y[twice] - 1.0) - 5.0) < 0.2).mean() > 0.95
    assert (points['surface'][ghost | twice] == Kind.AIR).all()
    # The steeper, the rarer.
    eye = origins(drive, shot)
    fall = (eye[2] - z)[twice] / np.linalg.norm(position(points) - eye, axis=0)[twice]
    assert np.median(fall) < 0.6
    assert fall.max() < 0.95


# When and where shots go --------------------------------------------------------------------------


def test_shots_and_lines() -> None:
    """Shots are 5 µs apart, lines 5 ms and what the vehicle drives in that; angles wrap once."""
    drive = Drive(FLAT, lines=20, trajectory=SMOOTH, disturbances=QUIET)
    shot, points = returns(drive)
    cut = list(clouds(drive, lines_per_message=4))
    times = np.concatenate([stamp + cloud['t'].astype(np.int64) for stamp, cloud in cut])
    np.testing.assert_array_equal(times - cut[0][0], shot * 5000)
    angle = points['scan_angle']
    assert np.count_nonzero(np.diff(angle) < 0) == 19
    np.testing.assert_allclose(angle, 2 * np.pi * (shot % 1000) / 1000, rtol=1e-6)
    x = position(points[shot % 1000 == 500])[0]
    assert np.diff(x).mean() == pytest.approx(8.5 * 0.005, abs=0.001)
    # The scan plane is turned by 45°, so a line leaves the road at both sides, far apart along it.
    along, across = position(points[(shot < 1000) & (np.abs(angle - np.pi) < 1.2)])[:2]
    assert np.polyfit(across, along, 1)[0] == pytest.approx(-1.0, abs=0.02)


@pytest.mark.parametrize('count', SENSORS)
def test_sensors_have_their_rings(count: int) -> None:
    """Each sensor has as many rings as its name says, and turns ten times a second."""
    sensor = SENSORS[count]
    assert sensor.lines_per_second == pytest.approx(10.0, rel=0.01)
    assert sensor.shots_per_line == count * sensor.columns
    # Above and below a plain all lasers that point down see it, and no others.
    _, points = returns(turning(sensor=replace(sensor, farthest=1e6, weakest=0.0), turns=1))
    below = np.flatnonzero(np.array(sensor.elevation) < 0.0)
    np.testing.assert_array_equal(np.unique(points['ring']), below)


def test_points_lie_in_their_rings() -> None:
    """A ring's points have its elevation, and come in the order in which the head turns."""
    ends = [((8.0, -9.0, -9.0), (9.0, 9.0, 9.0)), ((-9.0, -9.0, -9.0), (-8.0, 9.0, 9.0))]
    sides = [((-9.0, 8.0, -9.0), (9.0, 9.0, 9.0)), ((-9.0, -9.0, -9.0), (9.0, -8.0, 9.0))]
    walls = Scene(tuple(box(*corners, Kind.FACADE) for corners in ends + sides))
    shot, points = returns(turning(walls, turns=1))
    assert len(shot) == SMALL.shots_per_line
    x, y, z = position(points)
    for ring, elevation in enumerate(SMALL.elevation):
        some = points['ring'] == ring
        np.testing.assert_allclose(np.arctan2(z, np.hypot(x, y))[some], elevation, atol=1e-6)
        steps = np.diff(np.unwrap(np.arctan2(y, x)[some])) / (2.0 * np.pi / SMALL.columns)
        np.testing.assert_allclose(steps, -1.0, atol=1e-3)  # clockwise
    # The first laser of the first column points straight back.
    assert (x[0], y[0]) == pytest.approx((-8.0, 0.0), abs=0.06)
    np.testing.assert_array_equal(points['ring'], shot % 4)


def test_time_of_each_point() -> None:
    """Every point has its own time; along a ring they are a column apart."""
    some = turning(turns=3)
    shot, _ = returns(some)
    found = list(messages(some, simulate(some), 1))
    assert [cloud.frame for cloud in found] == ['lidar'] * 3
    turn = SMALL.columns * SMALL.column_time
    assert np.diff([cloud.stamp for cloud in found]).tolist() == [turn] * 2
    assert [cloud.sent - cloud.stamp for cloud in found] == [turn] * 3
    times = np.concatenate([cloud.stamp + cloud.points['t'].astype(np.int64) for cloud in found])
    ring = np.concatenate([cloud.points['ring'] for cloud in found])
    np.testing.assert_array_equal(times - found[0].stamp, shot * 50_000)
    for number in np.unique(ring):
        assert set(np.diff(times[ring == number])) == {SMALL.column_time}


def test_straight_with_a_stop() -> None:
    """Speed changes evenly between knots; a vehicle that stands stays, and then goes on."""
    route = Route(((0.0, 8.0, 0.0), (2.0, 0.0, 0.0), (3.0, 0.0, 0.0), (4.0, 4.0, 0.0)), bump=0.0)
    x, y, z = route.position(np.array([0.0, 1.0, 2.0, 2.7, 3.0, 4.0, 6.0]))
    np.testing.assert_allclose(x, [0.0, 6.0, 8.0, 8.0, 8.0, 10.0, 18.0], atol=1e-4)
    np.testing.assert_allclose(y, -1.6)
    np.testing.assert_allclose(z, 0.0)


@pytest.mark.parametrize('after', [False, True], ids=['between knots', 'after the last'])
def test_turn(*, after: bool) -> None:
    """A steady turn is an arc, also after the last knot: after half a turn one comes back."""
    knots = ((0.0, 6.0, 0.5),) if after else ((0.0, 6.0, 0.5), (20.0, 6.0, 0.5))
    route = Route(knots, (1.0, 2.0, 0.0), bump=0.0, tremble=0.0)
    t = np.array([0.0, np.pi, 2.0 * np.pi, 4.0 * np.pi])
    x, y, _ = route.position(t)
    np.testing.assert_allclose(x, [1.0, 13.0, 1.0, 1.0], atol=1e-3)
    np.testing.assert_allclose(y, [2.0, 14.0, 26.0, 2.0], atol=1e-3)
    ahead = route.rotation(t)[:, 0]
    np.testing.assert_allclose(ahead, [[1, 0, -1, 1], [0, 1, 0, 0], [0, 0, 0, 0]], atol=1e-3)


def test_rotations_are_rotations() -> None:
    """Columns are orthonormal and right-handed; each angle turns the way it says."""
    turned = rotation(*np.random.default_rng(1).uniform(-0.4, 0.4, (3, 50)))
    product = np.einsum('jin,jkn->ikn', turned, turned)
    np.testing.assert_allclose(product, np.eye(3)[:, :, None] * np.ones(50), atol=1e-12)
    assert np.linalg.det(turned.transpose(2, 0, 1)) == pytest.approx(1.0)
    zero, some = np.zeros(1), np.full(1, 0.1)
    assert rotation(zero, some, zero)[2, 0, 0] == pytest.approx(-np.sin(0.1))  # nose down
    assert rotation(zero, zero, some)[1, 0, 0] == pytest.approx(np.sin(0.1))  # to the left
    assert rotation(some, zero, zero)[2, 1, 0] == pytest.approx(np.sin(0.1))  # left side up


# Recordings ---------------------------------------------------------------------------------------


def test_recording(tmp_path: Path) -> None:
    """A recording holds one cloud per message, at the time of its last shot, and its truth."""
    done: list[float] = []
    drive = replace(demo_drive(), lines=25)
    causes = record(drive, tmp_path / 'bag', lines_per_message=10, progress=done.append)
    assert sum(causes.values()) == sum(len(points) for _, points in clouds(drive))
    assert done == [0.4, 0.8, 1.0]
    with Recording(tmp_path / 'bag') as recording:
        times = [time for _, time, _ in recording.messages()]
        assert [topic.name for topic in recording.topics] == ['/lidar/points']
    assert np.diff(times).tolist() == [50_000_000, 25_000_000]
    with pytest.raises(FilterError, match='the output must be a new folder'):
        record(replace(demo_drive(), lines=1), tmp_path)


# Scanners without rings -------------------------------------------------------------------------

SCANNERS = {'Mid-40': MID_40, 'L2': L2, 'Mid-360': MID_360}


@pytest.mark.parametrize('angle', [0.0, 0.1, 0.6])
def test_refraction(angle: float) -> None:
    """A face bends as Snell's law says, within the plane of incidence; the way back undoes it."""
    beam = np.array([[np.cos(angle)], [np.sin(angle)], [0.0]])
    normal = np.array([[1.0], [0.0], [0.0]])
    bent = refract(beam, normal, 1.0 / 1.5)
    behind = np.arcsin(np.sin(angle) / 1.5)
    np.testing.assert_allclose(bent[:, 0], [np.cos(behind), np.sin(behind), 0.0], atol=1e-12)
    np.testing.assert_allclose(refract(bent, normal, 1.5), beam, atol=1e-12)


@pytest.mark.parametrize(
    ('name', 'level', 'upright'),
    [
        ('Mid-40', (-19.2, 19.2), (-19.2, 19.2)),
        ('L2', (-35.0, 35.0), (-37.2, 37.2)),
        ('Mid-360', (-180.0, 180.0), (-7.0, 52.0)),
    ],
)
def test_field_of_view(name: str, level: tuple[float, float], upright: tuple[float, float]) -> None:
    """Each sees as far to all sides as its maker says; beams have length one."""
    x, y, z = SCANNERS[name].directions(np.arange(500_000))
    np.testing.assert_allclose(x * x + y * y + z * z, 1.0, atol=1e-12)
    for angle, limits in ((np.arctan2(y, x), level), (np.arcsin(z), upright)):
        assert np.degrees([angle.min(), angle.max()]) == pytest.approx(limits, abs=0.1)


@pytest.mark.parametrize('name', SCANNERS)
def test_beams_of_a_cloud(name: str) -> None:
    """A cloud's points are on the beams of their times and lines; the others' beams are known."""
    scanner: FreeScanner = replace(SCANNERS[name], before=777, shots_per_line=3000)
    cloud = dry_turn(scanner, 3)
    points = Decoder(FilterParameters()).decode(to_message(cloud.stamp, cloud.points, cloud.frame))
    points = replace(points, t=points.t - cloud.stamp)
    assert 0 < len(points) < scanner.shots_per_line
    bright = np.linspace(0.1, 0.9, len(points))
    beams = beams_of(scanner, points, bright)
    assert len(beams) == scanner.shots_per_line
    there = np.flatnonzero(beams.source >= 0)
    of = beams.source[there]
    assert np.array_equal(np.sort(of), np.arange(len(points)))
    np.testing.assert_array_equal(beams.ring[there], points.line[of])
    np.testing.assert_array_equal(beams.t[there], points.t[of])
    np.testing.assert_array_equal(beams.reflectance[there], bright[of])
    position = beams.direction[there] * beams.range[there, None]
    np.testing.assert_allclose(position, points.xyz[of], atol=1e-4)
    assert np.isinf(np.delete(beams.range, there)).all()
    order = np.lexsort((beams.t, beams.ring))
    np.testing.assert_array_equal(order, np.arange(len(beams)))
