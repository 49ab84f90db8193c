# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Scores against counts made by hand, and from recordings whose answers are known."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rich.console import Console
from rosbags.typesys import Stores, get_typestore

from lidar_outlier_filter.bags import NewBag, Topic
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.evaluation import score
from lidar_outlier_filter.evaluation.scene import Cause, Kind
from lidar_outlier_filter.evaluation.score import Share, confusion
from lidar_outlier_filter.evaluation.simulate import POINT, to_message

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

CLOUD = 'sensor_msgs/msg/PointCloud2'
# Label, surface, rejected: two of three outliers are found, one of five good points is lost.
TRUTH = np.array(
    [
        [Cause.GOOD, Kind.ROAD, 0],
        [Cause.EXHAUST, Kind.AIR, 1],
        [Cause.GOOD, Kind.ROAD, 1],
        [Cause.EXHAUST, Kind.AIR, 0],
        [Cause.MIXED, Kind.CAR, 1],
        [Cause.GOOD, Kind.CAR, 0],
        [Cause.GOOD, Kind.ROAD, 0],
        [Cause.GOOD, Kind.POLE, 0],
    ],
    np.uint8,
)


def points(truth: NDArray[np.uint8]) -> NDArray[np.void]:
    """Make points with this truth, the i-th at x = i + 1."""
    cloud = np.zeros(len(truth), POINT)
    cloud['x'] = np.arange(len(truth)) + 1
    cloud['label'], cloud['surface'] = truth[:, 0], truth[:, 1]
    return cloud


def write(path: Path, answers: dict[str, list[NDArray[np.void]]], without: str = '') -> Path:
    """Record clouds by topic, all but one of their fields."""
    store = get_typestore(Stores.ROS2_JAZZY)
    definition, _ = store.generate_msgdef(CLOUD, ros_version=2)
    with NewBag(path) as bag:
        for name, clouds in answers.items():
            topic = Topic(name, CLOUD, definition, store.hash_rihs01(CLOUD))
            bag.add(topic)
            for time, cloud in enumerate(clouds):
                message = to_message(time, cloud)
                message.fields = [item for item in message.fields if item.name != without]
                bag.write(topic, time, bytes(store.serialize_cdr(message, CLOUD)))
    return path


def answers(truth: NDArray[np.uint8]) -> dict[str, list[NDArray[np.void]]]:
    """Split the points as their verdict says, in two messages each, one of them empty."""
    cloud, rejected = points(truth), truth[:, 2] != 0
    return {
        '/lidar/cleaned': [cloud[~rejected], cloud[:0]],
        '/lidar/outliers': [cloud[:0], cloud[rejected]],
    }


def test_confusion_by_hand() -> None:
    """All figures of a table small enough to count."""
    result = confusion(TRUTH[:, 0], TRUTH[:, 1], TRUTH[:, 2] != 0)
    assert (result.found, result.missed, result.lost, result.kept) == (2, 1, 1, 4)
    assert result.precision == pytest.approx(2 / 3)
    assert result.recall == pytest.approx(2 / 3)
    assert result.f1 == pytest.approx(2 / 3)
    assert result.outliers[Cause.EXHAUST] == Share(1, 2)
    assert result.outliers[Cause.MIXED] == Share(1, 1)
    assert result.outliers[Cause.BARRIER] == Share(0, 0)
    assert result.good[Kind.ROAD] == Share(1, 3)
    assert result.good[Kind.CAR] == Share(0, 1)
    assert result.good[Kind.AIR] == Share(0, 0)


