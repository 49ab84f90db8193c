# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The size of the project stays within its limits."""

import sys

from helpers import ROOT
from helpers.programs import ended


def test_size() -> None:
    """No figure of ``scripts/size`` exceeds its limit."""
    done = ended(sys.executable, ROOT / 'scripts/size')
    assert done.returncode == 0, done.stdout + done.stderr
