# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the tuner learns from: the verdicts are the node's own, and the truth belongs to them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.labelled import POINT, drive, write

from lidar_outlier_filter.cli.evaluate import read_recording
from lidar_outlier_filter.core.detectors import sor
from lidar_outlier_filter.errors import FilterError, JudgingError
from lidar_outlier_filter.evaluation.judged import CAUSES
from lidar_outlier_filter.evaluation.labels import Codes
from lidar_outlier_filter.evaluation.truth import Cause
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.recordings.replay import replay
from lidar_outlier_filter.tuning.inject import Injection
from lidar_outlier_filter.tuning.training import read_training, together
from lidar_outlier_lab.simulation.world.recording import to_message

DEFAULTS = FilterParameters()


def test_verdicts_are_those_of_a_replay(tmp_path: Path) -> None:
    """Counts of the tuner are those that the user's own replay and evaluation give."""
    bag = write(tmp_path / 'bag', {'/lidar': drive()})
    data = read_training(bag, DEFAULTS, CAUSES)
    mine = data.judge(DEFAULTS)
    replay(bag, tmp_path / 'out', parameters={'scores': True})
    points = read_recording(tmp_path / 'out')
    assert len(data) == len(points)
    assert np.count_nonzero(data.bad) == np.count_nonzero(points.bad)
    assert np.count_nonzero(mine.rejected) == np.count_nonzero(points.rejected) > 30
    assert points.score is not None
    np.testing.assert_array_equal(np.sort(mine.score), np.sort(points.score))
    both = np.count_nonzero(mine.rejected & data.bad)
    assert both == np.count_nonzero(points.rejected & points.bad)


def test_truth_and_stretches(tmp_path: Path) -> None:
    """Missing returns are left out; stretches are of equal numbers of points, in order of time."""
    clouds = drive()
    data = read_training(write(tmp_path / 'bag', {'/lidar': clouds}), DEFAULTS, CAUSES)
    valid = [np.isfinite(cloud['x'] + cloud['y'] + cloud['z']) for cloud in clouds]
    expected = np.concatenate(
        [cloud['label'][mask] for cloud, mask in zip(clouds, valid, strict=True)]
    )
    np.testing.assert_array_equal(data.bad, expected == Cause.EXHAUST)
    np.testing.assert_array_equal(data.good, expected == Cause.GOOD)
    sizes = np.bincount(data.stretch)
    assert len(sizes) == data.stretches == 20
    assert np.ptp(sizes) <= 1
    assert (np.diff(data.stretch) >= 0).all()


def test_points_that_are_not_seen(tmp_path: Path) -> None:
    """They have no verdict, and the others have one as if there were no such points."""
    clouds = drive()
    data = read_training(write(tmp_path / 'bag', {'/lidar': clouds}), DEFAULTS, CAUSES)
    seen = data.good
    result = data.judge(DEFAULTS, seen)
    assert np.isnan(result.score[~seen]).all()
    assert not result.rejected[~seen].any()
    ends = np.cumsum([len(cloud) for cloud in data.clouds])[:-1]
    left = [cloud.take(part) for cloud, part in zip(data.clouds, np.split(seen, ends), strict=True)]
    alone = replace(data, clouds=tuple(left)).judge(DEFAULTS)
    np.testing.assert_array_equal(result.score[seen], alone.score)
    np.testing.assert_array_equal(result.rejected[seen], alone.rejected)
    # They make a difference.
    assert (data.judge(DEFAULTS).score[seen] != result.score[seen]).any()