@pytest.mark.parametrize(
    ('label', 'rejected', 'expected'),
    [
        ([0, 0], [0, 0], (math.nan, math.nan, math.nan)),
        ([0, 0], [0, 1], (0.0, math.nan, 0.0)),
        ([2, 0], [0, 0], (math.nan, 0.0, 0.0)),
        ([2, 2], [1, 1], (1.0, 1.0, 1.0)),
        ([2, 2, 2, 0], [1, 0, 0, 0], (1.0, 1 / 3, 0.5)),
    ],
)
def test_figures_at_the_limits(
    label: list[int], rejected: list[int], expected: tuple[float, float, float]
) -> None:
    """What cannot be divided is no number; precision, recall and F1 differ where they should."""
    codes = np.array(label, np.uint8)
    result = confusion(codes, np.zeros_like(codes), np.array(rejected, np.bool_))
    np.testing.assert_array_equal((result.precision, result.recall, result.f1), expected)


def test_unknown_label_is_refused() -> None:
    """A label that no cause has cannot be scored."""
    with pytest.raises(RecordingError, match=r'the labels and surfaces must be below'):
        confusion(np.array([77], np.uint8), np.zeros(1, np.uint8), np.ones(1, np.bool_))


def test_score_of_a_recording(tmp_path: Path) -> None:
    """A recording scores as its clouds say; other topics, and the input, do not count."""
    bag = write(tmp_path / 'bag', {'/lidar': [points(TRUTH)], **answers(TRUTH)})
    expected = confusion(TRUTH[:, 0], TRUTH[:, 1], TRUTH[:, 2] != 0)
    assert score.score(bag) == expected
    assert score.score(bag, '/lidar') == expected


def test_read(tmp_path: Path) -> None:
    """Every point is read once, with its verdict."""
    read, rejected = score.read(write(tmp_path / 'bag', answers(TRUTH)))
    order = np.argsort(read['x'])
    np.testing.assert_array_equal(read['x'][order], np.arange(len(TRUTH)) + 1)
    np.testing.assert_array_equal(rejected[order], TRUTH[:, 2] != 0)


def test_refusals(tmp_path: Path) -> None:
    """No answers, several, answers without truth or points, and unknown topics are refused."""
    one = write(tmp_path / 'one', answers(TRUTH))
    cases = (
        (write(tmp_path / 'none', {'/lidar': [points(TRUTH)]}), None, r'\(none\), got None'),
        (
            write(tmp_path / 'two', {**answers(TRUTH), '/b/cleaned': [], '/b/outliers': []}),
            None,
            r'\(/b, /lidar\), got None',
        ),
        (one, '/other', r"\(/lidar\), got '/other'"),
    )
    for bag, topic, match in cases:
        with pytest.raises(RecordingError, match=match):
            score.score(bag, topic)
    empty = write(tmp_path / 'empty', {'/l/cleaned': [], '/l/outliers': []})
    with pytest.raises(RecordingError, match='must be at least one point'):
        score.read(empty)
    with pytest.raises(RecordingError, match='readable'):
        score.score(tmp_path / 'nowhere')


@pytest.mark.parametrize('name', ['label', 'surface'])
def test_answers_without_truth_are_refused(tmp_path: Path, name: str) -> None:
    """Clouds without the truth are named with the fields that they have."""
    bag = write(tmp_path / 'bag', answers(TRUTH), without=name)
    with pytest.raises(RecordingError, match=f"with a uint8 '{name}', got x, y, z, intensity"):
        score.score(bag)


def test_table() -> None:
    """The table has a column per run, and rows only for what there is."""
    result = confusion(TRUTH[:, 0], TRUTH[:, 1], TRUTH[:, 2] != 0)
    console = Console(width=100, record=True)
    console.print(score.table({'first': result, 'second': replace(result)}))
    text = console.export_text()
    lines = {' '.join(line.split()) for line in text.splitlines()}
    assert 'first second' in lines
    assert 'precision 66.67 % 66.67 %' in lines
    assert 'exhaust 1 of 2 50.00 % 1 of 2 50.00 %' in lines
    assert 'road 1 of 3 33.33 % 1 of 3 33.33 %' in lines
    assert 'barrier' not in text
    assert 'facade' not in text
