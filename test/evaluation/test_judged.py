# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Truth and verdict from recordings whose answers are known, with the truth inside or beside."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from helpers.labelled import BAD, POINT, REJECTED, SCORED, TRUTH, answers, rows, write

from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation.judged import (
    CAUSES,
    Judged,
    read_recording,
)
from lidar_outlier_filter.evaluation.labels import Codes
from lidar_outlier_filter.messages.cloud import split
from lidar_outlier_lab.simulation.world.recording import to_message

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

EMPTY = np.zeros(0, POINT)
NONE = np.zeros(0, np.bool_)


def by_index(points: Judged) -> Judged:
    """Put points into the order that they had before they were split, by their range."""
    assert points.range is not None
    order = np.argsort(points.range, kind='stable')
    return points.take(order)


def test_a_recording_is_read_as_its_clouds_say(tmp_path: Path) -> None:
    """Every point once, with truth, verdict and number of its cloud; other topics do not count."""
    clouds = [rows(), EMPTY, rows()]
    topics = answers(clouds, [REJECTED, NONE, ~REJECTED])
    bag = write(tmp_path / 'bag', {'/lidar': clouds, **topics})
    for topic in (None, '/lidar'):
        points = by_index(read_recording(bag, topic))
        assert len(points) == 16
        np.testing.assert_array_equal(points.code, np.repeat(TRUTH[:, 0], 2))
        np.testing.assert_array_equal(points.bad, np.repeat(BAD, 2))
        np.testing.assert_array_equal(points.range, np.repeat(10 * np.arange(8) + 1, 2))
        np.testing.assert_array_equal(points.surface, np.repeat(TRUTH[:, 1], 2))
        first = points.take(points.index == 0)
        np.testing.assert_array_equal(first.rejected, REJECTED)
        last = points.take(points.index == 2)
        np.testing.assert_array_equal(last.rejected, ~REJECTED)
        assert points.score is None
        assert points.detectors is None


@pytest.mark.parametrize(
    'beside', ['/lidar', '/lidar/cleaned', '/lidar/outliers', '/other/cleaned']
)
def test_what_else_comes_on_the_topics(tmp_path: Path, beside: str) -> None:
    """Messages of another type on the topics of clouds and answers are not looked at."""
    clouds = [rows(), rows()]
    topics = {'/lidar': clouds, **answers(clouds, [REJECTED, ~REJECTED])}
    bag = write(tmp_path / 'bag', topics, beside=beside)
    expected = read_recording(write(tmp_path / 'plain', topics))
    found = read_recording(bag)
    np.testing.assert_array_equal(found.rejected, expected.rejected)
    np.testing.assert_array_equal(found.code, expected.code)
    with pytest.raises(FilterError, match=r"with '/cleaned' and '/outliers' \(none\)"):
        read_recording(write(tmp_path / 'none', {'/other/outliers': clouds}, beside=beside))


def test_scores_are_read_where_they_are(tmp_path: Path) -> None:
    """Score and bits belong to their points."""
    cloud = rows(SCORED)
    points = by_index(read_recording(write(tmp_path / 'bag', answers([cloud], [REJECTED]))))
    np.testing.assert_array_equal(points.score, cloud['outlier_score'])
    np.testing.assert_array_equal(points.detectors, cloud['outlier_detectors'])


@pytest.mark.parametrize('keep_organized', [False, True])
def test_missing_returns_and_holes_are_no_points(tmp_path: Path, *, keep_organized: bool) -> None:
    """NaN and 0 0 0 are left out, and so is what an organised cloud has for a rejected point."""
    cloud = rows()
    cloud['x'][0], cloud['y'][1:3] = np.nan, np.inf
    cloud['x'][3] = 0
    message = to_message(0, cloud)
    message.height, message.width, message.row_step = 2, 4, 4 * message.point_step
    verdict = Verdict.untested(8)
    verdict.rejected[4:6] = True
    cleaned, outliers = split(message, verdict, keep_organized=keep_organized)
    assert cleaned.width * cleaned.height == (8 if keep_organized else 6)
    bag = write(tmp_path / 'bag', {'/lidar/cleaned': [cleaned], '/lidar/outliers': [outliers]})
    points = by_index(read_recording(bag))
    np.testing.assert_array_equal(points.rejected, [True, True, False, False])
    np.testing.assert_array_equal(points.code, TRUTH[4:, 0])


def test_codes_say_what_is_an_outlier_and_what_counts(tmp_path: Path) -> None:
    """Exhaust alone is bad here; mixed points do not count at all."""
    bag = write(tmp_path / 'bag', answers([rows()], [REJECTED]))
    points = by_index(read_recording(bag, codes=Codes(frozenset({2}), frozenset({5}))))
    np.testing.assert_array_equal(points.code, [0, 2, 0, 2, 0, 0, 0])
    np.testing.assert_array_equal(points.bad, [0, 1, 0, 1, 0, 0, 0])


