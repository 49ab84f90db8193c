# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Verdicts without labels: many rejected points may be particles, and never surfaces."""

import numpy as np
import pytest
from helpers.scans import Drive, points_of, sweep

from lidar_outlier_filter import CloudFilter
from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.detectors.boosted_trees import methods
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.detectors.plausible import is_in_one_plane, rejects_surfaces
from lidar_outlier_filter.core.scan_pattern.placed_pattern import Pattern, count_points
from lidar_outlier_filter.parameters.filter import FilterParameters


def snow(count: int) -> Floats:
    """Return particles anywhere around a sensor, seen by 16 rings."""
    rng = np.random.default_rng(1)
    azimuth, up = rng.uniform(0.0, 6.28, count), np.radians(rng.integers(-15, 16, count))
    flat = np.stack([np.cos(azimuth), np.sin(azimuth), np.tan(up)], axis=1)
    flakes: Floats = rng.uniform(2.0, 12.0, count)[:, None] * flat
    return flakes


@pytest.mark.parametrize('share', [0.04, 0.3, 0.9])
def test_particles_are_plausible(share: float) -> None:
    """However many of the points are particles, they form no surfaces."""
    wall = sweep(1, 0.0, columns=900).xyz
    flakes = snow(round(share / (1.0 - share) * len(wall)))
    rejected = np.arange(len(wall) + len(flakes)) >= len(wall)
    assert not rejects_surfaces(np.concatenate([wall, flakes]), rejected)


@pytest.mark.parametrize('copies', [1, 12])
@pytest.mark.parametrize('far', [0.0, 5.4e6])
def test_surfaces_are_not(copies: int, far: float) -> None:
    """A wall is one in any frame, and where each point came twelve times."""
    wall = np.repeat(sweep(1, 0.0, columns=900).xyz + far, copies, axis=0)
    assert rejects_surfaces(wall, wall[:, 0] > far)
    few = np.arange(len(wall)) < 0.02 * len(wall)
    assert not rejects_surfaces(wall, few)


def test_a_profile_scanner_in_its_own_frame() -> None:
    """All of its points lie in one plane: many strays there are no surface."""
    drive = Drive(3, lines=20, shots=800, strays=0.08)
    own = points_of(drive.far[:, None] * drive.beam, drive.t, drive.line)
    parameters = FilterParameters()
    found = methods.detect(DetectorInput(own, parameters), parameters)
    assert rejects_surfaces(own.xyz, found.score > 1)
    assert found.method == methods.Method.PATTERN.value
    assert not is_in_one_plane(drive.points.xyz)


def test_neighbours_judge_instead(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where trees on the scan pattern reject walls, neighbours judge, and a warning says so."""
    points = sweep(1, 0.0, columns=900)
    parameters = FilterParameters()
    survey = parameters.changed({'boosted_trees.sensor': 'survey'})
    expected = methods.detect(DetectorInput(points, survey), survey).score

    def everything(pattern: Pattern, threshold: float, *_: object, **__: object) -> Floats:
        return np.full(count_points(pattern), 2.0 / threshold)

    monkeypatch.setattr(methods, 'judge', everything)
    seen = DetectorInput(points, parameters)
    found = methods.detect(seen, parameters)
    assert found.method == methods.Method.IMPLAUSIBLE.value == methods.name_method(seen, parameters)
    np.testing.assert_array_equal(found.score, expected)
    some = np.arange(len(points)) < 3
    assert methods.contributions(seen, parameters, some).method == found.method
    said: list[str] = []
    stream = CloudFilter({}, warn=said.append)
    cloud = np.zeros(
        len(points), [('x', 'f4'), ('y', 'f4'), ('z', 'f4'), ('t', 'i8'), ('ring', 'u2')]
    )
    cloud['x'], cloud['y'], cloud['z'] = points.xyz.T
    cloud['t'], cloud['ring'] = points.t, points.line
    stream.push(cloud, stamp=10**18)
    stream.flush()
    assert [text for text in said if 'judged by' in text] == [f'judged by {found.method}']
    assert set(stream.statistics.methods) == {found.method}
