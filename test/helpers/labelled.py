# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings for tests whose truth is known: small ones made by hand, and outputs to them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from helpers.clouds import STORE
from helpers.drives import STRING, cdr, topic_of
from lidar_outlier_filter.core.annotations import Rows
from lidar_outlier_filter.evaluation.truth import Cause, Kind
from lidar_outlier_filter.pipeline.topics import CLOUD
from lidar_outlier_filter.recordings.bags import NewBag
from lidar_outlier_lab.simulation.world.recording import to_message

POINT = np.dtype(
    [(axis, '<f4') for axis in 'xyz'] + [('t', '<u4'), ('label', 'u1'), ('surface', 'u1')]
)
SCORED = np.dtype([*POINT.descr, ('outlier_score', '<f4'), ('outlier_detectors', '<u2')])
# Label, surface, rejected, score: two of three outliers are found, one of five good points is lost.
TRUTH = np.array(
    [
        [Cause.GOOD, Kind.ROAD, 0, 0.1],
        [Cause.EXHAUST, Kind.AIR, 1, 3.0],
        [Cause.GOOD, Kind.ROAD, 1, 1.5],
        [Cause.EXHAUST, Kind.AIR, 0, np.nan],
        [Cause.MIXED, Kind.CAR, 1, 9.0],
        [Cause.GOOD, Kind.CAR, 0, 0.5],
        [Cause.GOOD, Kind.ROAD, 0, np.nan],
        [Cause.GOOD, Kind.POLE, 0, 1.0],
    ]
)
BAD = TRUTH[:, 0] != Cause.GOOD
REJECTED = TRUTH[:, 2] != 0


def rows(dtype: np.dtype[np.void] = POINT) -> Rows:
    """Make the points of ``TRUTH``, the i-th at x = 10 i + 1."""
    cloud = np.zeros(len(TRUTH), dtype)
    cloud['x'] = 10 * np.arange(len(TRUTH)) + 1
    cloud['t'] = 1000 * np.arange(len(TRUTH))
    cloud['label'], cloud['surface'] = TRUTH[:, 0], TRUTH[:, 1]
    if dtype == SCORED:
        cloud['outlier_score'] = TRUTH[:, 3]
        cloud['outlier_detectors'] = np.where(REJECTED, [1, 1, 5, 1, 4, 1, 1, 1], 0)
    return cloud


def results(
    clouds: Sequence[Rows], rejected: Sequence[NDArray[np.bool_]], topic: str = '/lidar'
) -> dict[str, list[Rows]]:
    """Split clouds as verdicts say."""
    pairs = list(zip(clouds, rejected, strict=True))
    return {
        f'{topic}/cleaned': [cloud[~mask] for cloud, mask in pairs],
        f'{topic}/outliers': [cloud[mask] for cloud, mask in pairs],
    }


def write(
    path: Path, topics: Mapping[str, Sequence[Any]], without: str = '', *, beside: str = ''
) -> Path:
    """Record clouds by topic, rows, messages or CDR, 0.1 s apart, all but one of their fields.

    On the topic ``beside`` there are texts, too.
    """
    with NewBag(path) as bag:
        if beside:
            other = topic_of(beside, STRING)
            bag.add(other)
            for time in (0, 50_000_000, 1_000_000_000):
                bag.write(other, time, cdr(STRING, 'a text'))
        for name, clouds in topics.items():
            topic = topic_of(name, CLOUD)
            bag.add(topic)
            for number, cloud in enumerate(clouds):
                time = number * 100_000_000
                if isinstance(cloud, bytes):
                    bag.write(topic, time, cloud)
                    continue
                message = to_message(time, cloud) if isinstance(cloud, np.ndarray) else cloud
                message.fields = [item for item in message.fields if item.name != without]
                bag.write(topic, time, bytes(STORE.serialize_cdr(message, CLOUD)))
    return path


def drive(clouds: int = 12, count: int = 400, seed: int = 2) -> list[Rows]:
    """Make clouds of one scan line each, 0.1 s apart, with outliers and missing returns."""
    rng = np.random.default_rng(seed)
    made = []
    for number in range(clouds):
        cloud = np.zeros(count, POINT)
        cloud['t'] = np.arange(count) * 200_000
        cloud['x'], cloud['y'] = number, np.linspace(-5, 5, count)
        cloud['z'] = 0.1 * np.sin(cloud['y']) + rng.normal(0, 0.006, count)
        bad = rng.random(count) < 0.03
        cloud['z'][bad] += rng.uniform(0.02, 1, np.count_nonzero(bad))
        cloud['label'] = np.where(bad, Cause.EXHAUST, Cause.GOOD)
        for axis in 'xyz':
            cloud[axis][rng.random(count) < 0.01] = np.nan
        made.append(cloud)
    return made
