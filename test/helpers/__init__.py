# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What several tests use; none is a test itself."""

from pathlib import Path

HELPERS = Path(__file__).parent  # some are programs, too
TESTS = HELPERS.parent  # on the path of a process that imports ``helpers``
ROOT = TESTS.parent
