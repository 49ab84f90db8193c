# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The promises of the house, from message to message: what users can rely on."""

import copy
import weakref
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.clouds import (
    SECOND,
    STAMP,
    cloud,
    cut,
    drive,
    dump,
    point_bytes,
    table,
    to_rosbags,
    values,
)
from helpers.nodes import line
from rosbags.highlevel import AnyReader

from lidar_outlier_filter.core.annotations import Rows
from lidar_outlier_filter.errors import CloudError, ParameterError
from lidar_outlier_filter.messages.cloud import BYTES_OF_SCORES, plain_rows, structured
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.pipeline import Pipeline, SplitCloud
from lidar_outlier_lab.results.papers.methods import SMOOTHER

SHORT: dict[str, object] = {'block': 0.01, 'halo': 0.002, 'chain': ['alpha_beta_gamma']}
DEFAULT: dict[str, object] = {'chain': FilterParameters().chain}
BOTH_KINDS = pytest.mark.parametrize('kind', [copy.deepcopy, to_rosbags], ids=['ros', 'rosbags'])


def make(extra: dict[str, object] | None = None) -> Pipeline:
    """Make a filter with short blocks."""
    return Pipeline(FilterParameters().changed(SHORT | (extra or {})))


def run(messages: Iterable[Any], extra: dict[str, object] | None = None) -> list[SplitCloud]:
    """Filter a recording; each message has its one output, in order."""
    clean = make(extra)
    outputs: list[SplitCloud] = []
    count = 0
    for count, msg in enumerate(messages, 1):
        outputs += clean.process(msg, count - 1)
    outputs += clean.flush()
    assert [output.tag for output in outputs] == list(range(count))
    assert clean.statistics.refused == 0
    return outputs


def joined(outputs: Sequence[SplitCloud]) -> tuple[bytes, bytes]:
    """Join the bytes of all cleaned clouds, and of all outlier clouds."""
    return (
        b''.join(bytes(output.cleaned.data) for output in outputs),
        b''.join(bytes(output.outliers.data) for output in outputs),
    )


def assert_partition(msg: Any, output: SplitCloud) -> None:
    """Every point is in one of the two, with all its bytes, in order, under the same header."""
    points = point_bytes(msg)
    parts = [point_bytes(output.cleaned), point_bytes(output.outliers)]
    assert Counter(parts[0]) + Counter(parts[1]) == Counter(points)
    for part, result in zip(parts, (output.cleaned, output.outliers), strict=True):
        rest = iter(points)
        assert all(point in rest for point in part)
        assert (result.header, result.fields) == (msg.header, msg.fields)
        assert (result.height, result.width) == (1, len(part))
        assert result.row_step == len(result.data) == msg.point_step * len(part)
        assert result.is_bigendian == msg.is_bigendian


# Partition, and one output for each message -----------------------------------------------------


@BOTH_KINDS
@pytest.mark.parametrize('order', ['<', '>'])
@pytest.mark.parametrize(('chain', 'fewest'), [({}, 50), (DEFAULT, 5)], ids=['', 'default'])
def test_partition(
    kind: Callable[..., Any], order: str, chain: dict[str, object], fewest: int
) -> None:
    """Cleaned and outliers together are the input, for each message, empty ones included."""
    rows = drive(1)
    turned = rows.astype(rows.dtype.newbyteorder('<' if order == '<' else '>'))
    messages = [
        kind(cloud(part, STAMP + number, row_padding=number % 3))
        for number, part in enumerate([*cut(turned, 1, 40), turned[:0], turned[-1:]])
    ]
    before = [dump(msg) for msg in messages]
    outputs = run(messages, chain)
    for msg, output in zip(messages, outputs, strict=True):
        assert_partition(msg, output)
    assert [dump(msg) for msg in messages] == before
    assert min(msg.width for msg in messages) == 0
    assert sum(output.outliers.width for output in outputs) > fewest


