# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Scan lines of a whole file, found in what LAS keeps of the motion of the mirror."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Columns, Ints

EDGE, DIRECTION, RETURN = 'edge_of_flight_line', 'scan_direction_flag', 'return_number'
ANGLES = ('scan_angle', 'scan_angle_rank')
SOURCES = ('point_source_id', 'scanner_channel')
MIRROR = (EDGE, DIRECTION, *ANGLES)
COLUMNS = (*MIRROR, RETURN, *SOURCES)
NOISE = 12  # a smaller part of the span of the angle may be noise


@dataclass(frozen=True)
class ScanLines:
    """The scan line of each of N points.

    Attributes
    ----------
    line : (N,) int64
        Numbers of the lines; the first, second and later returns are lines of their own.
    found_by : str
        The column whose changes end the lines.

    """

    line: Ints
    found_by: str


def find(t: Ints, columns: Columns, angle: str = '') -> ScanLines | None:
    """Find the scan lines of points by the columns of LAS; None where no column says them.

    Parameters
    ----------
    t : (N,) int64, nanoseconds
        In any order.
    columns : (N,) each, by name
        Those of :data:`COLUMNS` that there are, and the one that ``angle`` names.
    angle : str
        The column with the scan angle in any unit; it decides alone. Empty: a line ends, if any
        point is at an edge of the flight line, behind those; else, if the mirror turns, where the
        scan direction changes; else where the angle of a source steps by more than half of its
        span, or, if it mostly steps one way, back by more than a twelfth of it.

    """
    sources = [columns[name] for name in SOURCES if name in columns]
    order = np.lexsort((t, *reversed(sources)))
    t = t[order]
    source_begins = np.zeros(len(t), np.bool_)
    for source in sources:
        source_begins[1:] |= source[order][1:] != source[order][:-1]
    for name in (angle,) if angle else MIRROR:
        if name not in columns:
            continue
        begins = _begins(columns[name][order], name, t, source_begins) & ~source_begins
        if begins.any():
            numbers = np.cumsum(begins | source_begins, dtype=np.int64)
            return ScanLines(_by_return(numbers, order, columns), name)
    return None


def _begins(
    values: NDArray[Any], name: str, t: Ints, source_begins: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return where a line begins by a column, whose values are in order."""
    if name == EDGE:
        return _behind_edges(values, t)
    if name == DIRECTION:
        return np.append([False], values[1:] != values[:-1])[: len(values)]
    parts = np.split(values.astype(np.float64), np.flatnonzero(source_begins))
    return np.concatenate([_turns(part) for part in parts if len(part)] or [source_begins])


def _behind_edges(edge: NDArray[Any], t: Ints) -> NDArray[np.bool_]:
    """Return where a line begins: at the shot after one with a return that is marked."""
    begins = np.zeros(len(t), np.bool_)
    begins[1:] = t[1:] != t[:-1]
    shot = np.cumsum(begins)
    marked = np.zeros(len(t), np.bool_)
    marked[shot[edge != 0]] = True
    begins &= marked[shot - 1] & (shot > 0)
    return begins


def _turns(angle: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return where the angle begins anew, of the points of one source, in order."""
    begins = np.zeros(len(angle), np.bool_)
    step, span = np.diff(angle), angle.max() - angle.min()
    begins[1:] = np.abs(step) > span / 2
    small = step[np.abs(step) <= span / NOISE]
    net = small.sum()
    if abs(net) > np.abs(small).sum() / 2:
        # The mirror turns one way: it does not swing.
        begins[1:] |= np.sign(net) * step < -span / NOISE
    return begins


def _by_return(numbers: Ints, order: Ints, columns: Columns) -> Ints:
    """Give the lines, which are in order, to the points; each return has lines of its own."""
    line = np.empty(len(order), np.int64)
    line[order] = numbers
    if RETURN in columns:
        returns = columns[RETURN].astype(np.int64)
        line = line * (int(returns.max(initial=0)) + 1) + returns
    return line
