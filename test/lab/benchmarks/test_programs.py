# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What programs of benchmarks/ use of the packages is there; measures of odometry and maps."""

import ast
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from helpers import BENCHMARKS, benchmark
from helpers.scans import points_of
from numpy.typing import NDArray

from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.parameters.node import HealthLimits
from lidar_outlier_filter.ros.health import Backlog, Health

PACKAGES = ('lidar_outlier_filter', 'lidar_outlier_lab', 'helpers')
downstream = benchmark('downstream')
AHEAD = np.eye(4)
LEFT = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


@pytest.mark.parametrize('path', sorted(BENCHMARKS.glob('*.py')), ids=lambda path: path.stem)
def test_imports_are_there(path: Path) -> None:
    """Every module and name exists, whether it is imported at the start or in a function."""
    for node in ast.walk(ast.parse(path.read_text('utf-8'))):
        if isinstance(node, ast.ImportFrom) and (node.module or '').startswith(PACKAGES):
            module = import_module(node.module or '')
            for name in (alias.name for alias in node.names):
                there = hasattr(module, name) or (
                    hasattr(module, '__path__') and find_spec(f'{node.module}.{name}')
                )
                assert there, f'{path.name}, line {node.lineno}: {node.module} has no {name}'


def test_load_reads_what_diagnostics_say(capsys: pytest.CaptureFixture[str]) -> None:
    """All values that it prints of /diagnostics are there."""
    sample = Health().sample(1.0, HealthLimits(), 1.0, Backlog(0, 0.0, 0))
    taken = benchmark('load').sample(
        {'values': {**sample.values, 'lost': '0'}, 'level': 0, 'message': ''}, 9.0
    )
    assert (taken.memory, taken.is_well) == (9.0, False)
    assert '0.0 clouds/s' in capsys.readouterr().out


def pose(x: float, y: float, turned: NDArray[np.float64] = AHEAD) -> NDArray[np.float64]:
    """Make a pose at a place."""
    result = turned.copy()
    result[:2, 3] = x, y
    return result


def sweep(*xyz: tuple[float, float, float]) -> Points:
    """Make a sweep of a few points."""
    return points_of(np.array(xyz, np.float64))


def test_drift() -> None:
    """The start of a drive, and its heading there, are no drift."""
    truth = [pose(0, 0), pose(3, 0), pose(6, 0)]
    assert downstream.drift(truth, truth) == 0
    moved = [pose(9, 9, LEFT), pose(9, 12, LEFT), pose(9, 15, LEFT)]
    assert downstream.drift(moved, truth) == pytest.approx(0)
    assert downstream.drift([*truth[:2], pose(6, 0.5)], truth) == pytest.approx(0.5)


def test_cells() -> None:
    """A cell is filled by any point that a vehicle would drive into, wherever the sweep was."""
    first = sweep((0.1, 0.1, 0), (0.15, 0.1, 1), (0.1, 0.1, -1.9), (0.1, 0.1, 5), (-0.1, 0, 0))
    second = sweep((0.1, -1.1, 0), (7.1, 0, 0))
    masks = [np.array([True] * 4 + [False]), np.array([True, True])]
    found = downstream.cells([first, second], masks, [pose(0, 0), pose(0, 0, LEFT)], ground=-1)
    assert found == {(0, 0), (5, 0), (0, 35)}