@pytest.mark.parametrize('chain', [{}, DEFAULT], ids=['', 'default'])
def test_missing_returns_stay(chain: dict[str, object]) -> None:
    """Clouds of missing returns only are published, in their turn, with all of them in cleaned."""
    rows = drive(3)
    no_return = rows[:50].copy()
    no_return['x'], no_return['timestamp'] = np.nan, np.nan
    parts = [no_return, *cut(rows, 3, 10), no_return[:0], no_return, no_return]
    outputs = run([cloud(part) for part in parts], chain)
    for number in (0, -1, -2):
        assert (outputs[number].cleaned.width, outputs[number].outliers.width) == (50, 0)
    for part, output in zip(parts, outputs, strict=True):
        invalid = ~(np.isfinite([part[name] for name in 'xyz']).all(axis=0) & (part['x'] != 0))
        kept = np.array([values(output.cleaned, name) for name in 'xyz']).reshape(3, -1)
        missing_kept = ~np.isfinite(kept).all(axis=0) | (kept == 0).all(axis=0)
        assert np.count_nonzero(missing_kept) == np.count_nonzero(invalid)


@pytest.mark.parametrize('chain', [{}, DEFAULT], ids=['', 'default'])
def test_missing_returns_are_dropped(chain: dict[str, object]) -> None:
    """With `missing: drop` they alone are in neither cloud, and they are counted."""
    rows = drive(3)
    absent = rows[:50].copy()
    absent['x'] = np.nan
    messages = [cloud(part) for part in (absent, *cut(rows, 3, 10), rows[:0])]
    clean = make(chain | {'missing': 'drop'})
    outputs = [output for msg in messages for output in clean.process(msg)] + clean.flush()
    plain = run(messages, chain)
    dropped = 0
    for msg, output, kept in zip(messages, outputs, plain, strict=True):
        xyz = np.array([values(kept.cleaned, name) for name in 'xyz']).reshape(3, -1)
        valid = np.isfinite(xyz).all(axis=0) & (xyz != 0).any(axis=0)
        dropped += int(np.count_nonzero(~valid))
        assert bytes(output.cleaned.data) == plain_rows(kept.cleaned)[valid].tobytes()
        assert bytes(output.outliers.data) == bytes(kept.outliers.data)
        assert output.cleaned.is_dense
        assert output.cleaned.width + output.outliers.width <= msg.width
    assert clean.statistics.dropped == clean.statistics.invalid == dropped > 50


def test_organised_clouds_keep_missing_returns() -> None:
    """A cloud that keeps its shape has no place that it could leave out."""
    rows = drive(4)[:2000].reshape(4, -1).copy()
    rows['x'][0, :5] = np.nan
    (output,) = run([cloud(rows)], {'keep_organized': True, 'missing': 'drop'})
    assert structured(output.cleaned).shape == rows.shape


# Chunk invariance -------------------------------------------------------------------------------

