# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The data of a report: counts are those of replays, points are packed as they are unpacked."""

from __future__ import annotations

import base64
import json
from dataclasses import replace
from itertools import accumulate
from typing import TYPE_CHECKING

import numpy as np
import pytest
from helpers.drives import BEGIN, FAST, PERIOD, cloud_bytes, rows_of_turn, topic_of
from matplotlib import colormaps

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.core.detectors.boosted_trees.explain.explanation import EXPLANATION
from lidar_outlier_filter.core.detectors.boosted_trees.explain.pattern_reasons import REASONS
from lidar_outlier_filter.core.detectors.boosted_trees.explain.reasons import REASON_NAMES
from lidar_outlier_filter.core.detectors.boosted_trees.pattern.profile_features import PROFILE
from lidar_outlier_filter.core.detectors.boosted_trees.survey.far import NAMES
from lidar_outlier_filter.core.detectors.boosted_trees.weighted_sum.detector import PARTS
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation.judged import CAUSES, read_recording
from lidar_outlier_filter.evaluation.labels import ALL_BUT_0
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.parameters.yaml_files import read_yaml
from lidar_outlier_filter.pipeline.topics import CLOUD
from lidar_outlier_filter.recordings.bags import NewBag
from lidar_outlier_filter.recordings.info import look
from lidar_outlier_filter.recordings.replay import replay
from lidar_outlier_filter.report import keeping, score_counts
from lidar_outlier_filter.report.frames import cut
from lidar_outlier_filter.report.gather import gather
from lidar_outlier_filter.report.header import header, parameter_file, split
from lidar_outlier_filter.report.pack import SCORE_UNIT, STEPS, UNTESTED, pack, reason_names
from lidar_outlier_filter.report.page import colour_maps
from lidar_outlier_filter.report.reasons import MOST_IN_BLOCK, STRONGEST
from lidar_outlier_filter.report.sliders import BITS, WIDEST, choices, sliders
from lidar_outlier_filter.report.sources import FileSource, RecordedSource
from lidar_outlier_lab.simulation.scenes.demo_street import snow_drive
from lidar_outlier_lab.simulation.world.recording import record

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from lidar_outlier_filter.report.gather import Gathered

MOST = 10**6
PAIR = ['sor', 'alpha_beta_gamma']


def replayed(recording: Path, output: Path, values: Mapping[str, object]) -> int:
    """Count the points that a replay rejects."""
    (topic,) = replay(recording, output, parameters=values).topics
    return topic.rejected


def test_every_step_counts_what_a_replay_rejects(
    found: Gathered, snow: Path, tmp_path: Path
) -> None:
    """Of the default, whose threshold only divides its score: all from one judging."""
    (slider,) = found.sliders
    assert BITS - 3 <= len(slider.values) <= BITS
    for step in range(0, len(slider.values), 3):
        values = {slider.name: slider.values[step]}
        counts = found.tally.at[0][step]
        assert counts.points == replayed(snow, tmp_path / str(step), values)
        bits = found.kept.bits & np.uint32(1 << (slider.first + step))
        assert np.count_nonzero(bits) == counts.points


def test_scale_of_the_slider_follows_the_scores(found: Gathered) -> None:
    """From half of the points to none; every step counts others, and none is far from the next."""
    many = np.array([counts.points for counts in found.tally.at[0]])
    assert (np.diff(many) < 0).all()
    assert many[-1] == 0
    tested = found.tally.all.points - found.tally.untested
    assert 0.4 * tested < many[0] <= 0.5 * tested
    (slider,) = found.sliders
    assert (
        slider.limits[-2]
        < np.nanmax(found.kept.score)
        <= slider.limits[-1]
        < 1.1 * slider.limits[-2]
    )


