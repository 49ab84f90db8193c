# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the programs of benchmarks/ use of the packages is there: most run in no test."""

import ast
import runpy
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest
from helpers import ROOT

from lidar_outlier_filter.parameters.node import HealthLimits
from lidar_outlier_filter.ros.health import Backlog, Health

BENCHMARKS = ROOT / 'benchmarks'
PACKAGES = ('lidar_outlier_filter', 'lidar_outlier_lab', 'helpers')


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
    load = runpy.run_path(str(BENCHMARKS / 'load.py'))
    taken = load['sample'](
        {'values': {**sample.values, 'lost': '0'}, 'level': 0, 'message': ''}, 9.0
    )
    assert (taken.memory, taken.is_well) == (9.0, False)
    assert '0.0 clouds/s' in capsys.readouterr().out
