# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The data of a report: counts are those of replays, points are unpacked as they were packed."""

import base64
import json
from collections.abc import Mapping
from dataclasses import replace
from itertools import accumulate, pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.clouds import cloud, to_bytes
from helpers.drives import BEGIN, FAST, PERIOD, rows_of_turn, write_messages
from helpers.profile_scanner import REPLAYED, Recorded, WithoutFirstPoses
from helpers.report_pages import positions, read_message
from matplotlib import colormaps

from lidar_outlier_filter.cli.evaluate import read_recording
from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.points.columns import INTENSITIES
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.errors import FilterError, RecordingError
from lidar_outlier_filter.evaluation.judged import CAUSES
from lidar_outlier_filter.evaluation.labels import ALL_BUT_0
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.parameters.yaml_files import read_yaml
from lidar_outlier_filter.pipeline.topics import CLOUD
from lidar_outlier_filter.recordings.info import describe_recording
from lidar_outlier_filter.recordings.recorded_clouds import RecordedClouds
from lidar_outlier_filter.recordings.replay import replay
from lidar_outlier_filter.report import steps, worst
from lidar_outlier_filter.report.chains import MAX_IN_BLOCK, NEAR_SCORE, SharedInputs, features
from lidar_outlier_filter.report.gather import Gathered, gather
from lidar_outlier_filter.report.page import colour_maps, header, messages, parameter_file
from lidar_outlier_filter.report.points import LIVE, SCORE_UNIT, UNTESTED, reason_numbers, thin
from lidar_outlier_filter.report.sources import FileSource, RecordedSource, saved_columns
from lidar_outlier_filter.report.steps import MAX_FACTOR, STEP_BITS, all_values, choose_steps
from lidar_outlier_lab.simulation.scenes.demo_street import snow_drive
from lidar_outlier_lab.simulation.world.recording import record

MAX_POINTS = 10**6
PAIR = ['sor', 'alpha_beta_gamma']


def replayed(recording: Path, output: Path, values: Mapping[str, object]) -> int:
    """Count the points that a replay rejects."""
    (topic,) = replay(recording, output, parameters=values).topics
    return topic.rejected


def bits_at(found: Gathered, slider: int, step: int) -> int:
    """Count the kept points with the bit of a step."""
    bit = found.sliders[slider].first + step
    return int(np.count_nonzero(found.points['bits'] >> np.uint32(bit) & np.uint32(1)))


# --- Steps of sliders --------------------------------------------------------------------------


def test_every_step_counts_what_a_replay_rejects(
    found: Gathered, snow: Path, tmp_path: Path
) -> None:
    """Steps of the default are counted from one judging, from half of the points to none."""
    (slider,) = found.sliders
    assert STEP_BITS - 3 <= len(slider.values) <= STEP_BITS
    for step in range(0, len(slider.values), 4):
        rejected = replayed(snow, tmp_path / str(step), {slider.name: slider.values[step]})
        assert found.counts[0][step].points == bits_at(found, 0, step) == rejected
    many = np.array([counts.points for counts in found.counts[0]])
    assert (np.diff(many) < 0).all()
    assert many[-1] == 0
    tested = found.all.points - found.tally.untested
    assert 0.4 * tested < many[0] <= 0.5 * tested


