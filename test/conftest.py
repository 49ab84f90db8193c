# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Fixtures that several test files share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


def pytest_configure(config: pytest.Config) -> None:
    """Let pass what is not ours: rclpy's type support imports a parser that imports old modules."""
    for module in ('sre_parse', 'sre_constants'):
        ignore = f"ignore:module '{module}' is deprecated:DeprecationWarning"
        config.addinivalue_line('filterwarnings', ignore)


@pytest.fixture(scope='session')
def recordings() -> Path:
    """Find the folder of real recordings; without it CI fails, and a test elsewhere is skipped."""
    folder = Path(__file__).resolve().parents[2] / 'shared' / 'data'
    if not (folder / 'bags').is_dir():
        missing = 'the real recordings must be in ../shared/data of the project, got no such folder'
        if os.environ.get('CI'):
            pytest.fail(missing)
        pytest.skip(missing)
    return folder