WAYS: dict[str, dict[str, object]] = {
    'default': DEFAULT | {'boosted_trees.threshold': 0.7},
    'default by angle': DEFAULT | {'line_source': 'angle', 'boosted_trees.threshold': 0.5},
    'either': {},
    'both': dict(SMOOTHER),
    'sigma': {'alpha_beta_gamma.sigma': 0.02},
    'sigma of each point': {'sigma_field': 'std'},
    'few passes': {'alpha_beta_gamma.passes': 2},
    'late': {'lateness': 0.05},
    'angle': {'line_source': 'angle'},
    'angle field': {'line_source': 'angle', 'angle_field': 'x'},
    'lof': {'chain': ['lof']},
    'lof2': {'chain': ['lof'], 'lof.statistic': 'lof2', 'lof.threshold': 0.5},
    'sor': {'chain': ['sor'], 'sor.k': 5},
    'sor2': {'chain': ['sor'], 'sor.statistic': 'sor2', 'sor.limit': 0.3},
    'radius': {'chain': ['sor'], 'sor.statistic': 'radius', 'sor.range_scaled': True},
    'chain': {'chain': ['alpha_beta_gamma', 'lof', 'sor']},
    'hierarchical': {'chain': ['hierarchical'], 'hierarchical.min_cluster': 10},
    'elevation': {'chain': ['elevation'], 'elevation.k': 10, 'elevation.multiplier': 1.5},
    'scan_shadows': {'chain': ['scan_shadows'], 'scan_shadows.window': 2},
    'ring_outlier': {'chain': ['ring_outlier'], 'ring_outlier.distance_ratio': 1.01},
    'dual_return': {'chain': ['dual_return']},
    'crop_box': {'chain': ['crop_box'], 'crop_box.max_x': 9.0},
    'field_range': {
        'chain': ['field_range'],
        'field_range.field': 'std',
        'field_range.max_value': 0.03,
        'field_range.max_range': 8.0,
    },
    'boosted_trees of a scanner without rings': {
        'boosted_trees.sensor': 'free',
        'boosted_trees.threshold': 0.7,
    },
    'boosted_trees of a spinning sensor': {
        'boosted_trees.sensor': 'spinning',
        'boosted_trees.threshold': 0.7,
    },
    'mixed pixels': {
        'chain': ['boosted_trees', 'mixed_pixels'],
        'boosted_trees.sensor': 'spinning',
        'boosted_trees.threshold': 0.7,
        'mixed_pixels.threshold': 0.8,
    },
    'vote': {'chain': ['alpha_beta_gamma', 'lof'], 'vote': 2},
    'quadric': {'chain': ['quadric']},
    'patches': {'chain': ['quadric'], 'quadric.window': 'patch', 'quadric.significance': 1e-3},
    'quadric in a chain': {'chain': ['alpha_beta_gamma', 'quadric', 'lof', 'sor']},
    'quadric votes': {'chain': ['alpha_beta_gamma', 'quadric', 'lof'], 'vote': 2},
}


def scene(way: str, seed: int, shots: int) -> Rows:
    """Make a drive: with two returns, or for lines by angle of a mirror, 61 shots for a turn."""
    if 'dual' in way:
        rows = np.repeat(drive(seed, shots), 2)
        for axis in 'xyz':
            rows[axis][1::2] *= 1.5
        return rows
    if 'angle' not in way:
        return drive(seed, shots)
    rows = drive(seed, shots * 2, rings=1)
    turn = rows['tick'] / 200_000 * (2 * np.pi / 61)
    valid = np.isfinite(rows['x']) & (rows['x'] != 0)
    radius = np.where(valid, np.abs(rows['x']), 0)  # nothing is behind the mirror
    rows['y'], rows['z'] = radius * np.cos(turn), radius * np.sin(turn)
    rows['x'][valid] = (turn[valid] % (2 * np.pi)) if 'field' in way else 1
    return rows


@pytest.mark.parametrize('way', WAYS)
def test_chunk_invariance(way: str) -> None:
    """Cut into messages in any way, the same points get the same verdicts, bit for bit."""
    rows = scene(way, seed=10, shots=600)
    extra = WAYS[way] | {'scores': True}
    whole = run([cloud(rows)], extra)
    expected = joined(whole)
    assert 20 < whole[0].outliers.width < len(rows) / 2  # some, and most are kept
    single = [cloud(rows[i : i + 1]) for i in range(min(len(rows), 400))]
    assert joined(run(single, extra)) == joined(run([cloud(rows[:400])], extra))
    for seed, cuts in enumerate([1, 5, 20, 100]):
        parts = cut(rows, seed, cuts)
        stamps = STAMP + np.random.default_rng(seed).integers(-SECOND, SECOND, len(parts))
        messages = [cloud(part, int(t)) for part, t in zip(parts, stamps, strict=True)]
        assert joined(run(messages, extra)) == expected
        plain = joined(run(messages, WAYS[way]))
        step = 37 + BYTES_OF_SCORES
        assert [part[:37] for part in chunks(expected[0], step)] == chunks(plain[0], 37)
        assert [part[:37] for part in chunks(expected[1], step)] == chunks(plain[1], 37)


def chunks(data: bytes, size: int) -> list[bytes]:
    """Cut bytes into points."""
    return [data[i : i + size] for i in range(0, len(data), size)]


