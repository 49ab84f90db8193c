# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the parts of the default cost, on the whole way of a cloud: by Python's own profiler."""

from __future__ import annotations

import cProfile
import pstats
import time
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.core.detectors.boosted_trees.pattern_trees import first_pass, second_pass
from lidar_outlier_filter.core.detectors.boosted_trees.profile_groups import find_groups
from lidar_outlier_filter.core.detectors.boosted_trees.window import prepare
from lidar_outlier_filter.core.scan_pattern.profile_pattern import find_profile_pattern
from lidar_outlier_filter.core.scan_pattern.profile_scanner import find_scanner
from lidar_outlier_filter.core.scan_pattern.scan_pattern import find_pattern
from lidar_outlier_filter.messages.cloud import split
from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_lab.results.bench import stream_work
from lidar_outlier_lab.results.sheet import Sheet

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

CHAIN = ('boosted_trees',)
RUNS = 3
# Functions none of which calls another one, but that the scanner is found where lines are sorted.
PARTS: dict[str, Callable[..., object]] = {
    'decode': Decoder.decode,
    'sort rings by azimuth, or see that there are none': find_pattern,
    'find the scanner': find_scanner,
    'sort lines by the mirror': find_profile_pattern,
    'roughness, and what is beside': prepare,
    'groups in the air': find_groups,
    'first pass: windows, features, trees': first_pass,
    'second pass': second_pass,
    'split': split,
}


def parts_of(title: str, messages: list[Any], form: Mapping[str, object]) -> Sheet:
    """Profile the default in one thread, on the whole way of clouds, which are read as ``form``."""
    work = stream_work(messages, CHAIN, {**form, 'threads': 1})
    work.call()
    profile = cProfile.Profile(time.process_time)
    profile.enable()
    for _ in range(RUNS):
        work.call()
    profile.disable()
    stats = pstats.Stats(profile)
    whole = float(stats.total_tt)  # type: ignore[attr-defined]
    taken = {name: _inclusive(stats, function) for name, function in PARTS.items()}
    taken['sort lines by the mirror'] -= taken['find the scanner']
    taken['all else'] = whole - sum(taken.values())
    count = RUNS * work.points
    rows = [
        [name, f'{seconds / count * 1e9:.0f}', f'{100 * seconds / whole:.1f} %']
        for name, seconds in taken.items()
    ]
    return Sheet(title, ['part', 'ns a point, one thread', 'share'], rows)


def _inclusive(stats: pstats.Stats, function: Callable[..., object]) -> float:
    """Return the seconds that a function took, with all that it called."""
    code = getattr(function, '__wrapped__', function).__code__
    key = code.co_filename, code.co_firstlineno, code.co_name
    found = stats.stats.get(key)  # type: ignore[attr-defined]
    return float(found[3]) if found else 0.0
