# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Whether a file was cleaned already: its outputs are there, and their log says how."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.files.clean_log import settings
from lidar_outlier_filter.files.cloud_file import open_cloud

if TYPE_CHECKING:
    from pathlib import Path

    from lidar_outlier_filter.files.clean_log import Wanted


def is_done(path: Path, output: Path, outliers: Path | None, wanted: Wanted) -> bool:
    """Return whether a file was cleaned in this way.

    The outputs of a run appear one after the other, and the log last. So where it is, all are. The
    cloud is opened, so that one that was damaged since counts as none.
    """
    log = output.with_name(output.name + '.json')
    try:
        found = json.loads(log.read_text(encoding='utf-8'))
        open_cloud(output)
        known = settings(path, wanted)
    except (OSError, ValueError, FilterError):
        return False
    outputs = [str(one) for one in (output, outliers) if one is not None]
    same = {name: found.get(name) for name in known} == known
    return same and found.get('outputs') == outputs
