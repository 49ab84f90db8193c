# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The forms that a drive is sent in: the same returns in all, and what sets each apart."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.messages.cloud import structured
from lidar_outlier_lab.results import forms as results
from lidar_outlier_lab.simulation import forms
from lidar_outlier_lab.simulation.forms import FORMS, form_clouds
from lidar_outlier_lab.simulation.scenes.mapping_streets import street
from lidar_outlier_lab.simulation.world.drive import Drive
from lidar_outlier_lab.simulation.world.recording import START, Cloud, to_message
from lidar_outlier_lab.simulation.world.sensors import ProfileScanner

TURNS, INTERVAL = 22, 6667  # of the short drive; nanoseconds between shots


def short(seed: int) -> Drive:
    """Draw a drive of a few turns."""
    return replace(street(seed), lines=TURNS)


def sent(name: str) -> list[Cloud]:
    """Send the short drive."""
    return list(form_clouds(name, 1, short))


def points(clouds: list[Cloud]) -> NDArray[np.void]:
    """Join the returns of messages."""
    rows = np.concatenate([cloud.points.ravel() for cloud in clouds])
    there: NDArray[np.void] = rows[np.isfinite(rows['x'])]
    return there


def shots(clouds: list[Cloud]) -> Iterator[int]:
    """Say when each return was measured, nanoseconds after the first shot."""
    for cloud in clouds:
        for t in cloud.points['t'].tolist():
            yield cloud.stamp - START + t


@pytest.mark.parametrize('name', FORMS)
def test_same_returns(name: str) -> None:
    """Forms differ in columns, cuts and frames; other drives and echoes have other returns."""
    form, found = FORMS[name], points(sent(name))
    again = list(form_clouds(name, 1, short))
    assert [c.points.tobytes() for c in again] == [c.points.tobytes() for c in sent(name)]
    plain = points(sent('line_own' if form.own else 'line'))
    if (form.drive, form.heads, form.echoes) != ('street', 1, 'one'):
        assert len(found) != len(plain)
        assert np.isin(np.unique(plain['label']), np.unique(found['label'])).any()
        return
    for field in ('label', 'surface', 'intensity'):
        assert (found[field] == plain[field]).all()
    for axis, away in zip('xyz', form.offset, strict=True):
        off = found[axis].astype(np.float64) - away - plain[axis]
        assert np.abs(off).max() <= (0.0 if away == 0.0 else 2e-4)


def test_cuts() -> None:
    """Messages are as long as their forms say, and each return has its time in all of them."""
    assert [len(sent(name)) for name in ('turn', 'turns_10', 'packets', 'second')] == [22, 3, 58, 1]
    whole = list(shots(sent('line')))
    for name in ('turn', 'turns_10', 'packets', 'odd'):
        assert list(shots(sent(name))) == whole
    lengths = {cloud.sent - cloud.stamp for cloud in sent('odd')}
    assert len(lengths) == len(sent('odd')) > 2
    assert all(length % INTERVAL == 0 for length in lengths)


def test_columns() -> None:
    """Names and units of the drivers."""
    t = np.array(list(shots(sent('line'))))
    assert np.abs(points(sent('unix_us'))['timestamp'] - (START + t) / 1e3).max() <= 0.25
    week = points(sent('gps_time'))['gps_time']
    assert 0.0 <= week[0] < 7 * 86_400
    assert np.abs(week - week[0] - (t - t[0]) / SECOND).max() < 1e-9
    assert set(points(sent('ring_0'))['ring']) == {0}
    assert points(sent('ring_packet'))['ring'][-1] in {56, 57}  # the last may be empty
    assert points(sent('afresh'))['line'].max() == 9
    assert points(sent('line'))['line'].max() == TURNS - 1


def test_shared_times() -> None:
    """Some shots have the time of the first among them; a clock may tick."""
    for name, together in (('time_of_line', 1000), ('time_of_24', 24), ('time_of_384', 384)):
        t = np.array(list(shots(sent(name))))
        assert (t % (together * INTERVAL) == 0).all()
    assert set(np.array(list(shots(sent('ticks')))) % 25_000) == {0}


def test_rows() -> None:
    """An organised cloud has a turn in each row, its shots in their columns."""
    first, *_, last = sent('rows')
    assert first.points.shape == last.points.shape == (10, 1000)
    assert np.isnan(last.points['x'][2:]).all()
    assert np.isfinite(first.points['x']).mean() > 0.5
    message = to_message(first.stamp, first.points)
    assert (message.height, message.width, message.is_dense) == (10, 1000, False)
    assert structured(message).tobytes() == first.points.tobytes()


def test_echoes() -> None:
    """Two returns of a shot have one time, one line; copies are alike, second echoes apart."""
    for name in ('copies', 'echoes'):
        found = points(sent(name))
        second = np.flatnonzero(found['return_number'] == 2)
        before, after = found[second - 1], found[second]
        assert (before['return_number'] == 1).all()
        assert (before['line'] == after['line']).all()
        apart = np.sqrt(sum((before[a] - after[a]) ** 2 for a in 'xyz'))
        assert (apart == 0).all() if name == 'copies' else apart.min() > 0.3


def test_other_scanners() -> None:
    """Two heads see twice as much, a mirror with facets has more lines, one that swings turns."""
    both = points(sent('heads_field'))
    assert set(both['head']) == {0, 1}
    assert points(sent('heads_line'))['line'].max() == 2 * TURNS - 1
    assert points(sent('facets_line'))['line'].max() == 4 * TURNS - 1
    sensor = forms.DRIVES['swings'](short(1)).sensor
    assert isinstance(sensor, ProfileScanner)
    there, back = sensor.angle(np.arange(1000)), sensor.angle(np.arange(1000, 2000))
    assert np.degrees(there[[0, -1]]) == pytest.approx([80.0, 279.8])
    assert (there == back[::-1]).all()


def test_unknown_form() -> None:
    """It is refused with the names of all."""
    with pytest.raises(FilterError, match=r'the form must be one of line, turn, .*, got lines'):
        next(form_clouds('lines'))


def test_table() -> None:
    """Cuts with line numbers are judged alike; the page has found, lost and F1 of both chains."""
    one, other = (results.judge(name, {}, 1, short) for name in ('line', 'packets_line'))
    assert one.digest == other.digest
    assert one.counts == other.counts
    assert one.counts.outliers == np.count_nonzero(points(sent('line'))['label'])
    text = results.section(lambda *_: None, ('line', 'turn'), draw=short)
    assert f'| {one.counts.found} | {one.counts.lost} |' in text
    assert text.count(f'`{one.digest[:6]}`') == 2