@pytest.mark.parametrize('way', ['default', 'either', 'both'])
def test_chunk_invariance_of_a_real_recording(recordings: Path, way: str) -> None:
    """The parts of a VLP-16's revolutions, each with the stamp of the whole, give the same."""
    with AnyReader([recordings / 'bags' / 'vlp16_mrpt.bag']) as reader:
        messages = [
            reader.deserialize(data, connection.msgtype)
            for connection, _, data in reader.messages()
            if connection.msgtype.endswith('PointCloud2')
        ]
    assert len(messages) == 4
    extra = DEFAULT | {'boosted_trees.threshold': 0.5, 'scores': True}  # enough to compare
    if way != 'default':
        extra = {'alpha_beta_gamma.sides': way, 'scores': True}
    whole = run(messages, extra)
    expected = joined(whole)
    assert len(expected[1]) > 1000
    for seed, cuts in enumerate([3, 40]):
        parts = [
            part_of(msg, rows.reshape(1, -1))
            for msg in messages
            for rows in cut(structured(msg).reshape(-1), seed, cuts)
        ]
        assert joined(run(parts, extra)) == expected


def part_of(msg: Any, rows: Rows) -> Any:
    """Make a message like another with some of its points."""
    part = copy.copy(msg)
    part.height, part.width = rows.shape
    part.row_step = part.width * part.point_step
    part.data = np.frombuffer(rows.tobytes(), np.uint8)
    return part


def test_same_input_same_output() -> None:
    """Once more, by the same filter or another, and nothing is different."""
    messages = [cloud(part) for part in cut(drive(13), 13, 30)]
    clean = make({'scores': True})
    outcomes = []
    for _ in range(3):
        outputs = [output for msg in messages for output in clean.process(msg)]
        outcomes.append(joined(outputs + clean.flush()))
    assert outcomes[0] == outcomes[1] == outcomes[2] == joined(run(messages, {'scores': True}))


# Bounded delay and memory -----------------------------------------------------------------------


@pytest.mark.parametrize('kind', ['points', 'missing', 'empty', 'late'])
def test_nothing_is_kept(kind: str) -> None:
    """A message that is published, or refused, is released."""
    clean = make({'line_source': 'message'})
    alive: list[weakref.ref[Any]] = []
    most = 0
    for number in range(1500):
        rows = table(0 if kind == 'empty' else 8, t=('u4', range(0 if kind == 'empty' else 8)))
        rows['x'] = 0 if kind == 'missing' else 1
        back = 200 * (number % 2) if kind == 'late' else 0
        msg = to_rosbags(cloud(rows, STAMP + (number - back) * 1_000_000))
        alive = [there for there in alive if there() is not None]
        alive.append(weakref.ref(msg))
        try:
            clean.process(msg)
        except CloudError:
            assert kind == 'late'
        del msg
        most = max(most, len(alive))
    assert most <= 40
    assert (clean.statistics.refused > 500) == (kind == 'late')


def test_published_within_halo() -> None:
    """A message is published at the first point that is a block and a halo later."""
    clean = make({'line_source': 'field'})
    rows = table(1, ring=('u1', 0), timestamp=('u8', 0))
    asked: dict[int, int] = {}
    for number in range(300):
        rows['timestamp'] = STAMP + number * 700_000
        asked[number] = STAMP + number * 700_000
        for output in clean.process(cloud(rows), number):
            waited = asked[number] - asked.pop(output.tag)
            assert waited <= 10_000_000 + 2_000_000 + 700_000
    assert len(asked) < 20


# Time that goes astray --------------------------------------------------------------------------


@pytest.mark.parametrize('shift', [-5, 5, 3600 * 24 * 365])
@pytest.mark.parametrize('way', ['either', 'angle'])
def test_clock_is_set(way: str, shift: int) -> None:
    """A clock that jumps loses nothing: both sides are as two recordings."""
    before, after = scene(way, 15, 400), scene(way, 16, 400)
    after['timestamp'] += shift
    extra = WAYS[way] | {'scores': True}
    parts = [[cloud(part) for part in cut(rows, 15, 20)] for rows in (before, after)]
    expected = [joined(run(part, extra)) for part in parts]
    clean = make(extra)
    outputs = [output for msg in parts[0] + parts[1] for output in clean.process(msg)]
    outputs += clean.flush()
    assert len(outputs) == len(parts[0] + parts[1])
    assert joined(outputs) == (expected[0][0] + expected[1][0], expected[0][1] + expected[1][1])
    assert clean.statistics.resets == int(shift < 0)


