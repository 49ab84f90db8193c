# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What several tests use; none is a test itself."""

import sys
from importlib import import_module
from pathlib import Path
from shutil import which
from typing import Any

HELPERS = Path(__file__).parent  # some are programs, too
TESTS = HELPERS.parent  # on the path of a process that imports ``helpers``
ROOT = TESTS.parent
BENCHMARKS = ROOT / 'benchmarks'
# The browser that opens pages; None: not installed
CHROMIUM = next(filter(None, map(which, ('chromium', 'chromium-browser', 'google-chrome'))), None)


def names(folder: Path) -> list[str]:
    """List the names in a folder, hidden ones too."""
    return sorted(path.name for path in folder.iterdir())


def benchmark(name: str) -> Any:
    """Import a program of ``benchmarks/``."""
    if str(BENCHMARKS) not in sys.path:
        sys.path.append(str(BENCHMARKS))
    return import_module(name)
