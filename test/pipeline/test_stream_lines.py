# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Scan lines of a profile scanner, whatever the stream says of them and however it is cut."""

from dataclasses import replace

import numpy as np
import pytest

from lidar_outlier_filter import CloudFilter, detect_outliers
from lidar_outlier_filter.core.annotations import Bools, Rows
from lidar_outlier_filter.core.points.mirror import find_mirror
from lidar_outlier_filter.core.points.turns import TurnCounter
from lidar_outlier_lab.results.forms import judge
from lidar_outlier_lab.simulation.forms import form_clouds
from lidar_outlier_lab.simulation.scenes.mapping_streets import street
from lidar_outlier_lab.simulation.world.drive import Drive

TURNS, RATE = 45, 149.99  # of the short drive, and per second
RATE_OFF = 2e-3  # relative
FAST = {'chain': ['alpha_beta_gamma']}
CUTS = ('turn', 'turns_10', 'turns_25', 'second', 'packets', 'odd')
WITHOUT = ('ring_0', 'ring_packet', 'gps_time', 'stamps', 'scan_angle')  # the same, other columns


def short(seed: int) -> Drive:
    """Draw a drive of 0.3 s."""
    return replace(street(seed), lines=TURNS)


def plain() -> Rows:
    """Return the points of a second, without lines."""
    (cloud,) = form_clouds('second', 1, short)
    return cloud.points


def test_cuts_do_not_matter() -> None:
    """Lines come from time and geometry: any cut gives the same verdicts, as does a bad field."""
    found = {name: judge(name, FAST, 1, short) for name in (*CUTS, *WITHOUT)}
    assert len({one.digest for one in found.values()}) == 1
    assert all(abs(float(one.rate) - RATE) < RATE_OFF * RATE for one in found.values())
    numbered = judge('line', FAST, 1, short)
    assert abs(found['turn'].counts.f1 - numbered.counts.f1) < 0.01


@pytest.mark.parametrize('name', ['afresh', 'rows', 'line_byte', 'line_float'])
def test_numbers_that_start_again(name: str) -> None:
    """Each change is a line: as if numbers went on."""
    assert judge(name, FAST, 1, short).digest == judge('line', FAST, 1, short).digest


@pytest.mark.parametrize('own', [False, True])
def test_period_of_the_mirror(own: bool) -> None:  # noqa: FBT001  a frame
    """In the map's frame as in the sensor's, of a vehicle that stands as of one that drives."""
    for name in ('turns_10', 'stands'):
        clouds = list(form_clouds(f'{name}_own' if own else name, 1, short))
        rows = np.concatenate([cloud.points for cloud in clouds])
        t = np.concatenate([cloud.stamp + cloud.points['t'].astype(np.int64) for cloud in clouds])
        xyz = np.stack([rows[axis].astype(np.float64) for axis in 'xyz'], axis=1)
        mirror = find_mirror(t, xyz)
        assert mirror is not None
        assert abs(mirror.rate - RATE) < RATE_OFF * RATE
        assert mirror.resemblance < 0.1
        cut = zip(np.array_split(t, 37), np.array_split(xyz, 37), strict=True)
        counter = TurnCounter(mirror)
        one, many = TurnCounter(mirror).number(t, xyz), [counter.number(*part) for part in cut]
        assert (np.concatenate(many) == one).all()
        # Turns begin where the sky is, within a few shots of a turn.
        begins = np.flatnonzero(np.diff(one)) + 1
        assert np.abs(np.diff(t[begins]) * RATE / 1e9 - 1.0).max() < 0.1


def test_facets() -> None:
    """A facet counts as a turn: it begins where the beam jumps back."""
    plain, numbered = (judge(name, FAST, 1, short) for name in ('facets', 'facets_line'))
    assert abs(float(plain.rate) - 600.0) < 0.5
    assert abs(plain.counts.f1 - numbered.counts.f1) < 0.01


def test_swings() -> None:
    """A mirror that swings shows it: each way is a line, whose angles are known."""
    plain, numbered = (judge(name, {}, 1, short) for name in ('swings', 'swings_line'))
    assert any('swings/s, from time and geometry' in one for one in plain.said)
    assert all('on the scan pattern' in one for one in plain.methods)
    assert plain.counts.f1 > numbered.counts.f1 - 0.02


