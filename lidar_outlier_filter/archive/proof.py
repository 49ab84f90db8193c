# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Whether an output is what the manifest says, made of the same source in the same way."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from lidar_outlier_filter.archive.fingerprints import content_hash
from lidar_outlier_filter.archive.manifest import DONE, FAILED
from lidar_outlier_filter.errors import FilterError

if TYPE_CHECKING:
    from lidar_outlier_filter.archive.locations import Location
    from lidar_outlier_filter.archive.manifest import How, Manifest
    from lidar_outlier_filter.archive.task import Task


def is_proved(task: Task, how: How, manifest: Manifest, made: Location | None) -> bool:
    """Return whether the manifest says that what was made is the output, so and of this source.

    Or that there is nothing to be made of it, as it has no clouds. ``made`` is what has the name of
    the output; None: nothing.
    """
    entry, source = manifest.entries.get(task.source), task.location
    if entry is None or entry.state == FAILED or entry.output != task.made:
        return False
    if any(getattr(entry, name) != value for name, value in how._asdict().items()):
        return False
    state = entry.output_state
    try:
        is_same = _is_same(source, entry.size, entry.source_state, entry.hash)
        if is_same and entry.state == DONE:
            is_same = made is not None and _is_same(made, made.size, state, entry.output_hash)
            state = state if made is None else made.state
    except (FilterError, OSError):
        return False
    if not is_same:
        return False
    if (source.state, state) != (entry.source_state, entry.output_state):
        # Hashed anew: the times of the files have changed, as by a copy. Not next time.
        manifest.add(replace(entry, source_state=source.state, output_state=state))
    return True


def _is_same(location: Location, size: int, state: str, known: str) -> bool:
    """Return whether the content is known: by size and times, or, where those differ, by hash."""
    return location.size == size and (location.state == state or content_hash(location) == known)
