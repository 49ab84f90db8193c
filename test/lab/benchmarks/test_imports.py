# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the programs of benchmarks/ import of the packages is there: most run in no test."""

from __future__ import annotations

import ast
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING

import pytest
from helpers import ROOT

if TYPE_CHECKING:
    from pathlib import Path

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
