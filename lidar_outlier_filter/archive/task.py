# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A recording or a file, where its output goes, and what a manifest calls the two."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Self

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

    @property
    def outputs(self) -> Sequence[RecordingPath]:
        """All that is written of it."""
        return [self.output]

    @property
    def label(self) -> str:
        """What a table calls it."""
        return self.made

    def absolute(self) -> Self:
        """Return the same for a process that works in another folder."""
        location = replace(self.location, path=_absolute(self.location.path))
        return replace(self, location=location, output=_absolute(self.output))


def last_parts(path: RecordingPath | str, count: int) -> str:
    """Return the last parts of a path: they stay the same wherever its folder is moved to."""
    return '/'.join(str(path).split('/')[-count:])


def _absolute(path: RecordingPath) -> RecordingPath:
    return path.absolute() if isinstance(path, Path) else path
