# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The points of a page, recorded or live: which are kept, and how they are sent.

A page gets messages: the length of a header (4 bytes), the header as JSON, four words for each
point, and columns with its exact values. The GPU takes the words as they are. Words 0 and 1: x, y
and z in steps of the frame's box, 21 bits each. Word 2, from the lowest bit: score × 256 (10 bits,
``UNTESTED`` without), intensity (7), strongest reason (7, index in :func:`reason_texts` from 1; 0
without), number of the first detector that rejects it (4, 0: none), truth (2). Word 3: the steps of
the sliders that reject it (21 bits), then the rank of its scan line in the frame (11, modulo).
"""

import json
from collections.abc import Mapping, Sequence
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Floats, Ints, Rows, Singles, Words
from lidar_outlier_filter.core.detectors.registry import reasons
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.messages.cloud import first_numbers
from lidar_outlier_filter.report.chains import NEAR_SCORE, STRONGEST
from lidar_outlier_filter.report.steps import STEP_BITS

# What a live page keeps of a point, and what a recorded page keeps beside it.
LIVE = [
    ('xyz', 'f8', 3),  # metres
    ('t', 'i8'),  # nanoseconds
    ('line', 'i8'),
    ('intensity', 'f4'),  # NaN without
    ('score', 'f4'),
    ('detectors', 'u2'),
    ('rejected', '?'),
    ('reason', 'u1'),  # the strongest, a number of :func:`.reasons`; 0: none
    ('truth', 'u1'),
    ('bits', 'u4'),  # the steps of all sliders that reject the point
    ('order', 'u4'),  # random
]
RECORDED = [
    *LIVE,
    ('cloud', 'i4'),
    ('valid', 'i4'),  # index among the valid points of the cloud
    ('index', 'u4'),  # index in the message or file
    ('range', 'f4'),  # metres
    ('why', 'u2', STRONGEST),  # numbers of :func:`.features`; 0: none
    ('added', 'f4', STRONGEST),
]
WORDS = 4
BOX_STEPS = (1 << 21) - 1  # of a box, on each axis
SCORE_UNIT, UNTESTED = 256, 1023
MAX_INTENSITY = 127
MAX_LINES = 1 << (32 - STEP_BITS)
DARKEST, BRIGHTEST = 2, 98  # percentiles of the intensity between which colours change
MAX_CODES = 127  # that have a number in the words
ALIGNMENT = 16  # bytes: words begin at a multiple


def fill(rows: Rows, points: Points, verdict: Verdict, intensity: NDArray[Any] | None) -> None:
    """Write points (N,) with their verdict into rows (N,) of ``LIVE`` or more."""
    for name in ('xyz', 't', 'line'):
        rows[name] = getattr(points, name)
    for name in ('score', 'detectors', 'rejected', 'reason'):
        rows[name] = getattr(verdict, name)
    rows['intensity'] = np.nan if intensity is None else intensity


def thin(points: Rows, most: int) -> Rows:
    """Keep at most so many points: rejected ones, those near the threshold, an even sample."""
    if len(points) <= most:
        return points
    rank = np.where(points['rejected'], 0, np.where(points['score'] > NEAR_SCORE, 1, 2))
    key = (rank.astype(np.uint64) << np.uint64(32)) | points['order']
    return points[np.argpartition(key, most)[:most]]


def pack(points: Rows, first: Ints, limits: tuple[float, float]) -> tuple[Words, Floats, Floats]:
    """Write the words (N, 4) of points that lie frame by frame; return the boxes of the frames.

    Parameters
    ----------
    points : (N,) of ``LIVE`` or more
    first : (F + 1,) where each frame begins; no frame is empty
    limits : intensities between which colours change

    Returns
    -------
    words, origin, step
        Origins (F, 3) and steps (F, 3) in metres.

    """
    xyz, begin = points['xyz'], first[:-1]
    if len(points) == 0:
        return np.empty((0, WORDS), np.uint32), np.empty((0, 3)), np.empty((0, 3))
    origin = np.minimum.reduceat(xyz, begin)
    step = np.maximum((np.maximum.reduceat(xyz, begin) - origin) / BOX_STEPS, 1e-9)
    frame = np.repeat(np.arange(len(begin)), np.diff(first))
    x, y, z = np.rint((xyz - origin[frame]) / step[frame]).astype(np.uint32).T
    words = np.empty((len(points), WORDS), np.uint32)
    words[:, 0] = x | (y << np.uint32(21))
    words[:, 1] = (y >> np.uint32(11)) | (z << np.uint32(10))
    words[:, 2] = _score_steps(points['score'])
    words[:, 2] |= _intensity_steps(points['intensity'], limits) << np.uint32(10)
    words[:, 2] |= reason_numbers()[points['reason']] << np.uint32(17)
    numbers = np.minimum(first_numbers(points['detectors']), 15).astype(np.uint32)
    words[:, 2] |= numbers << np.uint32(24)
    words[:, 2] |= points['truth'].astype(np.uint32) << np.uint32(28)
    words[:, 3] = points['bits'] | (_line_ranks(points['line'], first) << np.uint32(STEP_BITS))
    return words, origin, step


def _score_steps(score: Singles) -> Words:
    known = np.nan_to_num(score.astype(np.float64), nan=0.0, posinf=1e9)
    steps = np.minimum(np.rint(known * SCORE_UNIT), UNTESTED - 1).astype(np.uint32)
    return np.where(np.isnan(score), np.uint32(UNTESTED), steps)


def intensity_limits(intensity: Singles) -> tuple[float, float]:
    """Find the intensities between which colours change; both 0 where none is known."""
    known = intensity[np.isfinite(intensity)]
    if len(known) == 0:
        return 0.0, 0.0
    low, high = np.percentile(known, [DARKEST, BRIGHTEST]).tolist()
    return low, high


def _intensity_steps(intensity: Singles, limits: tuple[float, float]) -> Words:
    low, high = limits
    part = (np.nan_to_num(intensity, nan=low) - low) / max(high - low, 1e-9)
    steps: Words = np.rint(np.clip(part, 0.0, 1.0) * MAX_INTENSITY).astype(np.uint32)
    return steps


def _line_ranks(line: Ints, first: Ints) -> Words:
    ranks = np.empty(len(line), np.uint32)
    for begin, end in pairwise(first.tolist()):
        ranks[begin:end] = np.unique(line[begin:end], return_inverse=True)[1] % MAX_LINES
    return ranks


@cache
def reason_texts() -> list[tuple[str, str]]:
    """Return name and words of each reason, in the order of their numbers in the words."""
    return [(one.name, one.text) for one in reasons().values()][:MAX_CODES]


@cache
def reason_numbers() -> Words:
    """Return the number in the words, from 1, of each number in ``outlier_reason``; 0: none."""
    found = np.zeros(256, np.uint32)
    found[list(reasons())[:MAX_CODES]] = np.arange(1, len(reason_texts()) + 1)
    return found


def message(
    header: Mapping[str, Any], words: Sequence[Words], columns: Mapping[str, Sequence[Any]]
) -> bytes:
    """Write what a page reads: header, words and columns, each the parts of all frames in turn."""
    joined = {name: np.concatenate(parts) for name, parts in columns.items() if len(parts)}
    listed = [
        [name, one.dtype.newbyteorder('<').str.lstrip('<|'), one[0].size if len(one) else 1]
        for name, one in joined.items()
    ]
    text = json.dumps({**header, 'columns': listed}, separators=(',', ':'), allow_nan=False)
    data = text.encode()
    data += b' ' * (-(len(data) + 4) % ALIGNMENT)
    arrays = [*words, *joined.values()]
    parts = [one.astype(one.dtype.newbyteorder('<'), copy=False).tobytes() for one in arrays]
    return b''.join([len(data).to_bytes(4, 'little'), data, *parts])
