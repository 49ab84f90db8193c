# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A few seconds that are guided by coverage; hours are for ``test/helpers/covering.py``."""

from __future__ import annotations

import re
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from helpers import HELPERS

if TYPE_CHECKING:
    from pathlib import Path

PROGRAM = HELPERS / 'covering.py'
SECONDS = 2


@pytest.mark.slow
@pytest.mark.parametrize('target', ['decoder', 'pcd'])
def test_nothing_is_found(tmp_path: Path, target: str) -> None:
    """Inputs are made, code is reached that the first ones did not reach, and nothing breaks."""
    done = subprocess.run(
        [sys.executable, str(PROGRAM), target, str(SECONDS), str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-4000:]
    reached = [int(number) for number in re.findall(r'cov: (\d+)', done.stderr)]
    assert reached[-1] > 50
    assert not list(tmp_path.glob(f'{target}_*'))
