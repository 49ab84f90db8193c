# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Pieces: a recording that is judged in pieces gives the bytes of one that is judged at once."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from helpers.drives import BEGIN, FAST, PERIOD, SECOND, replayed, write_drive
from helpers.replays import REAL
from hypothesis import given as each
from hypothesis import strategies as st

from lidar_outlier_filter.archive import pieces as module
from lidar_outlier_filter.archive.locations import location_of
from lidar_outlier_filter.archive.pieces import cut
from lidar_outlier_filter.archive.verdict_bytes import digest, pack, unpack
from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.core.judging.chain import Chain
from lidar_outlier_filter.core.kernels.compiling import SENSORS, sample
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.parameters.filter import FilterParameters

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

USUAL: Mapping[str, Mapping[str, object]] = {
    'in time': {},
    'by message': {'blocks': 'message'},
    'auto': {'blocks': 'auto'},
    'scores': {'scores': True},
    'votes': {'chain': ['alpha_beta_gamma', 'lof'], 'vote': 2, 'lof.threshold': 1.2},
    'moving': {'motion.source': 'odometry'},
    'moving, by message': {'motion.source': 'odometry', 'blocks': 'auto'},
    'long blocks': {'block': 0.35, 'halo': 0.2},
    'late points': {'lateness': 0.3, 'halo': 0.05},
    'lines by angle': {'line_source': 'angle', 'angle_plane': 'xy'},
    'lines by message': {'line_source': 'message'},
    'spatial': {'chain': ['lof', 'sor']},
}


@pytest.mark.parametrize('name', USUAL)
def test_pieces_give_the_same_bytes(tmp_path: Path, name: str) -> None:
    """Whatever the parameters and the cut, and no block is left to who writes."""
    drive, given = write_drive(tmp_path / 'drive'), {**FAST, **USUAL[name]}
    expected, counts, _ = replayed(drive, tmp_path / 'whole', given)
    assert counts[0].rejected > 0
    for length in (0.5, 1.0, 100.0):
        found = replayed(drive, tmp_path / f'{length}', given, length)
        assert found == (expected, counts, 0)


def test_topics_are_streams_of_their_own(tmp_path: Path) -> None:
    """Pieces hold the clouds of all topics."""
    drive = write_drive(tmp_path / 'drive', lidars=('/front', '/rear'))
    expected, counts, _ = replayed(drive, tmp_path / 'whole', FAST)
    assert len(counts) == 2
    assert replayed(drive, tmp_path / 'pieces', FAST, 0.5) == (expected, counts, 0)


def back(number: int) -> int:
    """Set the clock back by an hour after 1.4 s."""
    return BEGIN + number * PERIOD - (3600 * SECOND if number >= 14 else 0)


