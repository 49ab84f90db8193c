# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Fixtures that several test files share."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import hypothesis
import pytest
from helpers import CHROMIUM, ROOT

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from helpers.nodes import Ros
    from playwright.sync_api import Browser
    from sensor_msgs.msg import PointCloud2

    from lidar_outlier_filter.report.gather import Gathered

# No example is late: the machine may be busy.
hypothesis.settings.register_profile('house', hypothesis.settings(), deadline=None)
hypothesis.settings.load_profile('house')


REAL = ROOT.parent / 'shared' / 'data'
IS_REAL = (REAL / 'bags').is_dir()
# By fixture: whether its tests can run, and why they are left out where they cannot.
NEEDS = {
    'real_data': (
        IS_REAL,
        'tests on real data are left out: these must be in ../shared/data, see CONTRIBUTING.md',
    ),
    'browser': (
        CHROMIUM is not None,
        'tests in a browser are left out: Chromium or Chrome must be installed',
    ),
}
# In CI they fail.
LEFT_OUT = {
    fixture: why
    for fixture, (is_there, why) in NEEDS.items()
    if not is_there and not os.environ.get('CI')
}


@pytest.fixture(scope='session')
def real_data() -> Path:
    """Find the folder of real recordings and clouds."""
    assert IS_REAL, NEEDS['real_data'][1]
    return REAL


@pytest.fixture(scope='session')
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Find a folder with ``bags``: real ones, or else simulated ones like them."""
    if IS_REAL:
        return REAL
    from helpers.stand_ins import write_stand_ins  # noqa: PLC0415

    return write_stand_ins(tmp_path_factory.mktemp('stand_ins'))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave out the tests whose fixtures lack what they need."""
    items[:] = [
        one for one in items if LEFT_OUT.keys().isdisjoint(getattr(one, 'fixturenames', ()))
    ]


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Say in a line each which tests were left out, and what they need."""
    for why in LEFT_OUT.values():
        terminalreporter.write_line(why)


# Tests without ROS do not wait for its import.


@pytest.fixture
def ros(monkeypatch: pytest.MonkeyPatch) -> Iterator[Ros]:
    """Give a domain of this machine alone."""
    from helpers.nodes import Ros  # noqa: PLC0415

    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    ros = Ros()
    yield ros
    ros.close()


@pytest.fixture
def few_edges(monkeypatch: pytest.MonkeyPatch) -> None:
    """Train on coarse histograms: for each edge, scikit-learn takes as long as for a tree."""
    monkeypatch.setattr('lidar_outlier_lab.training.learner.EDGES', 32)


@pytest.fixture
def sweeps(recordings: Path) -> list[PointCloud2]:
    """Read four sweeps of a VLP-16, 0.1 s each."""
    from helpers.live import clouds  # noqa: PLC0415
    from rclpy.serialization import deserialize_message  # noqa: PLC0415
    from sensor_msgs.msg import PointCloud2  # noqa: PLC0415

    stored = clouds(recordings / 'bags' / 'vlp16_mrpt_mcap')
    return [deserialize_message(data, PointCloud2) for data in stored]


@pytest.fixture(scope='session')
def snow(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Record two turns in snow."""
    from lidar_outlier_lab.simulation.scenes.demo_street import snow_drive  # noqa: PLC0415
    from lidar_outlier_lab.simulation.world.recording import record  # noqa: PLC0415

    path = tmp_path_factory.mktemp('snow') / 'snow'
    record(replace(snow_drive(), lines=2), path, lines_per_message=1)
    return path


@pytest.fixture(scope='session')
def found(snow: Path) -> Gathered:
    """Gather them for a report."""
    from lidar_outlier_filter.evaluation.judged import CAUSES  # noqa: PLC0415
    from lidar_outlier_filter.parameters.filter import FilterParameters  # noqa: PLC0415
    from lidar_outlier_filter.report.gather import gather  # noqa: PLC0415
    from lidar_outlier_filter.report.sources import RecordedSource  # noqa: PLC0415

    return gather(RecordedSource(snow, FilterParameters()), CAUSES, 10**6)


@pytest.fixture(scope='module')
def browser() -> Iterator[Browser]:
    """Start Chromium that draws in software."""
    assert CHROMIUM, NEEDS['browser'][1]
    from helpers.browsers import chromium  # noqa: PLC0415

    with chromium() as opened:
        yield opened


@pytest.fixture(scope='session')
def written(found: Gathered, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write the page of the report."""
    from lidar_outlier_filter.report.page import page  # noqa: PLC0415

    path = tmp_path_factory.mktemp('page') / 'report.html'
    path.write_text(page(found), encoding='utf-8')
    return path