def test_any_field_of_whole_numbers_is_a_truth(tmp_path: Path) -> None:
    """The field may have another name; a float is none."""
    bag = write(tmp_path / 'bag', answers([rows()], [REJECTED]))
    points = by_index(read_recording(bag, label='surface'))
    np.testing.assert_array_equal(points.code, TRUTH[:, 1])
    with pytest.raises(FilterError, match="cleaned must be with whole numbers 'x', got x, y, z"):
        read_recording(bag, label='x')


def test_stretches_follow_the_clouds() -> None:
    """As many as there are clouds at most, each of clouds in a row, as equal as can be."""
    zeros, index = np.zeros(10, np.bool_), np.arange(10)
    points = Judged(index, zeros, zeros, index)
    assert points.stretch(20)[1] == 10
    stretch, count = points.stretch(4)
    assert count == 4
    np.testing.assert_array_equal(stretch, [0, 0, 0, 1, 1, 2, 2, 2, 3, 3])
    assert points.take(index < 0).stretch(5)[1] == 1


def test_refusals(tmp_path: Path) -> None:
    """No answers, several, answers without points, and unknown topics are refused."""
    one = write(tmp_path / 'one', answers([rows()], [REJECTED]))
    two = {**answers([rows()], [REJECTED]), '/b/cleaned': [], '/b/outliers': []}
    cases = (
        (write(tmp_path / 'none', {'/lidar': [rows()]}), None, r'\(none\), got None'),
        (write(tmp_path / 'two', two), None, r'\(/b, /lidar\), got None'),
        (one, '/other', r"\(/lidar\), got '/other'"),
    )
    for bag, topic, match in cases:
        with pytest.raises(FilterError, match=match):
            read_recording(bag, topic)
    empty = write(tmp_path / 'empty', {'/l/cleaned': [EMPTY], '/l/outliers': []})
    with pytest.raises(FilterError, match='must be at least one point, got none'):
        read_recording(empty)
    with pytest.raises(FilterError, match='readable'):
        read_recording(tmp_path / 'nowhere')


def test_answers_without_truth_are_refused(tmp_path: Path) -> None:
    """Clouds without the truth are named with the fields that they have; a surface may lack."""
    bag = write(tmp_path / 'bag', answers([rows()], [REJECTED]), without='label')
    with pytest.raises(FilterError, match="with whole numbers 'label', got x, y, z, t, surface"):
        read_recording(bag)
    bag = write(tmp_path / 'other', answers([rows()], [REJECTED]), without='surface')
    assert read_recording(bag).surface is None


def test_answers_that_differ_are_refused(tmp_path: Path) -> None:
    """Scores in one cloud and none in the next are two runs in one recording."""
    topics = answers([rows(), rows(SCORED)], [REJECTED, REJECTED])
    with pytest.raises(FilterError, match='must be the same in all, got others'):
        read_recording(write(tmp_path / 'bag', topics))


# Labels in files --------------------------------------------------------------------------------


def kitti(path: Path, codes: NDArray[np.int64]) -> Path:
    """Write a label file of SemanticKITTI, with numbers of instances in the upper half."""
    instance = np.arange(len(codes)) << 16
    (codes + instance).astype('<u4').tofile(path)
    return path


def files(tmp_path: Path, count: int) -> list[Path]:
    """Write the labels of clouds that are as ``rows``, turned round from one to the next."""
    return [
        kitti(tmp_path / f'{i:06}.label', np.roll(TRUTH[:, 0], i).astype(np.int64))
        for i in range(count)
    ]


@pytest.mark.parametrize('dtype', [POINT, SCORED])
def test_label_files_beside_a_recording(tmp_path: Path, dtype: np.dtype[np.void]) -> None:
    """Labels are in the order of the input; answers find theirs, whatever was added to them."""
    inputs = [np.roll(rows(), i) for i in range(3)]
    outputs = [np.roll(rows(dtype), i) for i in range(3)]
    rejected = [np.roll(REJECTED, i) for i in range(3)]
    bag = write(tmp_path / 'bag', {'/lidar': inputs, **answers(outputs, rejected)})
    given = read_recording(bag, files=files(tmp_path, 3))
    inside = read_recording(bag)
    for name in ('code', 'bad', 'rejected', 'index', 'range'):
        np.testing.assert_array_equal(getattr(given, name), getattr(inside, name))


