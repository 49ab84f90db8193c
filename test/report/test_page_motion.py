# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A report on a drive whose points are moved by odometry: as a replay moves them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from helpers.moved_training import Recorded, WithoutFirstPoses
from helpers.moving_bags import REPLAYED, write
from helpers.profile_scanner import Drive
from helpers.report_pages import DESKTOP, opened, wait_for_drawing

from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.evaluation.labels import ALL_BUT_0
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.recordings.recorded_clouds import RecordedClouds
from lidar_outlier_filter.recordings.replay import replay
from lidar_outlier_filter.report.frames import cut
from lidar_outlier_filter.report.gather import gather
from lidar_outlier_filter.report.header import header
from lidar_outlier_filter.report.pack import pack
from lidar_outlier_filter.report.page import write_page
from lidar_outlier_filter.report.sources import RecordedSource

if TYPE_CHECKING:
    from pathlib import Path

    from playwright.sync_api import Browser


def test_moved_points(tmp_path: Path) -> None:
    """Steps count what replays reject, clouds without poses too; labels come from files."""
    recorded = Recorded(tmp_path, WithoutFirstPoses(0.6))
    parameters = FilterParameters().changed(REPLAYED)
    source = RecordedSource(recorded.bag, parameters, files=recorded.files)
    found = gather(source, ALL_BUT_0, 10**6)
    (slider,) = found.sliders
    for step in (0, slider.given, len(slider.values) - 1):
        changed = {**REPLAYED, slider.name: slider.values[step]}
        report = replay(recorded.bag, tmp_path / str(step), parameters=changed)
        assert found.tally.at[0][step].points == report.topics[0].rejected
    assert found.tally.all.bad == np.count_nonzero(recorded.drive.wrong)
    assert (found.found.moved, found.found.unmoved) == (True, 3)
    assert cut(found).together
    # The way of the sensor: where its first point was measured from, cloud by cloud.
    clouds = RecordedClouds(recorded.bag, parameters, with_eyes=True)
    eyes = [taken.eye[0, 0] for taken in clouds if taken.eye is not None and len(taken.eye)]
    assert len(eyes) == len(found.found.path) == 3
    assert np.abs(np.array(found.found.path) - eyes).max() < 0.2
    assert np.ptp(np.array(found.found.path), axis=0).max() > 0.5
    frames = cut(found)
    assert len(header(found, frames, pack(found, frames))['path']) == len(eyes)


def test_the_way_is_drawn(tmp_path: Path, browser: Browser) -> None:
    """The way of the sensor is a line in the picture, and the legend names it."""
    bag = write(tmp_path / 'drive', Drive(0.4))
    found = gather(RecordedSource(bag, FilterParameters().changed(REPLAYED)), ALL_BUT_0, 10**6)
    write_page(found, tmp_path / 'report.html')
    with opened(browser, tmp_path / 'report.html', DESKTOP) as page:
        wait_for_drawing(page)
        assert page.locator('#legend').inner_text().split('\n') == ['rejected', 'way of the sensor']
        assert page.locator('#overlay .path').count() > 0


def test_refused_clouds_are_said(tmp_path: Path) -> None:
    """A cloud that is late when its poses have come is counted by what was wrong with it."""
    drive = Drive(0.4)
    bag = write(tmp_path / 'drive', drive, late=drive.clouds(drive.own)[:1])
    parameters = FilterParameters().changed(REPLAYED)
    found = gather(RecordedSource(bag, parameters), ALL_BUT_0, 10**6)
    (topic,) = replay(bag, tmp_path / 'out', parameters=REPLAYED).topics
    assert found.found.refusals == topic.refusals
    assert topic.refused == 1


def test_too_few_files_with_labels(tmp_path: Path) -> None:
    """One for each cloud, or the report is refused."""
    recorded = Recorded(tmp_path, Drive(0.3))
    parameters = FilterParameters().changed(REPLAYED)
    source = RecordedSource(recorded.bag, parameters, files=recorded.files[:-1])
    with pytest.raises(RecordingError, match='files with labels'):
        gather(source, ALL_BUT_0, 10**6)
