# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Manifests of archives for the tests of their page."""

from __future__ import annotations

from typing import Any

import numpy as np


def entry(name: str, **changes: Any) -> dict[str, Any]:
    """Make the line of a manifest for a usual recording of 20 s; ``changes`` count points."""
    counts: dict[str, Any] = {
        'messages': 200,
        'points': 1_000_000,
        'rejected': 2000,
        'untested': 100,
        'refused': 0,
        'gaps': 0,
        'rejected_by': {'boosted_trees': 1500, 'sor': 700},
        'untested_because': '',
    }
    entry: dict[str, Any] = {
        'source': name,
        'size': 50_000_000,
        'output': f'out/{name}',
        'parameters': '0123456789abcdef',
        'version': '1.0.0+abc',
        'finished': '2026-03-01T12:30:15+00:00',
        'state': 'done',
        'error': None,
        'seconds': 5.0,
        'duration': 20.0,
        'unread': 0,
        'lost': [],
    }
    counts.update((key, value) for key, value in changes.items() if key in counts)
    entry.update((key, value) for key, value in changes.items() if key in entry)
    return {
        **entry,
        'topics': {'/lidar': {**counts, 'kept': counts['points'] - counts['rejected']}},
    }


def failed(name: str, error: str) -> dict[str, Any]:
    """Make the line for a recording without an output."""
    return {**entry(name, state='failed', error=error, duration=0.0), 'topics': {}}


def archive(count: int) -> list[dict[str, Any]]:
    """Make an archive of usual recordings, and one of each oddness among the first."""
    rng = np.random.default_rng(1)
    lines = []
    for number in range(count):
        boosted_trees, sor = rng.poisson(1500), rng.poisson(700)
        rejected = int(boosted_trees + sor - 200)
        by = {'boosted_trees': int(boosted_trees), 'sor': int(sor)}
        name = f's3://drives/2026-03/{number:04}.mcap'
        lines.append(entry(name, rejected=rejected, rejected_by=by))
    changes: list[dict[str, Any]] = [
        {'rejected': 21_000, 'rejected_by': {'boosted_trees': 1500, 'sor': 20_000}},
        {'refused': 3},
        {'gaps': 5},
        {'unread': 17},
        {'untested': 1_000_000, 'untested_because': 'lof needs more points', 'rejected': 0},
        {'lost': ['a chunk at byte 7 is cut off', 'another one']},
        {'rejected': 0, 'rejected_by': {'boosted_trees': 0, 'sor': 0}},
    ]
    for number, change in enumerate(changes):
        lines[5 * number + 3] = entry(lines[5 * number + 3]['source'], **change)
    sentence = 'the recording <b>.mcap must be readable, got "an end at byte 7 without a footer"'
    lines[5] = failed(lines[5]['source'], sentence)
    return lines