# Statistics and changes -------------------------------------------------------------------------


def test_statistics() -> None:
    """The counts add up, and are those of the clouds."""
    rows = drive(20)
    messages = [cloud(part) for part in cut(rows, 20, 30)]
    clean = make({'scores': True})
    outputs = [output for msg in messages for output in clean.process(msg)] + clean.flush()
    counts = clean.statistics
    scores = [
        s for a in outputs for c in (a.cleaned, a.outliers) for s in values(c, 'outlier_score')
    ]
    xyz = np.array([rows[name] for name in 'xyz'])
    invalid = ~np.isfinite(xyz).all(axis=0) | (xyz == 0).all(axis=0)
    assert counts.messages == 31
    assert counts.points == len(rows)
    assert counts.invalid == np.count_nonzero(invalid) > 0
    assert counts.untested == np.count_nonzero(np.isnan(scores)) - counts.invalid > 0
    assert counts.outliers == sum(output.outliers.width for output in outputs) > 0
    assert counts.rejected == {'alpha_beta_gamma': counts.outliers}
    assert (counts.refused, counts.resets) == (0, 0)


def test_change() -> None:
    """New parameters apply from the next block; pending clouds keep their output layout."""
    rows = drive(21)
    parts = np.split(rows, [700, 1400])
    clean = make()
    outputs = clean.process(cloud(parts[0]), 'plain')
    tolerant: dict[str, object] = {'scores': True, 'alpha_beta_gamma.sigma': 0.5}
    clean.change(clean.parameters.changed(tolerant))
    assert clean.parameters.scores
    outputs += clean.process(cloud(parts[1]), 'scored')
    outputs += clean.process(cloud(parts[2]), 'scored')
    outputs += clean.flush()
    assert [output.tag for output in outputs] == ['plain', 'scored', 'scored']
    assert [len(output.cleaned.fields) - 7 for output in outputs] == [0, 4, 4]
    expected = run([cloud(rows)], tolerant)[0].outliers.width
    plain = run([cloud(rows)])[0].outliers.width
    found = sum(output.outliers.width for output in outputs)
    assert expected < found < plain


def test_change_while_the_slow_detectors_are_off() -> None:
    """They stay off, of the new chain too, until they are to be on; what is counted is true."""
    pair = ('alpha_beta_gamma', 'sor')
    values = {'chain': pair, 'block': 0.01, 'halo': 0.0, 'sor.multiplier': 0.0}
    clean = Pipeline(FilterParameters().changed(values))

    def found(first: int) -> list[int]:
        outputs = [
            output for i in range(first, first + 3) for output in clean.process(line(0.01 * i))
        ]
        return [output.outliers.width for output in [*outputs, *clean.flush_pending()]]

    clean.degrade(on=True)
    assert found(0) == [1, 1, 1]
    clean.change(clean.parameters.changed({'gap_factor': 2.5}))
    assert found(3) == [1, 1, 1]
    assert clean.statistics.degraded == 6
    clean.change(clean.parameters.changed({'chain': ('sor',)}))  # nothing of it is fast
    found(6)
    assert clean.statistics.degraded == 6
    clean.change(clean.parameters.changed({'chain': pair}))
    assert found(9) == [1, 1, 1]
    clean.degrade(on=False)
    assert min(found(12)) > 10
    assert clean.statistics.degraded == 9


@pytest.mark.parametrize('name', ['block', 'time_field', 'max_points'])
def test_change_of_what_is_fixed(name: str) -> None:
    """A parameter that shapes the stream is refused, and nothing is changed."""
    clean = make()
    value = {'block': 0.02, 'time_field': 't', 'max_points': 5}[name]
    before = clean.parameters
    with pytest.raises(ParameterError, match=f'^{name} must be .* \\(read-only\\), got {value!r}$'):
        clean.change(before.changed({name: value, 'scores': True}))
    assert clean.parameters is before