def test_angles_that_times_do_not_tell() -> None:
    """That so many shots share a time is said, with the share, and what it may cost."""
    said = ' '.join(judge('time_of_384', FAST, 1, short).said)
    assert '100 % of the points share the time' in said
    assert 'a time is that of up to 384 shots, whose angles it does not tell' in said
    assert 'whose angles' not in ' '.join(judge('time_of_24', FAST, 1, short).said)


@pytest.mark.parametrize('name', ['time_of_line', 'time_of_384'])
def test_angles_from_the_order_of_shots(name: str) -> None:
    """Where hundreds of shots share a time, their order and the geometry show the scan pattern."""
    found, numbered = (judge(one, {}, 2, short) for one in (name, 'line'))
    assert all('on the scan pattern' in one for one in found.methods)
    assert found.counts.f1 > numbered.counts.f1 - 0.02


def test_two_scanners() -> None:
    """Those that a field names have lines of their own; others have none, which is said."""
    named, bare = (judge(name, FAST, 1, short) for name in ('heads_field', 'heads'))
    assert any('scanner 0: ' in one and 'scanner 1: ' in one for one in named.said)
    assert any('2 scanners take turns, and no field such as head' in one for one in bare.said)


def test_what_is_no_profile() -> None:
    """Points without recurrence have no period; a rate that is given is taken."""
    rng = np.random.default_rng(1)
    t = np.arange(30_000) * 6667
    walk = np.cumsum(rng.normal(0.0, 0.05, (len(t), 3)), axis=0)
    assert find_mirror(t, walk) is None
    assert find_mirror(t, rng.uniform(-9, 9, walk.shape)) is None
    given = find_mirror(t, walk, 1e7)
    assert given is not None
    assert given.rate == 100.0


def test_a_message_is_a_line_only_where_nothing_shows() -> None:
    """Then verdicts depend on the cut, which is said."""
    said: list[str] = []
    rng, stream = np.random.default_rng(1), CloudFilter(FAST, warn=said.append)
    for n in range(30):
        cloud = np.zeros(1000, [('x', 'f4'), ('y', 'f4'), ('z', 'f4'), ('t', 'u4')])
        cloud['x'], cloud['t'] = rng.normal(0, 0.05, 1000).cumsum(), np.arange(1000) * 6667
        cloud['y'] = 20.0 + 0.1 * n
        stream.push(cloud, stamp=n * 10_000_000)
    stream.flush()
    assert any('verdicts depend on the cut into messages' in one for one in said)


def rejected(rows: Rows, *, numbered: bool) -> Bools:
    """Judge a whole cloud."""
    xyz = np.stack([rows[axis] for axis in 'xyz'], axis=1)
    line = np.cumsum(np.diff(rows['t'], prepend=0) > 1e12) if numbered else None
    verdict = detect_outliers(xyz, t=rows['t'].astype(np.int64), line=line, parameters=FAST)
    return np.asarray(verdict.outlier)


def test_arrays_with_times() -> None:
    """A cloud with times needs no line numbers; a constant number is none."""
    rows = plain()
    found = rejected(rows, numbered=False)
    bad = rows['label'] > 0
    assert (found & bad).sum() > 0.6 * bad.sum()
    assert (rejected(rows, numbered=True) == found).all()


def test_arrays_as_streams() -> None:
    """The trees judge a whole cloud of a profile scanner as its stream, point by point."""
    clouds = list(form_clouds('turns_10', 1, short))
    stream = CloudFilter()
    outputs = [one for cloud in clouds for one in stream.push(cloud.points, stamp=cloud.stamp)]
    outputs += stream.flush()
    rows = np.concatenate([cloud.points for cloud in clouds])
    t = np.concatenate([cloud.stamp + cloud.points['t'].astype(np.int64) for cloud in clouds])
    xyz = np.stack([rows[axis] for axis in 'xyz'], axis=1)
    verdict = detect_outliers(xyz, t=t, intensity=rows['intensity'])
    found = np.asarray(verdict.outlier)
    assert 50 < found.sum() < 0.01 * len(found)
    assert b''.join(bytes(one.outliers.data) for one in outputs) == rows[found].tobytes()