def test_steps_that_scores_do_not_determine_are_judged(
    found: Gathered, snow: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where every score is as close to a limit as rounding, the counts are the same."""
    monkeypatch.setattr(steps, 'SCORE_TOLERANCE', 10.0)
    judged = gather(RecordedSource(snow, FilterParameters()), CAUSES, MAX_POINTS)
    assert np.array_equal(judged.points['bits'], found.points['bits'])
    for one, other in zip(judged.counts[0], found.counts[0], strict=True):
        assert (one.points, one.bad, one.good) == (other.points, other.bad, other.good)
        assert (one.detectors, one.clouds) == (other.detectors, other.clouds)
        assert one.by_range.tolist() == other.by_range.tolist()


@pytest.mark.parametrize(('chain', 'vote'), [(PAIR, 2), (['sor', 'boosted_trees'], 0)])
def test_steps_of_a_chain(tmp_path: Path, chain: list[str], vote: int) -> None:
    """Each step of each detector is judged."""
    snow = tmp_path / 'snow'
    record(replace(snow_drive(), lines=1), snow, lines_per_message=1)
    values = {'chain': chain, 'vote': vote}
    found = gather(RecordedSource(snow, FilterParameters().changed(values)), CAUSES, MAX_POINTS)
    assert [slider.detector for slider in found.sliders] == chain
    for number, slider in enumerate(found.sliders):
        for step in (0, len(slider.values) - 1):
            changed = {**values, slider.name: slider.values[step]}
            rejected = replayed(snow, tmp_path / f'{number}-{step}', changed)
            assert found.counts[number][step].points == bits_at(found, number, step) == rejected
    # What the default rejects of what others left is explained.
    explained = (found.points['why'] != 0).any(axis=1) & found.points['rejected']
    by_trees = DETECTORS['boosted_trees'].bit if 'boosted_trees' in chain else 0
    assert set(found.points['detectors'][explained].tolist()) == ({by_trees} if by_trees else set())


@pytest.mark.parametrize('count', [1, 3, len(DETECTORS)])
def test_sliders_share_the_bits(count: int) -> None:
    """In any chain no bit is used twice, and the given value is among the values, in order."""
    parameters = FilterParameters().changed({'chain': list(DETECTORS)[:count]})
    possible = all_values(parameters)
    rng = np.random.default_rng(count)
    rejected = [np.sort(rng.integers(0, 900, len(one.values)))[::-1] for one in possible]
    chosen = choose_steps(possible, rejected, 1000)
    used = [one.first + step for one in chosen for step in range(len(one.values))]
    assert len(used) == len({*used})
    assert max(used) < STEP_BITS
    for slider in chosen:
        assert slider.values[slider.given] == parameters.flat()[slider.name]
        assert (np.diff(slider.limits) > 0).all()
        assert slider.limits[slider.given] == 1
        assert slider.limits[0] >= 1 / MAX_FACTOR
    # No other value is a multiple of a threshold of 0.
    (one,) = all_values(FilterParameters().changed({'chain': ['sor'], 'sor.multiplier': 0.0}))
    (slider,) = choose_steps([one], [np.zeros(len(one.values), np.int64)], 1000)
    assert slider.values[0] == 0
    assert len(slider.values) > 5


@pytest.mark.parametrize('name', ['xyz', 't', 'line'])
def test_chains_share_neighbours_of_equal_points_only(name: str) -> None:
    """One value of one point differs: the neighbours are found again; verdicts are the same."""
    rng, n = np.random.default_rng(0), 500
    points = Points(
        rng.normal(0, 1, (n, 3)), np.arange(n), np.arange(n) // 50, np.ones(n, np.bool_)
    )
    given, shared = FilterParameters().changed({'chain': ['sor']}), SharedInputs()
    seen = shared(points, given, 20, whole=False)
    assert shared(points.take(slice(None)), given, 20, whole=False) is seen
    assert shared(points, given, 20, whole=True) is not seen
    assert shared(points, given, 21, whole=False) is not seen
    other = points.take(np.arange(n))
    getattr(other, name)[7] += 1
    assert shared(other, given, 20, whole=False) is not seen
    chain = Chain(given)
    chain.see = shared
    for _ in range(2):
        assert chain.judge(points).score.tobytes() == Chain(given).judge(points).score.tobytes()


# --- Counts ------------------------------------------------------------------------------------


def test_truth_is_that_of_evaluate(found: Gathered, snow: Path, tmp_path: Path) -> None:
    """Found and lost points are those of a replay with scores; so are the scores."""
    replay(snow, tmp_path / 'out', parameters={'scores': True})
    points = read_recording(tmp_path / 'out')
    counts = found.counts[0][found.sliders[0].given]
    assert counts.bad == np.count_nonzero(points.bad & points.rejected)
    assert counts.good == np.count_nonzero(~points.bad & points.rejected)
    assert found.all.bad == np.count_nonzero(points.bad)
    assert points.score is not None
    sorted_ = np.sort(found.points['score']), np.sort(points.score)
    assert np.array_equal(*sorted_, equal_nan=True)


def test_thinned_points_are_counted_all_the_same(found: Gathered, snow: Path) -> None:
    """Rejected points stay, of the others an even sample; counts are of all."""
    thin = gather(RecordedSource(snow, FilterParameters()), CAUSES, 20_000)
    assert len(thin.points) == 20_000 < len(found.points)
    rejected = [np.count_nonzero(one.points['rejected']) for one in (thin, found)]
    assert rejected[0] == rejected[1]
    assert [one.points for one in thin.counts[0]] == [one.points for one in found.counts[0]]
    share = np.bincount(thin.points['cloud'][~thin.points['rejected']])
    assert share.min() > 0.4 * share.sum()
    known = header(thin)
    assert (known['drawn'], known['all']['points']) == (20_000, len(found.points))


def test_moved_points(tmp_path: Path) -> None:
    """Steps count what replays reject, also of clouds without poses; labels come from files."""
    recorded = Recorded(tmp_path, WithoutFirstPoses(0.6))
    parameters = FilterParameters().changed(REPLAYED)
    found = gather(
        RecordedSource(recorded.bag, parameters, files=recorded.files), ALL_BUT_0, MAX_POINTS
    )
    (slider,) = found.sliders
    for step in (0, slider.given, len(slider.values) - 1):
        changed = {**REPLAYED, slider.name: slider.values[step]}
        assert found.counts[0][step].points == replayed(recorded.bag, tmp_path / str(step), changed)
    assert found.all.bad == np.count_nonzero(recorded.drive.wrong)
    assert (found.found.moved, found.found.without_pose) == (True, 3)
    assert found.frames.together
    # The path of the sensor: where the first point of each cloud was measured from.
    clouds = RecordedClouds(recorded.bag, parameters, with_eyes=True)
    eyes = [taken.eye[0, 0] for taken in clouds if taken.eye is not None and len(taken.eye)]
    assert np.abs(np.array(found.found.path) - eyes).max() < 0.2
    assert len(header(found)['path']) == len(eyes) == 3
    few = RecordedSource(recorded.bag, parameters, files=recorded.files[:-1])
    with pytest.raises(RecordingError, match='files with labels'):
        gather(few, ALL_BUT_0, MAX_POINTS)


def test_gaps_and_refused_clouds(tmp_path: Path) -> None:
    """The page, ``info`` and the archive agree where clouds are missing; refused ones are not."""
    hundredths = [10, 10, 10, 17, 10, 20, 21, 10, 10, 10, 45, 10]
    times = [BEGIN + step * PERIOD // 10 for step in accumulate(hundredths, initial=0)]
    clouds = [to_bytes(cloud(rows_of_turn(number), time)) for number, time in enumerate(times)]
    clouds[8] = b'broken'
    messages = [('/lidar', time, data) for time, data in zip(times, clouds, strict=True)]
    write_messages(tmp_path / 'drive', {'/lidar': CLOUD}, messages)
    source = RecordedSource(tmp_path / 'drive', FilterParameters().changed(FAST))
    known = gather(source, ALL_BUT_0, MAX_POINTS)
    shown = header(known)
    (counted,) = describe_recording(tmp_path / 'drive').topics.values()
    (topic_report,) = replay(tmp_path / 'drive', tmp_path / 'out', parameters=FAST).topics
    assert shown['gaps'] == [[pytest.approx(1.28), 0.45], [pytest.approx(0.77), 0.21]]
    assert counted.gaps == topic_report.gaps == len(shown['gaps'])
    assert 1 / shown['period'] == counted.rate == pytest.approx(10, rel=0.0003)
    assert known.found.refusals == topic_report.refusals
    assert sum(known.found.refusals.values()) == 1


# --- What the page gets ------------------------------------------------------------------------


def test_points_are_unpacked_as_they_were(found: Gathered) -> None:
    """Positions within half a step, scores within half a unit; exact values in the columns."""
    (content,) = messages(found)
    known, parts, columns = read_message(content)
    points, frames = found.points, known['frames']
    for frame, words, (begin, end) in zip(frames, parts, pairwise(found.frames.first), strict=True):
        apart = np.abs(positions(frame, words) - points['xyz'][begin:end])
        assert (apart <= 0.5001 * np.array(frame['step'])).all()
        assert max(frame['step']) < 0.001
        ranks = np.unique(points['line'][begin:end], return_inverse=True)[1]
        assert np.array_equal(words[:, 3] >> STEP_BITS, ranks)
        marked = points['bits'][begin:end] != 0
        assert marked[: frame['marked']].sum() == marked.sum()
    word, last = np.concatenate(parts)[:, 2:].T
    score = word & 0x3FF
    tested = score < UNTESTED - 1
    assert np.array_equal(score == UNTESTED, np.isnan(points['score']))
    assert points['score'][tested] == pytest.approx(score[tested] / SCORE_UNIT, abs=0.51 / 256)
    reasons = (word >> 17) & 0x7F
    assert np.array_equal(reasons, reason_numbers()[points['reason']])
    assert np.array_equal(reasons != 0, points['rejected'])
    assert np.array_equal(last & ((1 << STEP_BITS) - 1), points['bits'])
    assert np.array_equal((word >> 28) & 3, points['truth'])
    assert np.array_equal(columns['intensity'], points['intensity'])
    assert np.array_equal(columns['time'], points['t'])
    exact = columns['score'][points['rejected']]
    assert np.array_equal(exact, points['score'][points['rejected']])
    assert sorted(columns['index'][: frames[0]['count']].tolist()) == list(
        range(frames[0]['count'])
    )


@pytest.mark.parametrize('name', INTENSITIES)
def test_names_of_intensity(name: str) -> None:
    """A page has the intensity that detectors read, by whatever name."""
    assert saved_columns(['X', name.upper()]) == {'intensity': name.upper()}


def test_rejected_points_are_explained(found: Gathered) -> None:
    """As many as are explained at once; the strongest feature first, in words."""
    why, added = found.points['why'], found.points['added']
    explained = (why != 0).any(axis=1)
    assert MAX_IN_BLOCK < explained.sum() <= 2 * MAX_IN_BLOCK
    assert found.points['rejected'][explained].mean() > 0.99  # then those that nearly are
    assert (np.diff(added[explained], axis=1) <= 0).all()
    assert (added[why != 0] > 0).all()
    listed = header(found)['features']
    assert len(listed) == len(features())
    assert all(len(text.split()) > 1 for _, text in listed)
    (slider,) = found.sliders
    known = header(found)['sliders'][0]
    for step, counts in enumerate(known['counts']):
        # No reason is noted of a point that is kept at the given settings.
        reasons = sum(count for _, count in counts['reasons'])
        assert reasons <= counts['points']
        assert reasons >= 0.99 * counts['points'] or step < slider.given


def test_header_is_json(found: Gathered) -> None:
    """Counts of frames, ranges and detectors add up."""
    known = header(found)
    assert json.loads(json.dumps(known, allow_nan=False)) == known
    (content,) = messages(found)
    assert sum(frame['points'] for frame in read_message(content)[0]['frames']) == found.all.points
    (slider,) = known['sliders']
    for counts, by_frame in zip(slider['counts'], slider['byFrame'], strict=True):
        assert sum(by_frame) == counts['points'] == sum(counts['ranges'])
        assert sum(counts['detectors'].values()) == counts['points']


def test_colours_are_those_of_matplotlib() -> None:
    """Byte for byte, though the page does not import it."""
    for name, text in colour_maps().items():
        table = colormaps[name](range(256), bytes=True)[:, :3]
        assert base64.b64decode(text) == table.tobytes()


def test_parameter_file_is_read_back(tmp_path: Path) -> None:
    """By the reader of the other commands."""
    path = tmp_path / 'some.yaml'
    for values in ({'chain': PAIR, 'lof.threshold': 1e-3, 'halo': 0.02}, {}):
        parameters = FilterParameters().changed(values)
        path.write_text(parameter_file(parameters), encoding='utf-8')
        assert FilterParameters().changed(read_yaml(path)) == parameters


# --- Files -------------------------------------------------------------------------------------


def test_a_file(tmp_path: Path) -> None:
    """A file without times is judged in one piece; points at NaN are missing."""
    rng = np.random.default_rng(2)
    xyz = rng.uniform((-20, -20, 0), (20, 20, 0.02), (3000, 3))
    xyz[7] = 1, 2, 6
    xyz[8] = np.nan
    path = tmp_path / 'floor.xyz'
    np.savetxt(path, xyz, '%.4f', header='x y z', comments='')
    found = gather(FileSource(path, FilterParameters(), truth=(path, '')), ALL_BUT_0, MAX_POINTS)
    assert found.parameters.chain == ('boosted_trees',)
    assert found.found.invalid == 1
    assert found.points['rejected'][found.points['index'] == 7].all()
    assert 8 not in found.points['index']
    smoother = FilterParameters().changed({'chain': ['alpha_beta_gamma']})
    with pytest.raises(FilterError, match='without alpha_beta_gamma'):
        FileSource(path, smoother, truth=(path, ''))


def test_the_worst_come_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """Large groups first, then high scores; cells that touch by a corner are one group."""
    for step, groups in (((1, 1, 1), 1), ((2, 0, 0), 2), ((2, 1, 1), 2)):
        xyz = np.array([[0.5, 0.5, 0.5], np.add(step, 0.5)]) * 0.3
        assert len(np.unique(worst.connect(xyz, 0.3))) == groups
    monkeypatch.setattr(worst, 'typical_scale', lambda *_: 1.0)
    x = np.array([0, 10, 10.5, 20, 30, 30.5, 40], float)  # groups of 1, 2, 1, 2, 1
    zeros = np.zeros(len(x), np.int64)
    judged: Any = SimpleNamespace(
        loaded=SimpleNamespace(points=Points(np.c_[x, x * 0, x * 0], zeros, zeros, zeros == 0)),
        verdict=Verdict.untested(len(x)),
        high=np.zeros(len(x), np.bool_),
        units=np.ones(3),
    )
    judged.verdict.rejected[:] = True
    judged.verdict.score[:] = [5, 2, 3, 9, 4, 1, 7]
    members = [group.members.tolist() for group in worst.find(judged).groups]
    assert members == [[4, 5], [1, 2], [3], [6], [0]]


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
    requested = {'map.svg', 'map.png', 'over_time.svg', 'scores.png', 'roc.svg', 'thresholds.svg'}
    assert requested <= {path.name for path in folder.iterdir()}
    assert main([*arguments, *options]) == 1
    assert main(['report', str(snow), '--points', '0', '--output', str(tmp_path / 'x')]) == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ['figures', 'report.html']


def test_points_near_the_threshold_are_kept_before_others() -> None:
    """Of too many points the rejected ones stay, then those near the threshold, then a sample."""
    rows = np.zeros(90, LIVE)
    rows['score'] = np.repeat([0.0, (1 + NEAR_SCORE) / 2, 2.0], 30)
    rows['rejected'] = rows['score'] > 1
    rows['order'] = np.random.default_rng(5).permutation(90)
    for most, scores in ((40, [2.0, (1 + NEAR_SCORE) / 2]), (70, [2.0, (1 + NEAR_SCORE) / 2, 0.0])):
        kept = np.sort(thin(rows, most)['score'])[::-1]
        expected = np.repeat(scores, 30)[:most].astype(np.float32)
        np.testing.assert_array_equal(kept, expected)
