# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The scan pattern of spinning sensors: the neighbours, features and trees are those of loops."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from naive import scan_pattern as naive
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from lidar_outlier_filter.core.detectors.evidence.pattern import judge
from lidar_outlier_filter.core.detectors.evidence.pattern_features import COUNT, FEATURES, measure
from lidar_outlier_filter.core.detectors.evidence.pattern_scores import (
    AGAIN,
    COUNT_AGAIN,
    count_scores,
    measure_again,
)
from lidar_outlier_filter.core.detectors.evidence.pattern_window import prepare
from lidar_outlier_filter.core.detectors.evidence.trees import Trees, add_up
from lidar_outlier_filter.core.neighbours.scan_pattern import Pattern, arctangent, find_pattern
from lidar_outlier_filter.core.points import Points
from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_filter.parameters.filter import FilterParameters

TURN_NS = 100_000_000  # ten turns a second
RATE = -2 * np.pi / TURN_NS  # rad/ns: clockwise


RINGS = (-20.0, -14.0, -9.0, -6.0, -3.0, 0.0, 4.0, 9.0)  # degrees


def sweep(  # noqa: PLR0913
    seed: int,
    lost: float,
    turns: float = 1.0,
    *,
    columns: int = 90,
    staggered: bool = False,
    elevations: Sequence[float] = RINGS,
) -> Points:
    """Return a room seen by some rings, some of whose returns are lost or anywhere."""
    rng = np.random.default_rng(seed)
    rings, step = len(elevations), round(1e8 / columns)
    columns = round(columns * turns)
    shot = np.arange(columns * rings)
    ring, column = shot % rings, shot // rings
    # No head turns so evenly that a return is exactly as far as windows reach.
    uneven = rng.integers(0, step // 25, columns)[column]
    t = column * step + uneven + (0 if staggered else ring * 1000)
    offset = 0.03 * (ring % 4) if staggered else 0.0
    azimuth = 2.0 + RATE * t + offset
    up = np.radians(np.array(elevations))[ring]
    far = np.minimum(
        8.0 / np.maximum(np.abs(np.cos(azimuth)), 1e-9),
        5.0 / np.maximum(np.abs(np.sin(azimuth)), 1e-9),
    )
    far = far + 0.01 * rng.standard_normal(len(shot))
    stray = rng.random(len(shot)) < 0.05
    far[stray] *= rng.uniform(0.2, 0.9, int(stray.sum()))
    flat = np.stack([np.cos(azimuth), np.sin(azimuth), np.tan(up)], axis=1)
    kept = rng.random(len(shot)) >= lost
    points = Points(far[:, None] * flat, t, ring, np.ones(len(shot), np.bool_))
    return points.take(kept)


def pattern_of(points: Points) -> Pattern:
    """Return the pattern that there must be."""
    pattern = find_pattern(points)
    assert pattern is not None
    return pattern


def measured(pattern: Pattern) -> NDArray[np.float32]:
    """Return the features of all places."""
    out = np.zeros((COUNT, len(pattern.order)), np.float32)
    measure(prepare(pattern), 0, len(pattern.first), out)
    return out


@pytest.mark.parametrize(
    ('lost', 'turns', 'staggered'),
    [(0.0, 1.0, False), (0.3, 1.3, False), (0.3, 0.6, True), (0.8, 2.2, False)],
)
def test_as_loops(lost: float, turns: float, *, staggered: bool) -> None:
    """Neighbours and features, with missing returns, of a part of a turn and of several."""
    points = sweep(1, lost, turns, staggered=staggered)
    pattern = pattern_of(points)
    xyz = [tuple(row) for row in points.xyz.tolist()]
    rings = naive.rings_of(xyz, points.t.tolist(), points.line.tolist(), RATE)
    # Steps and elevations are medians of samples there, and of all here: a sample is enough.
    rings = [
        ring._replace(step=float(step), gap=float(gap))
        for ring, step, gap in zip(rings, pattern.step, pattern.gap, strict=True)
    ]
    out = measured(pattern)
    for number, ring in enumerate(rings):
        places = range(pattern.first[number], pattern.last[number])
        assert [p.number for p in ring.points] == pattern.order[list(places)].tolist()
        for k, place in enumerate(places):
            wanted = naive.features(rings, number, k)
            got = {name: float(out[FEATURES.index(name), place]) for name in wanted}
            assert got == pytest.approx(wanted, rel=2e-3, abs=1e-5), (number, k)


@pytest.mark.parametrize('threads', [1, 2, 5])
def test_order_and_threads_do_not_matter(threads: int) -> None:
    """Points in any order get the same scores, bit for bit, whatever the number of threads."""
    points = sweep(2, 0.2)
    score = judge(pattern_of(points), 1.0, threads=1)
    order = np.random.default_rng(3).permutation(len(points))
    pattern = find_pattern(points.take(order), threads)
    assert pattern is not None
    again = np.empty_like(score)
    again[order] = judge(pattern, 1.0, threads=threads)
    assert again.tobytes() == score.tobytes()


def test_strays_are_found() -> None:
    """The default's model rejects most of what hangs in a room, and nearly none of its walls."""
    points = sweep(4, 0.0, columns=900)
    level = np.hypot(points.xyz[:, 0], points.xyz[:, 1])
    azimuth = np.arctan2(points.xyz[:, 1], points.xyz[:, 0])
    wall = np.minimum(8.0 / np.abs(np.cos(azimuth)), 5.0 / np.abs(np.sin(azimuth)))
    stray = level < 0.85 * wall
    rejected = judge(pattern_of(points), 1.0) > 1
    assert rejected[stray].mean() > 0.7
    assert rejected[~stray].mean() < 0.02


def test_threshold_is_a_dial() -> None:
    """The higher it is, the fewer are rejected."""
    pattern = pattern_of(sweep(5, 0.1, 2.0))
    counts = [int((judge(pattern, dial) > 1).sum()) for dial in (0.5, 0.8, 1.0, 1.2, 2.0)]
    assert counts == sorted(counts, reverse=True)
    assert counts[0] > counts[-1]


def test_no_pattern() -> None:
    """Lines one after the other, few points, and azimuths in disorder are none."""
    points = sweep(6, 0.0)
    profile = Points(points.xyz, np.arange(len(points)), np.arange(len(points)) // 90, points.valid)
    assert find_pattern(profile) is None
    assert find_pattern(points.take(slice(0, 10))) is None
    rng = np.random.default_rng(1)
    wild = Points(rng.standard_normal((len(points), 3)), points.t, points.line, points.valid)
    assert find_pattern(wild) is None


# Degrees: of data sheets.
HALVES = [*np.linspace(-24.33, -8.83, 32), *np.linspace(-8.33, 2.0, 32)]  # HDL-64E
CROWDED = [  # VLP-32C
    *(-25, -15.64, -11.31, -8.84, -7.25, -6.15, -5.33, -4.67),
    *np.linspace(-4, 5 / 3, 18),
    *(2.33, 3.33, 4.67, 7, 10.33, 15),
]


@pytest.mark.parametrize(
    ('elevations', 'even'),
    [
        (np.linspace(-15, 15, 16), True),
        (np.delete(np.linspace(-30.67, 10.67, 32), [4, 20]), True),  # two without returns
        (HALVES, True),
        (CROWDED, False),
        (np.geomspace(1, 25, 16), False),
        ([0.0], True),
    ],
)
def test_rings_unevenly_spaced_are_no_pattern(elevations: Sequence[float], *, even: bool) -> None:
    """A ring that is missing does not matter, nor do two halves; rings crowded together do."""
    for seed, lost in ((7, 0.0), (8, 0.4)):
        points = sweep(seed, lost, elevations=elevations)
        assert (find_pattern(points, spins=True) is not None) == even
        assert find_pattern(points, spins=True, crowded=True) is not None


@pytest.mark.parametrize(
    ('name', 'even'),
    [('vlp32_nebula_db3', False), ('vlp16_mrpt_mcap', True), ('hdl32_mrpt_mcap', True)],
)
def test_rings_of_recordings(recordings: Path, name: str, *, even: bool) -> None:
    """Clouds of a VLP-32C have no pattern, those of sensors with even rings do."""
    decoder = Decoder(FilterParameters())
    with AnyReader(
        [recordings / 'bags' / name], default_typestore=get_typestore(Stores.ROS2_JAZZY)
    ) as reader:
        clouds = [
            decoder.decode(reader.deserialize(data, connection.msgtype))
            for connection, _, data in reader.messages()
            if connection.msgtype.endswith('PointCloud2')
        ]
    found = [find_pattern(points.take(points.valid)) is not None for points in clouds]
    assert found
    assert all(flag == even for flag in found)


def test_arctangent() -> None:
    """Within 1e-8 of the function, in all quadrants and on the axes."""
    rng = np.random.default_rng(1)
    pairs = [*rng.standard_normal((500, 2)).tolist(), [0, 1], [1, 0], [0, -1], [-1, 0], [2, 2]]
    for y, x in pairs:
        assert arctangent(float(y), float(x)) == pytest.approx(np.arctan2(y, x), abs=1e-8)


def test_trees_are_those_of_loops() -> None:
    """Sums of what single trees say, in their order, also where a feature is the limit."""
    rng = np.random.default_rng(1)
    feature = rng.integers(0, 5, (20, 7)).astype(np.int32)
    limit = rng.integers(-3, 4, (20, 7)).astype(np.float32)
    value = rng.standard_normal((20, 8)).astype(np.float32)
    points = rng.integers(-3, 4, (5, 40)).astype(np.float32)
    total = np.empty(40, np.float32)
    add_up(Trees(feature, limit, value, np.float32(0.5)), points, total)
    for n in range(40):
        expected = np.float32(0.5)
        for f, at, v in zip(feature.tolist(), limit.tolist(), value.tolist(), strict=True):
            expected = np.float32(
                expected + np.float32(naive.tree(f, at, v, points[:, n].tolist()))
            )
        assert total[n] == expected


def turned_later(points: Points, turns: int) -> Points:
    """Return what a head sees that turns so many times, and then sees the same again."""
    later = points.t + turns * TURN_NS
    both = np.concatenate
    return Points(
        both([points.xyz, points.xyz]),
        both([points.t, later]),
        both([points.line, points.line]),
        both([points.valid, points.valid]),
    )


@pytest.mark.parametrize('turns', [40, 3000, 20_000])
def test_a_turn_is_judged_alike_whenever_it_is(turns: int) -> None:
    """The verdicts on points do not depend on how often the head turned before it saw them."""
    points = sweep(10, 0.2, 1.3, columns=1800)
    score = judge(pattern_of(turned_later(points, turns)), 1.0)
    once, again = score[: len(points)], score[len(points) :]
    assert 0 < np.count_nonzero(once > 1) < 0.2 * len(points)
    np.testing.assert_array_equal(once > 1, again > 1)
    # A phase in single precision may still be rounded the other way: its window sees that.
    assert np.count_nonzero(once != again) < 0.01 * len(points)


@pytest.mark.parametrize('count', range(64, 97, 5))
def test_nothing_is_read_behind_the_last_line(count: int) -> None:
    """Lines of any length: under numba's bounds check, what lies behind the last raises."""
    points = sweep(11, 0.0, columns=count)
    assert (judge(pattern_of(points), 1.0) >= 0).all()


def test_scores_of_the_first_pass_around_points() -> None:
    """Shares of points as far away, and of rings beside: there are none beyond the outermost."""
    points = sweep(12, 0.0)
    pattern = pattern_of(points)
    prepared = prepare(pattern)
    score = np.full(len(pattern.order), -1.0, np.float32)
    score[pattern.first[0] : pattern.first[0] + 9] = 1.0
    out = np.zeros((COUNT_AGAIN, len(score)), np.float32)
    measure_again(prepared, count_scores(pattern, score), 0, len(pattern.first), out)
    found = dict(zip(AGAIN, out[COUNT:], strict=True))
    there = pattern.order >= 0
    # Nearer than 1 m, than 2 m and so on: an edge belongs to what is nearer.
    octave = np.ceil(np.log2(np.maximum(pattern.range, 1.0)))
    for k in np.flatnonzero(there):
        alike = there & (octave == octave[k])
        assert found['share_range'][k] == np.float32((score[alike] > 0).mean())
    for line in range(len(pattern.first)):
        wide = found['wide_other'][pattern.first[line] : pattern.last[line]]
        assert wide.any() == (line in {1, 2})