def test_steps_that_scores_do_not_say_are_judged(
    found: Gathered, snow: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where every score is as near to a limit as rounding, the answer is the same."""
    monkeypatch.setattr(score_counts, 'ROUNDING', 10.0)
    judged = gather(RecordedSource(snow, FilterParameters()), CAUSES, MOST)
    assert np.array_equal(judged.kept.bits, found.kept.bits)
    for step, other in zip(judged.tally.at[0], found.tally.at[0], strict=True):
        assert (step.points, step.bad, step.good) == (other.points, other.bad, other.good)
        assert (step.detectors, step.by_range.tolist()) == (
            other.detectors,
            other.by_range.tolist(),
        )
    assert judged.tally.by_cloud == found.tally.by_cloud


@pytest.mark.parametrize(
    ('chain', 'vote'),
    [
        (PAIR, 0),
        (PAIR, 2),
        pytest.param(['alpha_beta_gamma', 'quadric', 'lof'], 0, marks=pytest.mark.slow),
    ],
)
def test_steps_of_a_chain(tmp_path: Path, chain: list[str], vote: int) -> None:
    """Of detectors one after the other, or together: each step is judged."""
    snow = tmp_path / 'snow'
    record(replace(snow_drive(), lines=1), snow, lines_per_message=1)
    values = {'chain': chain, 'vote': vote}
    parameters = FilterParameters().changed(values)
    found = gather(RecordedSource(snow, parameters), CAUSES, MOST)
    assert [slider.detector for slider in found.sliders] == chain
    for number, slider in enumerate(found.sliders):
        assert slider.first + len(slider.values) <= BITS
        for step in (0, len(slider.values) - 1):
            changed = {**values, slider.name: slider.values[step]}
            rejected = replayed(snow, tmp_path / f'{number}-{step}', changed)
            assert found.tally.at[number][step].points == rejected
            bits = found.kept.bits & np.uint32(1 << (slider.first + step))
            assert np.count_nonzero(bits) == rejected


def test_truth_is_that_of_evaluate(found: Gathered, snow: Path, tmp_path: Path) -> None:
    """Found and lost at the given step are those of a replay with scores; so are the scores."""
    replay(snow, tmp_path / 'out', parameters={'scores': True})
    points = read_recording(tmp_path / 'out')
    counts = found.tally.at[0][found.sliders[0].given]
    assert counts.bad == np.count_nonzero(points.bad & points.rejected)
    assert counts.good == np.count_nonzero(~points.bad & points.rejected)
    assert found.tally.all.bad == np.count_nonzero(points.bad)
    assert points.score is not None
    same = np.array_equal(np.sort(found.kept.score), np.sort(points.score), equal_nan=True)
    assert same


def test_points_are_unpacked_as_they_were(found: Gathered) -> None:
    """Positions within half a step, scores within half a unit, steps and truth exactly."""
    frames = cut(found)
    packed, kept = pack(found, frames), found.kept.take(frames.order)
    a, b, word, last = packed.points.T
    number = np.repeat(np.arange(len(frames)), np.diff(frames.first))
    steps = np.stack([a & STEPS, (a >> 21) | ((b & 0x3FF) << 11), b >> 10], axis=1)
    position = packed.origin[number] + steps * packed.step[number]
    assert (np.abs(position - kept.xyz) <= 0.5001 * packed.step[number]).all()
    assert (packed.step < 0.001).all()
    score = word & 0x3FF
    assert np.array_equal(score == UNTESTED, np.isnan(kept.score))
    known = score < UNTESTED - 1
    assert kept.score[known] == pytest.approx(score[known] / SCORE_UNIT, abs=0.51 / SCORE_UNIT)
    names = [REASON_NAMES.get(one, '') for one in kept.strongest.tolist()]
    assert ['', *reason_names()][int(((word >> 17) & 0x7F)[0])] == names[0] != ''
    assert ((word >> 17) & 0x7F)[kept.rejected].all()
    assert not ((word >> 17) & 0x7F)[~kept.rejected].any()
    assert np.array_equal(last & ((1 << BITS) - 1), kept.bits)
    assert np.array_equal(
        (word >> 28) & 3, np.where(found.codes.bad(kept.code.astype(np.int64)), 2, 1)
    )
    for begin, end in zip(frames.first[:-1], frames.first[1:], strict=True):
        _, ranks = np.unique(kept.line[begin:end], return_inverse=True)
        assert np.array_equal(last[begin:end] >> BITS, ranks)


def test_reasons_stand_first_and_have_the_score(found: Gathered) -> None:
    """As many points as are explained at once, rejected ones first; the row has the score."""
    frames = cut(found)
    packed, kept = pack(found, frames), found.kept.take(frames.order)
    assert MOST_IN_BLOCK < len(packed.reasons) <= 2 * MOST_IN_BLOCK
    assert kept.rejected[kept.reason >= 0].all()
    rows = np.concatenate(
        [
            np.arange(first, first + count)
            for first, count in zip(frames.first[:-1], frames.explained, strict=True)
        ]
    )
    assert np.array_equal(np.flatnonzero(kept.reason >= 0), rows)
    assert np.array_equal(packed.reasons[:, 0], kept.score[rows])
    largest = np.abs(packed.reasons[:, 12 : 12 + STRONGEST])
    assert (np.diff(largest, axis=1) <= 0).all()


def test_reasons_of_a_chain(snow: Path) -> None:
    """Where the default judges what others left, its part of the chain is explained."""
    parameters = FilterParameters().changed({'chain': ['sor', 'boosted_trees']})
    found = gather(RecordedSource(snow, parameters), CAUSES, MOST)
    assert found.ways == ('trees on the scan pattern',)
    there = found.kept.reason >= 0
    assert (found.kept.detectors[there & found.kept.rejected] == 64).all()
    assert np.count_nonzero(there & found.kept.rejected) > 100


def test_reasons_are_bounded(snow: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a long recording an even sample is left."""
    monkeypatch.setattr(keeping, 'MOST_REASONS', 300)
    found = gather(RecordedSource(snow, FilterParameters()), CAUSES, MOST)
    there = found.kept.reason >= 0
    assert len(found.reasons) == np.count_nonzero(there) == 300
    assert np.bincount(found.kept.cloud[there]).min() > 100
    for row, score in zip(found.kept.reason[there], found.kept.score[there], strict=True):
        assert found.reasons[row].score == float(score)


def test_thinned_points_are_counted_all_the_same(found: Gathered, snow: Path) -> None:
    """The rejected stay, of the others an even sample; counts are those of all."""
    most = 20_000
    thin = gather(RecordedSource(snow, FilterParameters()), CAUSES, most)
    assert len(thin.kept) == most < len(found.kept)
    assert np.count_nonzero(thin.kept.rejected) == np.count_nonzero(found.kept.rejected)
    for step, other in zip(thin.tally.at[0], found.tally.at[0], strict=True):
        assert step.points == other.points
    share = np.bincount(thin.kept.cloud[~thin.kept.rejected])
    assert share.min() > 0.4 * share.sum()
    known = header(thin, cut(thin), pack(thin, cut(thin)))
    assert known['drawn'] == most
    assert known['all']['points'] == len(found.kept)


def test_colours_are_those_of_matplotlib() -> None:
    """Byte for byte, though the page does not import it."""
    maps = colour_maps()
    assert list(maps) == ['viridis', 'cividis']
    for name, text in maps.items():
        table = colormaps[name](range(256), bytes=True)[:, :3]
        assert base64.b64decode(text) == table.tobytes()


def test_header_is_json(found: Gathered) -> None:
    """No NaN in it; what it says of frames adds up."""
    frames = cut(found)
    known = header(found, frames, pack(found, frames))
    assert json.loads(json.dumps(known, allow_nan=False)) == known
    assert sum(frame['points'] for frame in known['frames']) == found.tally.all.points
    slider = known['sliders'][0]
    for step, by_frame in zip(slider['counts'], slider['byFrame'], strict=True):
        assert sum(by_frame) == step['points'] == sum(step['ranges'])
    assert known['sections'] == len(split(frames))


def test_gaps_are_those_of_info(tmp_path: Path) -> None:
    """The page, ``info`` and the archive agree where clouds are missing; refused ones are not."""
    steps = [10, 10, 10, 17, 10, 20, 21, 10, 10, 10, 45, 10]  # hundredths of a second
    times = [BEGIN + step * PERIOD // 10 for step in accumulate(steps, initial=0)]
    clouds = [cloud_bytes(rows_of_turn(number), time) for number, time in enumerate(times)]
    clouds[8] = b'broken'
    with NewBag(tmp_path / 'drive') as bag:
        bag.add(topic := topic_of('/lidar', CLOUD))
        for time, data in zip(times, clouds, strict=True):
            bag.write(topic, time, data)
    source = RecordedSource(tmp_path / 'drive', FilterParameters().changed(FAST))
    known = gather(source, ALL_BUT_0, MOST)
    shown = header(known, cut(known), pack(known, cut(known)))
    (counted,) = look(tmp_path / 'drive').topics.values()
    report = replay(tmp_path / 'drive', tmp_path / 'out', parameters=FAST)
    assert shown['gaps'] == [[pytest.approx(1.28), 0.45], [pytest.approx(0.77), 0.21]]
    assert counted.gaps == report.topics[0].gaps == len(shown['gaps'])
    assert 1 / shown['period'] == counted.rate == pytest.approx(10, rel=0.0003)
    assert sum(known.found.refusals.values()) == 1


def test_removed_points_are_counted_by_who_and_why(found: Gathered) -> None:
    """At every step by detector and strongest reason, in words; every feature has a text."""
    frames = cut(found)
    known = header(found, frames, pack(found, frames))
    (slider,) = known['sliders']
    for step, counts in enumerate(slider['counts']):
        assert counts['detectors'] == {'boosted_trees': counts['points']}
        listed = sum(count for _, count in counts['reasons'])
        assert listed <= counts['points']
        # Of what is kept at the given settings no reason is noted.
        assert listed >= 0.99 * counts['points'] or step < slider['given']
        assert listed < counts['points'] or step > 0
        assert all(known['reasonTexts'][number - 1] for number, _ in counts['reasons'])
    features = [(*REASONS, *PROFILE), NAMES, PARTS]
    assert [tuple(texts) for texts in EXPLANATION.ways.values()] == features
    every = [name for names in features for name in names]
    assert [name for name, _ in known['features']] == [*every, 'others', 'average']
    assert known['ofSum'] == len(every) - len(PARTS)


def test_parameter_file_is_read_back(tmp_path: Path) -> None:
    """By the reader of the other commands."""
    parameters = FilterParameters().changed({'chain': PAIR, 'lof.threshold': 1e-3, 'halo': 0.02})
    path = tmp_path / 'some.yaml'
    path.write_text(parameter_file(parameters), encoding='utf-8')
    assert FilterParameters().changed(read_yaml(path)) == parameters
    path.write_text(parameter_file(FilterParameters()), encoding='utf-8')
    assert FilterParameters().changed(read_yaml(path)) == FilterParameters()


@pytest.mark.parametrize('count', [1, 2, 3, 5, 7])
def test_sliders_share_the_bits(count: int) -> None:
    """Any chain: no bit is used twice, and the given value is among the values, in order."""
    chain = [
        'sor',
        'lof',
        'quadric',
        'elevation',
        'hierarchical',
        'boosted_trees',
        'alpha_beta_gamma',
    ]
    parameters = FilterParameters().changed({'chain': chain[:count]})
    given = choices(parameters)
    rng = np.random.default_rng(count)
    rejected = [np.sort(rng.integers(0, 900, len(one.values)))[::-1] for one in given]
    found = sliders(given, rejected, 1000)
    used = [one.first + step for one in found for step in range(len(one.values))]
    assert len(used) == len({*used})
    assert max(used) < BITS
    for slider in found:
        assert slider.values[slider.given] == parameters.flat()[slider.name]
        assert (np.diff(slider.limits) > 0).all()
        assert slider.limits[slider.given] == 1
        assert slider.limits[0] >= 1 / WIDEST


def test_slider_of_a_threshold_of_0() -> None:
    """No factor leads away from 0: other values are there all the same."""
    parameters = FilterParameters().changed({'chain': ['sor'], 'sor.multiplier': 0.0})
    (one,) = choices(parameters)
    (slider,) = sliders([one], [np.zeros(len(one.values), np.int64)], 1000)
    assert slider.values[0] == 0
    assert len(slider.values) > 5


def test_a_file(tmp_path: Path) -> None:
    """A file without times: it is judged in one piece; what is nowhere is no point."""
    rng = np.random.default_rng(2)
    xyz = rng.uniform((-20, -20, 0), (20, 20, 0.02), (3000, 3))
    xyz[7] = 1, 2, 6
    xyz[8] = np.nan
    path = tmp_path / 'floor.xyz'
    text = '\n'.join(' '.join(f'{value:.4f}' for value in row) for row in xyz)
    path.write_text(f'x y z\n{text}\n', encoding='utf-8')
    given = FilterParameters()
    found = gather(FileSource(path, given, truth=(path, '')), ALL_BUT_0, MOST)
    assert found.parameters.chain == ('boosted_trees',)
    assert found.found.invalid == 1
    assert found.kept.rejected[found.kept.index == 7].all()
    smoother = given.changed({'chain': ['alpha_beta_gamma']})
    with pytest.raises(FilterError, match='without alpha_beta_gamma'):
        FileSource(path, smoother, truth=(path, ''))


def test_command(snow: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A page and figures appear; neither is replaced."""
    page, folder = tmp_path / 'report.html', tmp_path / 'figures'
    arguments = ['report', str(snow), '--points', '5000']
    options = ['--output', str(page), '--figures', str(folder)]
    assert main([*arguments, *options]) == 0
    said = capsys.readouterr()
    assert '5000 of' in said.err
    assert str(page) in said.out
    text = page.read_text(encoding='utf-8')
    assert text.count('</script>') == text.count('<script')
    names = {path.name for path in folder.iterdir()}
    assert {
        'map.svg',
        'map.png',
        'over_time.svg',
        'scores.png',
        'roc.svg',
        'thresholds.svg',
    } <= names
    assert main([*arguments, *options]) == 1
    assert main(['report', str(snow), '--points', '0', '--output', str(tmp_path / 'x')]) == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ['figures', 'report.html']