def late(number: int) -> int:
    """Let every seventh cloud be 0.45 s old."""
    return BEGIN + number * PERIOD - (45 * SECOND // 100 if number % 7 == 6 else 0)


def stopping(number: int) -> int:
    """Let a minute pass after 1.2 s."""
    return BEGIN + number * PERIOD + (60 * SECOND if number >= 12 else 0)


@pytest.mark.parametrize('stamp_of', [back, late, stopping])
@pytest.mark.parametrize('name', ['in time', 'auto', 'moving', 'lines by angle'])
def test_odd_times_give_the_same_bytes(
    tmp_path: Path, name: str, stamp_of: Callable[[int], int]
) -> None:
    """What pieces cannot know, as what was refused long before, is judged by who writes."""
    drive = write_drive(tmp_path / 'drive', stamp_of=stamp_of)
    given = {**FAST, **USUAL[name]}
    expected, counts, _ = replayed(drive, tmp_path / 'whole', given)
    found, counted, _ = replayed(drive, tmp_path / 'pieces', given, 0.5)
    assert found == expected
    assert counted == counts


def test_more_points_than_may_be_held(tmp_path: Path) -> None:
    """The same clouds are refused."""
    drive = write_drive(tmp_path / 'drive')
    given = {**FAST, 'max_points': 250, 'block': 0.3}
    expected, counts, _ = replayed(drive, tmp_path / 'whole', given)
    assert counts[0].refused > 0
    found, counted, _ = replayed(drive, tmp_path / 'pieces', given, 0.5)
    assert (found, counted) == (expected, counts)


@pytest.mark.parametrize('name', REAL)
def test_real_recordings_give_the_same_bytes(
    recordings: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """With the default chain, a piece for every cloud."""
    monkeypatch.setattr(module, 'LEAST', 1)
    given = {'evidence.threshold': 0.5}
    expected, counts, _ = replayed(recordings / 'bags' / name, tmp_path / 'whole', given)
    assert counts[0].rejected > 0
    found = replayed(recordings / 'bags' / name, tmp_path / 'pieces', given, 0.1)
    assert found == (expected, counts, 0)


def test_pieces_cover_all_times(tmp_path: Path) -> None:
    """Each begins where the one before ends; the ends are open; none is nearly empty."""
    location = location_of(write_drive(tmp_path / 'drive'))
    pieces = cut(location, length=0.5)
    assert len(pieces) == 6
    assert [piece.start for piece in pieces[1:]] == [piece.stop for piece in pieces[:-1]]
    assert (pieces[0].start, pieces[-1].stop) == (None, None)
    assert len(cut(location, length=0.001)) == 91 // module.LEAST
    with pytest.raises(RecordingError, match='a topic to filter must be one of /lidar, got'):
        cut(location, topics=['/other'])


def test_pieces_shrink_towards_the_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """None is longer than asked for, nor than two thirds of what each worker has left."""
    monkeypatch.setattr(module, 'LEAST', 1)
    monkeypatch.setattr(module, 'SHORTEST', 0.1)
    location = location_of(write_drive(tmp_path / 'drive'))
    pieces = cut(location, length=0.5, workers=2)
    assert [piece.start for piece in pieces[1:]] == [piece.stop for piece in pieces[:-1]]
    assert (pieces[0].start, pieces[-1].stop) == (None, None)
    bounds = [
        BEGIN,
        *(piece.stop for piece in pieces if piece.stop is not None),
        BEGIN + 3 * SECOND,
    ]
    steps = np.diff(bounds)
    assert steps[0] == SECOND // 2
    assert (np.diff(steps[:-1]) <= 0).all()
    for number, step in enumerate(steps[:-1]):
        left = steps[number:].sum()
        assert step == max(SECOND // 10, min(SECOND // 2, round(left * 2 / 3 / 2)))
    assert SECOND // 10 <= steps[-1] < SECOND // 5
    assert len(cut(location, length=0.5)) == 6


@pytest.mark.parametrize('sensor', SENSORS)
@pytest.mark.parametrize('name', DETECTORS)
def test_numbers_of_lines_do_not_count(name: str, sensor: str) -> None:
    """Verdicts, and so digests, do not depend on where the numbers of scan lines begin."""
    chain = Chain(FilterParameters().changed({'chain': [name]}))
    for points in sample(sensor):
        other = replace(points, line=points.line + 12345)
        assert digest(points) == digest(other)
        expected, found = chain.judge(points), chain.judge(other)
        for column in fields(Verdict):
            one, two = getattr(expected, column.name), getattr(found, column.name)
            np.testing.assert_array_equal(one, two)


def some_points() -> Points:
    """Make points with all columns."""
    rng = np.random.default_rng(5)
    xyz = rng.normal(size=(7, 3))
    line, there, bright = np.arange(7) // 2, np.ones(7, np.bool_), np.ones(7, np.float32)
    return Points(xyz, np.arange(7), line, there, np.ones(7), xyz, bright, line, there)


@pytest.mark.parametrize('name', [column.name for column in fields(Points)])
def test_digest_sees_every_column(name: str) -> None:
    """A single other value, of any column, is another digest; so is a missing column."""
    points = some_points()
    values = getattr(points, name).copy()
    values.reshape(-1)[-1] = values.reshape(-1)[-1] + 1 if values.dtype.kind != 'b' else False
    other: dict[str, Any] = {name: values}
    assert digest(replace(points, **other)) != digest(points)
    if name in {'sigma', 'own', 'intensity', 'ring', 'fixed'}:
        other[name] = None
        assert digest(replace(points, **other)) != digest(points)


@st.composite
def verdicts(draw: st.DrawFn) -> Verdict:
    """Draw verdicts in which anything may stand, as votes leave it."""
    count = draw(st.integers(0, 40))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    bits = draw(st.integers(0, 2**16 - 1))
    score = rng.choice([np.nan, 0.0, 0.5, 1.5], count).astype(np.float32)
    detectors, undecided = (
        (rng.integers(0, 2**16, count) & bits).astype(np.uint16) for _ in range(2)
    )
    reason = rng.integers(0, 50, count).astype(np.uint8)
    return Verdict(score, detectors, undecided, rng.random(count) < 0.5, reason)


@each(verdicts(), st.integers(0, 9), st.booleans())
def test_verdicts_come_back(verdict: Verdict, passes: int, scores: bool) -> None:  # noqa: FBT001
    """Packed and unpacked all is as it was; of scores left out, whether there is one."""
    found, counted = unpack(pack(verdict, passes, scores=scores))
    assert counted == passes
    for name in ('detectors', 'undecided', 'rejected'):
        np.testing.assert_array_equal(getattr(found, name), getattr(verdict, name))
    if scores:
        np.testing.assert_array_equal(found.score, verdict.score)
        np.testing.assert_array_equal(found.reason, verdict.reason)
    else:
        np.testing.assert_array_equal(np.isnan(found.score), np.isnan(verdict.score))
    assert found.score.dtype == verdict.score.dtype


def test_verdicts_are_small() -> None:
    """A hundred rejected points among 128 000 take less than 2 bytes each; all points, 16 kB."""
    verdict = Verdict.untested(128_000)
    verdict.score[:] = 0.5
    verdict.detectors[::1280] = 64
    verdict.settle(1)
    assert len(pack(verdict, 1, scores=False)) < 1000
