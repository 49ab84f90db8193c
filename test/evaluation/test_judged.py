# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Truth and verdict from recordings whose outputs are known, with the truth inside or beside."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.labelled import BAD, POINT, REJECTED, SCORED, TRUTH, results, rows, write
from numpy.typing import NDArray

from lidar_outlier_filter.cli.evaluate import read_recording
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation.judged import CAUSES, Judged
from lidar_outlier_filter.evaluation.labels import Codes
from lidar_outlier_filter.messages.cloud import split
from lidar_outlier_lab.simulation.world.recording import to_message

EMPTY = np.zeros(0, POINT)
NONE = np.zeros(0, np.bool_)


def by_index(points: Judged) -> Judged:
    """Put points into the order that they had before they were split, by their range."""
    assert points.range is not None
    order = np.argsort(points.range, kind='stable')
    return points.take(order)


@pytest.mark.parametrize('beside', ['', '/lidar', '/lidar/cleaned', '/other/cleaned'])
def test_a_recording_is_read_as_its_clouds_say(tmp_path: Path, beside: str) -> None:
    """Every point once, with truth, verdict, scores and cloud; other messages do not count."""
    clouds = [rows(SCORED), EMPTY, rows(SCORED)]
    topics = results(clouds, [REJECTED, NONE, ~REJECTED])
    bag = write(tmp_path / 'bag', {'/lidar': clouds, **topics}, beside=beside)
    for topic in (None, '/lidar'):
        points = by_index(read_recording(bag, topic))
        np.testing.assert_array_equal(points.code, np.repeat(TRUTH[:, 0], 2))
        np.testing.assert_array_equal(points.bad, np.repeat(BAD, 2))
        np.testing.assert_array_equal(points.range, np.repeat(10 * np.arange(8) + 1, 2))
        np.testing.assert_array_equal(points.surface, np.repeat(TRUTH[:, 1], 2))
        for number, rejected in ((0, REJECTED), (2, ~REJECTED)):
            part = points.take(points.index == number)
            np.testing.assert_array_equal(part.rejected, rejected)
            np.testing.assert_array_equal(part.score, clouds[0]['outlier_score'])
            np.testing.assert_array_equal(part.detectors, clouds[0]['outlier_detectors'])


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


def test_codes_and_fields(tmp_path: Path) -> None:
    """Codes select outliers and points that count; any field of whole numbers can be the truth."""
    bag = write(tmp_path / 'bag', results([rows()], [REJECTED]))
    points = by_index(read_recording(bag, codes=Codes(frozenset({2}), frozenset({5}))))
    np.testing.assert_array_equal(points.code, [0, 2, 0, 2, 0, 0, 0])
    np.testing.assert_array_equal(points.bad, [0, 1, 0, 1, 0, 0, 0])
    points = by_index(read_recording(bag, label='surface'))
    np.testing.assert_array_equal(points.code, TRUTH[:, 1])
    assert (
        read_recording(write(tmp_path / 'b', results([rows()], [REJECTED]), 'surface')).surface
        is None
    )


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
    """No outputs, several, empty ones, unknown topics or fields, and fields that differ."""
    one = results([rows()], [REJECTED])
    mixed = results([rows(), rows(SCORED)], [REJECTED, REJECTED])
    cases: list[tuple[dict[str, Any], str | None, str, str]] = [
        ({'/lidar': [rows()]}, None, '', r'\(none\), got None'),
        ({**one, '/b/cleaned': [], '/b/outliers': []}, None, '', r'\(/b, /lidar\), got None'),
        (one, '/other', '', r"\(/lidar\), got '/other'"),
        ({'/l/cleaned': [EMPTY], '/l/outliers': []}, None, '', 'at least one point, got none'),
        (one, None, 'x', "must be with whole numbers 'x', got x, y, z, t, label"),
        (one, None, 'truth', "must be with whole numbers 'truth', got x, y, z, t, label"),
        (mixed, None, '', 'must be the same in all, got score in some'),
    ]
    for number, (topics, topic, label, match) in enumerate(cases):
        with pytest.raises(FilterError, match=match):
            read_recording(write(tmp_path / f'{number}', topics), topic, label)
    with pytest.raises(FilterError, match='readable'):
        read_recording(tmp_path / 'nowhere')


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


def test_label_files_beside_a_recording(tmp_path: Path) -> None:
    """Labels belong to points of the input, also behind a refused cloud and with scores."""
    inputs = [np.roll(rows(), i) for i in range(3)]
    outputs = [np.roll(rows(SCORED), i) for i in range(3)]
    topics = {
        name: [to_message(i * 100_000_000, clouds[i]) for i in (0, 2)]
        for name, clouds in results(outputs, [np.roll(REJECTED, i) for i in range(3)]).items()
    }
    bag = write(tmp_path / 'bag', {'/lidar': inputs, **topics})
    given = by_index(read_recording(bag, files=files(tmp_path, 3)))
    assert set(given.index.tolist()) == {0, 2}
    np.testing.assert_array_equal(given.code, np.repeat(TRUTH[:, 0], 2))
    np.testing.assert_array_equal(given.bad, np.repeat(BAD, 2))
    np.testing.assert_array_equal(given.rejected, np.repeat(REJECTED, 2))


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
    bag = write(tmp_path / 'bag', {'/lidar': [cloud], **results([cloud], [rejected])})
    label = kitti(tmp_path / 'a.label', np.array([7, 0, 8, 0, 9, 0, 0, 0]))
    points = read_recording(bag, files=[label])
    np.testing.assert_array_equal(points.code[points.rejected], [8, 9])
    assert 7 in points.code[~points.rejected]


def test_refused_label_files(tmp_path: Path) -> None:
    """Too few, too many, of the wrong size, without the input, and for other clouds."""
    cloud = rows()
    labels = files(tmp_path, 3)
    short = kitti(tmp_path / 'short.label', np.zeros(7, np.int64))
    one, two = results([cloud], [REJECTED]), results([cloud] * 2, [REJECTED] * 2)
    other = cloud.copy()
    other['z'] += 1
    lost = results([cloud[1:]], [REJECTED[1:]])
    cases: list[tuple[dict[str, Any], list[Path], str]] = [
        ({'/lidar': [cloud] * 2, **two}, labels, 'one for each of the 2 clouds of /lidar, got 3'),
        ({'/lidar': [cloud] * 2, **two}, labels[:1], 'one for each cloud of /lidar, got 1'),
        ({'/lidar': [cloud], **one}, [short], r'short\.label must be for 8 points, got 7'),
        (one, labels[:1], 'must be with /lidar, which the labels are for, got no /lidar'),
        ({'/lidar': [cloud], **two}, labels[:1], 'to clouds of /lidar, by their stamps, got one'),
        (
            {'/lidar': [to_message(0, cloud)] * 2, **one},
            labels[:2],
            r'the stamps of /lidar must be different, got \(0, 0\) t',
        ),
        (
            {'/lidar': [cloud], **results([other], [REJECTED])},
            labels[:1],
            'must be the points of cloud 0 of /lidar, got others',
        ),
        ({'/lidar': [cloud], **lost}, labels[:1], 'the points of cloud 0 of /lidar, got others'),
    ]
    for number, (topics, given, match) in enumerate(cases):
        with pytest.raises(FilterError, match=match):
            read_recording(write(tmp_path / f'{number}', topics), files=given)


def test_causes_have_names() -> None:
    """The codes of simulated drives are called what they are; others by their number."""
    assert CAUSES.name(4) == 'near surface'
    assert CAUSES.name(200) == 'code 200'