def test_an_error_of_a_detector_is_no_verdict(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The tuner ends with it: points that were not judged are not good."""
    data = read_training(write(tmp_path / 'bag', {'/lidar': drive()}), DEFAULTS, CAUSES)
    monkeypatch.setattr(sor, 'measure', None)
    with pytest.raises(JudgingError, match=r'^detection must be free of errors'):
        data.judge(DEFAULTS.changed({'chain': ('sor',)}))


def test_ignored_labels_are_neither(tmp_path: Path) -> None:
    """Points that do not count are judged, and are neither outliers nor good points."""
    clouds = drive()
    clouds[0]['label'][:100] = 9
    bag = write(tmp_path / 'bag', {'/lidar': clouds})
    codes = Codes(frozenset({int(Cause.EXHAUST)}), frozenset({9}))
    data, plain = read_training(bag, DEFAULTS, codes), read_training(bag, DEFAULTS, CAUSES)
    assert 90 < np.count_nonzero(~data.bad & ~data.good) <= 100
    np.testing.assert_array_equal(data.judge(DEFAULTS).score, plain.judge(DEFAULTS).score)


def test_label_files(tmp_path: Path) -> None:
    """A file for each cloud, also for one that the filter refuses."""
    clouds = drive()
    files = []
    for i, cloud in enumerate(clouds):
        files.append(tmp_path / f'{i:02}.label')
        (cloud['label'] * 5).astype('<u4').tofile(files[-1])
    messages = [to_message(i * 100_000_000, cloud) for i, cloud in enumerate(clouds)]
    messages[3].point_step = 2
    bag = write(tmp_path / 'bag', {'/lidar': messages}, without='label')
    codes = Codes(frozenset({10}))
    data = read_training(bag, DEFAULTS, codes, files=files)
    assert data.refused == 1
    taken = np.concatenate([cloud for i, cloud in enumerate(clouds) if i != 3])
    valid = np.isfinite(taken['x'] + taken['y'] + taken['z'])
    np.testing.assert_array_equal(data.bad, (taken['label'] != 0)[valid])
    for wrong in (files[:-1], [*files, files[0]]):
        with pytest.raises(FilterError, match='must be one for each'):
            read_training(bag, DEFAULTS, codes, files=wrong)
    np.zeros(3, '<u4').tofile(files[1])
    with pytest.raises(FilterError, match='must be for 400 points, got 3'):
        read_training(bag, DEFAULTS, codes, files=files)


def test_several_recordings(tmp_path: Path) -> None:
    """Each is judged by itself, though their times overlap, and keeps its own stretches."""
    parts = [
        read_training(write(tmp_path / f'{seed}', {'/lidar': drive(seed=seed)}), DEFAULTS, CAUSES)
        for seed in (1, 2, 3)
    ]
    data = together(parts)
    assert data.stretches == 60
    np.testing.assert_array_equal(data.sources, np.repeat([0, 1, 2], 20))
    np.testing.assert_array_equal(
        np.bincount(data.stretch), [size for part in parts for size in np.bincount(part.stretch)]
    )
    for name in ('bad', 'good'):
        expected = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_array_equal(getattr(data, name), expected)
    expected = np.concatenate([part.judge(DEFAULTS).score for part in parts])
    np.testing.assert_array_equal(data.judge(DEFAULTS).score, expected)
    expected = np.concatenate([part.judge(DEFAULTS, part.good).score for part in parts])
    np.testing.assert_array_equal(data.judge(DEFAULTS, data.good).score, expected)
    assert together(parts[:1]) is parts[0]


def test_the_topic_is_found(tmp_path: Path) -> None:
    """Outputs are not inputs, unless they are named; several inputs must be distinguished."""
    clouds = drive()
    topics = {'/lidar': clouds, '/lidar/cleaned': clouds, '/lidar/outliers': clouds[:1]}
    bag = write(tmp_path / 'bag', topics)
    assert len(read_training(bag, DEFAULTS, CAUSES)) > 4000
    assert len(read_training(bag, DEFAULTS, CAUSES, topic='/lidar/outliers')) < 400
    two = write(tmp_path / 'two', {'/a': clouds, '/b/cleaned': clouds})
    with pytest.raises(FilterError, match=r'of clouds \(/a, /b/cleaned\), got None'):
        read_training(two, DEFAULTS, CAUSES)
    with pytest.raises(FilterError, match=r"of clouds \(/a, /b/cleaned\), got '/c'"):
        read_training(two, DEFAULTS, CAUSES, topic='/c')


def test_refusals(tmp_path: Path) -> None:
    """No such field, no outliers, no good points, nothing at all."""
    bag = write(tmp_path / 'bag', {'/lidar': drive(2)})
    with pytest.raises(FilterError, match="must be with whole numbers 'truth', got x, y, z, t"):
        read_training(bag, DEFAULTS, CAUSES, label='truth')
    with pytest.raises(FilterError, match='outliers and good points, got 0 outliers and 7'):
        read_training(bag, DEFAULTS, Codes(frozenset({77})))
    empty = write(tmp_path / 'empty', {'/lidar': [np.zeros(0, POINT)]})
    with pytest.raises(FilterError, match='got 0 outliers and 0 good points'):
        read_training(empty, DEFAULTS, CAUSES)


# Files ------------------------------------------------------------------------------------------


def test_a_table_and_labels_beside_it(tmp_path: Path) -> None:
    """The truth is a column, or a file beside the cloud; missing returns have none."""
    rng = np.random.default_rng(4)
    xyz = rng.uniform(0, 10, (500, 3)) * [1, 1, 0.01]
    xyz[0] = 0
    code = (rng.random(500) < 0.05).astype(np.float64)
    xyz[code > 0, 2] += 3
    parameters = DEFAULTS.changed({'chain': ['sor']})
    path, rows = tmp_path / 'a.csv', np.column_stack([xyz, code])
    np.savetxt(path, rows, delimiter=',', header='x,y,z,label', comments='')
    inside = read_training(path, parameters, CAUSES)
    np.save(tmp_path / 'code.npy', code)
    beside = read_training(path, parameters, CAUSES, files=[tmp_path / 'code.npy'])
    for data in (inside, beside):
        np.testing.assert_array_equal(data.bad, code[1:] > 0)
        (cloud,) = data.clouds
        longest = cloud.xyz[:, np.argmax(np.ptp(cloud.xyz, axis=0))]
        ends = [longest[data.stretch == i].max() for i in range(20)]
        assert (np.diff(ends) >= 0).all()
    injected = read_training(path, parameters, CAUSES, injection=Injection(share=0.1))
    assert np.count_nonzero(injected.bad) == 50
    np.save(tmp_path / 'short.npy', code[1:])
    with pytest.raises(FilterError, match='must be for 500 points, got 499'):
        read_training(path, parameters, CAUSES, files=[tmp_path / 'short.npy'])
    smoother = DEFAULTS.changed({'chain': ['alpha_beta_gamma']})
    with pytest.raises(FilterError, match='chain must be without alpha_beta_gamma, as'):
        read_training(path, smoother, CAUSES)
