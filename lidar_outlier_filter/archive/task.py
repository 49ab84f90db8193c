# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A recording or a file, where its output goes, and what a manifest calls the two."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lidar_outlier_filter.archive.locations import Location
    from lidar_outlier_filter.recordings.remote_path import RecordingPath


@dataclass(frozen=True)
class Task:
    """A recording or a file, and where its output goes.

    Attributes
    ----------
    location, output : where both lie
    depth : parts of both paths below the folder that is searched, and below that of the outputs

    """

    location: Location
    output: RecordingPath
    depth: int = 1

    @property
    def source(self) -> str:
        """The name of what is read, below the folder that is searched."""
        return last_parts(self.location.path, self.depth)

    @property
    def made(self) -> str:
        """The name of the output, below the folder of all outputs."""
        return last_parts(self.output, self.depth)


def last_parts(path: RecordingPath | str, count: int) -> str:
    """Return the last parts of a path: they stay the same wherever its folder is moved to."""
    return '/'.join(str(path).split('/')[-count:])
