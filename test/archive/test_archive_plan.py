# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The plan of a large archive: the page says what the simulation gives, which obeys its limits."""

from __future__ import annotations

import re
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from types import ModuleType

ROOT = Path(__file__).parents[2]
ROW = re.compile(r'^\| (\d+) \| (.*) \|$', re.MULTILINE)


@pytest.fixture(scope='module')
def plan() -> ModuleType:
    """Import the benchmark, which is in no package."""
    spec = spec_from_file_location('archive_plan', ROOT / 'benchmarks' / 'archive_plan.py')
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    sys.modules['archive_plan'] = module
    spec.loader.exec_module(module)
    return module


def test_the_page_has_what_is_simulated(plan: ModuleType) -> None:
    """Hours and prices of each row are those that the benchmark prints, to two digits."""
    text = (ROOT / 'doc' / 'archive_plan.md').read_text('utf-8')
    tables = text.partition('Hours, and the price')[2].split('workers |')[1:]
    assert len(tables) == len(plan.SENSORS)
    for sensor, table in zip(plan.SENSORS, tables, strict=True):
        rows = ROW.findall(table)
        assert len(rows) == 5
        for workers, cells in rows:
            for cell, way in zip(cells.split(' | '), plan.ways(sensor).values(), strict=True):
                said = [float(number) for number in re.findall(r'[\d.]+', cell)]
                took = plan.hours(way[0], int(workers), one_writer=way[1])
                price = plan.cost(way[0], plan.Cluster(), int(workers) + way[1], took)
                assert said == pytest.approx([took, price], rel=0.04, abs=0.006)


def test_no_limit_is_passed(plan: ModuleType) -> None:
    """No way is faster than its workers, its writer, or the store allow."""
    cluster = plan.Cluster()
    for sensor in plan.SENSORS:
        seconds = plan.ARCHIVE / sensor.read
        moved = sensor.read + sensor.written
        for workers in (1, 7, 300):
            pieces = 3600 * plan.hours(sensor, workers, one_writer=True)
            whole = 3600 * plan.hours(sensor, workers, one_writer=False)
            assert pieces >= seconds * max(sensor.write, sensor.judge / workers) * 0.999
            alone = sensor.replay + moved / cluster.link
            assert whole >= seconds * max(alone / workers, moved / cluster.store) * 0.999
