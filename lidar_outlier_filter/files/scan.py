# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Scan lines of a whole file, found in what LAS keeps of the motion of the mirror."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    Ints = NDArray[np.int64]
    Columns = Mapping[str, NDArray[Any]]

EDGE, DIRECTION, RETURN = 'edge_of_flight_line', 'scan_direction_flag', 'return_number'
ANGLES = ('scan_angle', 'scan_angle_rank')
SOURCES = ('point_source_id', 'scanner_channel')
MIRROR = (EDGE, DIRECTION, *ANGLES)
COLUMNS = (*MIRROR, RETURN, *SOURCES)


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
    """Find the scan lines of points by the columns of LAS; None where no column tells them.

    Parameters
    ----------
    t : (N,) int64, nanoseconds
        In any order.
    columns : (N,) each, by name
        Those of :data:`COLUMNS` that there are, and the one that ``angle`` names.
    angle : str
        The column with the scan angle in any unit; it decides alone. Empty: a line ends, if any
        point is at an edge of the flight line, behind those; else, if the mirror turns, where the
        scan direction changes; else where the angle steps back by more than half of its span.

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
        values = columns[name][order]
        begins = _behind_edges(values, t) if name == EDGE else _changes(values, name)
        begins &= ~source_begins
        if begins.any():
            numbers = np.cumsum(begins | source_begins, dtype=np.int64)
            return ScanLines(_by_return(numbers, order, columns), name)
    return None


def _behind_edges(edge: NDArray[Any], t: Ints) -> NDArray[np.bool_]:
    """Tell where a line begins: at the shot after one with a return that is marked."""
    begins = np.zeros(len(t), np.bool_)
    begins[1:] = t[1:] != t[:-1]
    shot = np.cumsum(begins)
    marked = np.zeros(len(t), np.bool_)
    marked[shot[edge != 0]] = True
    begins &= marked[shot - 1] & (shot > 0)
    return begins


def _changes(values: NDArray[Any], name: str) -> NDArray[np.bool_]:
    """Tell where a line begins: where the direction changes, or the angle begins anew."""
    begins = np.zeros(len(values), np.bool_)
    if name == DIRECTION:
        begins[1:] = values[1:] != values[:-1]
    elif len(values):
        angle = values.astype(np.float64)
        begins[1:] = np.abs(np.diff(angle)) > (angle.max() - angle.min()) / 2
    return begins


def _by_return(numbers: Ints, order: Ints, columns: Columns) -> Ints:
    """Give the lines, which are in order, to the points; each return has lines of its own."""
    line = np.empty(len(order), np.int64)
    line[order] = numbers
    if RETURN in columns:
        returns = columns[RETURN].astype(np.int64)
        line = line * (int(returns.max(initial=0)) + 1) + returns
    return line
