# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The scan pattern of a profile scanner, whose lines are revolutions of its mirror.

The lines stand for a spinning sensor's rings, and the angle of the mirror for the
azimuth. Points may be in any frame: the scanner's position, and the angle of its mirror, are
estimated from them.

Several scanners may measure at once, each of them line after line: their patterns lie one behind
the other. All returns of a shot have its angle.
"""

import numpy as np

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Floats, Ints, Singles
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.points.scan_lines import find_returns, line_starts, order_by_line
from lidar_outlier_filter.core.points.shared_times import measure_clock, spread_times
from lidar_outlier_filter.core.scan_pattern.placed_pattern import (
    OrderedLines,
    Pattern,
    lines_at_once,
    make_pattern,
    place,
    sort_lines,
)
from lidar_outlier_filter.core.scan_pattern.profile_scanner import (
    MAD_TO_SIGMA,
    MIN_RETURNS,
    SAMPLE_RETURNS,
    Scanner,
    TimedLines,
    find_scanner,
    median_of,
)
from lidar_outlier_filter.core.scan_pattern.scan_pattern import TURN, Turned, leave_out_copies
from lidar_outlier_filter.core.scan_pattern.untimed_lines import find_by_order

MIN_LINES = 2  # of a scanner
MAX_SCANNERS = 4  # whose lines have numbers in turn
MAX_RUNS = 64  # of line numbers that follow each other in time
MAX_OVERLAP = 0.1  # share of the time of a scanner's lines in which it also measures the next one
APART_RAD = 1e5  # rad from the angles of one scanner to those of the next: none is next to another
# Of a step, in which angles are measured: no return is exactly as far as windows reach.
STEP_MARGIN = 1.01
SIGMA_FLOOR = 0.002  # metres
NOISE_SIGMAS, LEVEL_SIGMAS = 2.0, 4.0  # standard deviations of ranges


def find_profile_pattern(
    points: Points, threads: int = 0, order: Ints | None = None
) -> Pattern | None:
    """Sort points by line and mirror angle.

    Parameters
    ----------
    points : valid ones, in any frame
    threads : maximum number of threads; 0: all cores
    order : that of :func:`.order_by_line`, where it is known

    Returns
    -------
    Pattern or None
        None where the points have no such pattern: there are too few lines, too many are measured
        at once, or the points do not lie where a mirror that turns or swings sees them.

    """
    order = order_by_line(points) if order is None else order
    parts = _part_scanners(points, order)
    scanners: list[Scanner] = []
    for part in parts:
        scanner = find_by_order(part, points.t[part.order], threads)
        if scanner is None:
            scanner = find_scanner(part, threads)
        if scanner is None:
            return None
        scanners.append(scanner)
    if not scanners:
        return None
    lines, phase, copies = _sort(points, parts, scanners, threads)
    columns, ranks, begin = [], [], 0
    for part, scanner in zip(parts, scanners, strict=True):
        count = len(part.rank)
        first = lines.first[begin : begin + count + 1]
        columns.append(_space_out(lines, phase, first, scanner.position[part.rank]))
        ranks.append(begin + part.rank)
        begin += count
    rank = np.concatenate(ranks)
    found = make_pattern(
        np.diff(lines.first)[rank],
        copies,
        **{name: np.concatenate([of[name] for of in columns], axis=-1) for name in columns[0]},
    )
    at_once = lines_at_once(len(rank), len(points))
    pool.run(lambda i, j: place(lines, phase, rank, i, j, found), len(rank), at_once, threads)
    return found


def _part_scanners(points: Points, order: Ints) -> list[TimedLines]:
    """Part points, sorted by line, by scanners; return none where these cannot be separated.

    A scanner measures one line after the other. Where several scanners measure at once, their
    numbers take turns, or those of each follow each other.
    """
    t, line = _times(points, order), points.line[order]
    first = line_starts(line)
    begins, ends, number = t[first[:-1]], t[first[1:] - 1], line[first[:-1]]
    in_turn = (number % count for count in range(1, MAX_SCANNERS + 1))
    for scanner in (*in_turn, _runs(begins, ends)):
        parts = [np.flatnonzero(scanner == one) for one in np.unique(scanner)]
        if any(len(part) < MIN_LINES for part in parts):
            continue
        if not any(_overlap(begins[part], ends[part]) for part in parts):
            return [_take_lines(points.xyz, t, order, first, part) for part in parts]
    return []


def _times(points: Points, order: Ints) -> Ints:
    """Return the times of points sorted by line; those that shots share are spread."""
    t = points.t[order]
    if not (t[1:] == t[:-1]).any():
        return t
    returns = find_returns(points.take(order))
    begins = None if returns is None else returns.shot == np.arange(len(t))
    return spread_times(t, measure_clock(t, begins), begins)


def _runs(begins: Ints, ends: Ints) -> Ints:
    """Return the scanner of each line (L,), if the numbers of one follow each other in time."""
    runs = np.split(np.arange(len(begins)), np.flatnonzero(np.diff(begins) < 0) + 1)
    scanners: list[Ints] = []
    for run in runs[:MAX_RUNS]:
        for k, some in enumerate(scanners):
            both = np.append(some, run)
            if not _overlap(begins[both], ends[both]):
                scanners[k] = both
                break
        else:
            scanners.append(run)
    found = np.zeros(len(begins), np.int64)
    for k, some in enumerate(scanners):
        found[some] = k
    return found


def _overlap(begins: Ints, ends: Ints) -> bool:
    """Return whether lines, by when they begin and end, are measured at once."""
    rank = np.argsort(begins, kind='stable')
    begins, ends = begins[rank], ends[rank]
    both = np.minimum(ends[:-1], ends[1:]) - begins[1:]
    return bool(np.maximum(both, 0).sum() > MAX_OVERLAP * (ends - begins).sum())


def _take_lines(xyz: Floats, t: Ints, order: Ints, first: Ints, lines: Ints) -> TimedLines:
    if len(lines) < len(first) - 1:
        index = np.concatenate([np.arange(first[line], first[line + 1]) for line in lines])
        t, order = t[index], order[index]
        first = np.concatenate([[0], np.cumsum(np.diff(first)[lines])])
    # Lines in order of time, whatever their numbers.
    return TimedLines(xyz, t, order, first, np.argsort(t[first[:-1]], kind='stable'))


def _sort(
    points: Points, parts: list[TimedLines], scanners: list[Scanner], threads: int
) -> tuple[OrderedLines, Floats, Ints]:
    """Sort all lines by the angle of their mirror; return that angle (N,), and copies, too."""
    xyz = np.ascontiguousarray(points.xyz)
    distance, phase, begin = np.empty(len(points)), np.empty(len(points)), 0
    firsts = [np.zeros(1, np.int64)]
    for k, (part, scanner) in enumerate(zip(parts, scanners, strict=True)):
        at, moved = scanner.position, scanner.moved
        _kernels.write_ranges(xyz, part.order, part.first, at, moved, distance)
        phase[begin : begin + len(part.t)] = scanner.turned + k * APART_RAD
        firsts.append(part.first[1:] + begin)
        begin += len(part.t)
    order = np.concatenate([part.order for part in parts])
    lines = OrderedLines(xyz, distance, order, np.concatenate(firsts))
    count, nothing = len(lines.first) - 1, np.zeros_like(phase)
    pool.run(
        lambda i, j: sort_lines(lines, i, j, phase, nothing),
        *(count, lines_at_once(count, len(points)), threads),
    )
    lines, turned, copies = leave_out_copies(lines, Turned(phase, nothing), points.intensity)
    return lines, turned.phase, copies


def _space_out(
    lines: OrderedLines, phase: Floats, first: Ints, where: Floats
) -> dict[str, Singles]:
    """Return the angles between shots and lines of a scanner, that was at (L, 3), and its noise."""
    some = phase[first[0] : first[-1]]
    steps = some[1:] - some[:-1]
    steps = steps[steps > 0.0]
    count = len(first) - 1
    step = np.full(count, STEP_MARGIN * median_of(steps) if len(steps) else TURN, np.float32)
    noise = np.full(
        count, NOISE_SIGMAS * _sigma(lines.distance, lines.order, phase, first), np.float32
    )
    return {
        'step': step,
        # Lines are taken to be as far apart as shots.
        'gap': step,
        'turn': np.ones_like(step),
        'beside': np.stack([2 * step, step, step, 2 * step]),
        'uneven': np.ones_like(step),
        'noise': noise,
        'apart': noise + _moved(where).astype(np.float32),
        'level': noise * np.float32(LEVEL_SIGMAS / NOISE_SIGMAS),
    }


def _moved(where: Floats) -> Floats:
    """Return how far the scanner moved to the nearer of the lines before and after, metres."""
    away = np.sqrt(((where[1:] - where[:-1]) ** 2).sum(axis=1))
    nearer: Floats = np.minimum(np.append(away, np.inf), np.append(np.inf, away))
    return nearer


def _sigma(distance: Floats, order: Ints, phase: Floats, first: Ints) -> float:
    """Return the standard deviation of ranges, metres, typical of all lines.

    By the differences from what the neighbours in the line predict, of some returns.
    """
    sizes = np.diff(first)
    inner = (
        first[:-1, None] + 1 + np.arange(SAMPLE_RETURNS) * (sizes[:, None] - 2) // SAMPLE_RETURNS
    )
    some = inner[sizes >= MIN_RETURNS].ravel()
    span = phase[some + 1] - phase[some - 1]
    part = (phase[some] - phase[some - 1]) / np.where(span > 0.0, span, 1.0)
    reach = distance[order[some]]
    before, after = distance[order[some - 1]], distance[order[some + 1]]
    value = (1.0 - part) / before + part / after
    # Of a plane, the inverse range is a sine: between two others it is more than a line.
    curved = part * (1.0 - part) * span**2 / 2.0
    size = np.sqrt(1.0 + (1.0 - part) ** 2 + part**2)
    off = np.abs(reach * (1.0 - reach * value - curved)) / size
    return max(MAD_TO_SIGMA * median_of(off), SIGMA_FLOOR)
