# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The size of the project stays within its limits."""

import subprocess
import sys

from helpers import ROOT


def test_size() -> None:
    """No figure of ``scripts/size`` exceeds its limit."""
    command = [sys.executable, str(ROOT / 'scripts/size')]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