def test_label_files_beside_organised_clouds(tmp_path: Path) -> None:
    """An organised cloud that kept its shape has holes, and its points their labels."""
    message = to_message(0, rows())
    message.height, message.width, message.row_step = 2, 4, 4 * message.point_step
    verdict = Verdict.untested(8)
    verdict.rejected[:] = REJECTED
    cleaned, outliers = split(message, verdict, keep_organized=True)
    topics = {'/lidar': [message], '/lidar/cleaned': [cleaned], '/lidar/outliers': [outliers]}
    points = by_index(read_recording(write(tmp_path / 'bag', topics), files=files(tmp_path, 1)))
    np.testing.assert_array_equal(points.code, TRUTH[:, 0])
    np.testing.assert_array_equal(points.rejected, REJECTED)


def test_equal_points_are_told_apart_by_their_order(tmp_path: Path) -> None:
    """Of two points that are equal byte by byte, the first is taken for the one that was kept."""
    cloud = rows()
    cloud[[2, 4]] = cloud[0]
    rejected = np.array([0, 0, 1, 0, 1, 0, 0, 0], np.bool_)
    bag = write(tmp_path / 'bag', {'/lidar': [cloud], **answers([cloud], [rejected])})
    label = kitti(tmp_path / 'a.label', np.array([7, 0, 8, 0, 9, 0, 0, 0]))
    points = read_recording(bag, files=[label])
    np.testing.assert_array_equal(points.code[points.rejected], [8, 9])
    assert 7 in points.code[~points.rejected]


def test_a_refused_cloud_has_labels_and_no_answer(tmp_path: Path) -> None:
    """The clouds after it keep their own labels."""
    inputs = [np.roll(rows(), i) for i in range(3)]
    topics = answers(inputs, [np.roll(REJECTED, i) for i in range(3)])
    messages = {
        name: [to_message(i * 100_000_000, cloud) for i, cloud in enumerate(clouds) if i != 1]
        for name, clouds in topics.items()
    }
    bag = write(tmp_path / 'bag', {'/lidar': inputs, **messages})
    points = read_recording(bag, files=files(tmp_path, 3))
    assert sorted(set(points.index.tolist())) == [0, 2]
    np.testing.assert_array_equal(by_index(points).code, np.repeat(TRUTH[:, 0], 2))


def test_refused_label_files(tmp_path: Path) -> None:
    """Too few, too many, of the wrong size, without the input, and for other clouds."""
    cloud = rows()
    bag = write(tmp_path / 'bag', {'/lidar': [cloud] * 2, **answers([cloud] * 2, [REJECTED] * 2)})
    labels = files(tmp_path, 3)
    with pytest.raises(FilterError, match='must be one for each of the 2 clouds of /lidar, got 3'):
        read_recording(bag, files=labels)
    with pytest.raises(FilterError, match='must be one for each cloud of /lidar, got 1'):
        read_recording(bag, files=labels[:1])
    short = kitti(tmp_path / 'short.label', np.zeros(7, np.int64))
    with pytest.raises(FilterError, match=r'short\.label must be for 8 points, got 7'):
        read_recording(bag, files=[labels[0], short])
    dropped = write(tmp_path / 'dropped', answers([cloud], [REJECTED]))
    with pytest.raises(
        FilterError, match='must be with /lidar, which the labels are for, got no /lidar'
    ):
        read_recording(dropped, files=labels[:1])
    late = write(tmp_path / 'late', {'/lidar': [cloud], **answers([cloud] * 2, [REJECTED] * 2)})
    with pytest.raises(FilterError, match=r'must be to clouds of /lidar, by their stamps, got one'):
        read_recording(late, files=labels[:1])
    twice = [to_message(0, cloud)] * 2
    bag = write(tmp_path / 'twice', {'/lidar': twice, **answers([cloud], [REJECTED])})
    with pytest.raises(
        FilterError, match=r'the stamps of /lidar must be different, got \(0, 0\) t'
    ):
        read_recording(bag, files=labels[:2])
    other = cloud.copy()
    other['z'] += 1
    bag = write(tmp_path / 'other', {'/lidar': [cloud], **answers([other], [REJECTED])})
    with pytest.raises(FilterError, match='must be the points of cloud 0 of /lidar, got others'):
        read_recording(bag, files=labels[:1])
    bag = write(tmp_path / 'lost', {'/lidar': [cloud], **answers([cloud[1:]], [REJECTED[1:]])})
    with pytest.raises(FilterError, match='must be the points of cloud 0 of /lidar, got others'):
        read_recording(bag, files=labels[:1])


def test_causes_have_names() -> None:
    """The codes of simulated drives are called what they are; others by their number."""
    assert CAUSES.name(4) == 'near surface'
    assert CAUSES.name(200) == 'code 200'
