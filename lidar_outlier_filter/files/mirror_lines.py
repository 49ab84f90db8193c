# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Scan lines of LAS, which has no column with their numbers: by columns of the mirror's motion."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Bools, Columns, Floats, Ints

EDGE, DIRECTION = 'edge_of_flight_line', 'scan_direction_flag'
ANGLE_FIELDS = ('scan_angle', 'scan_angle_rank')
SOURCES = ('point_source_id', 'scanner_channel')
USER_DATA = 'user_data'  # where it makes lines much longer, it tells scanners apart
MIRROR = (EDGE, DIRECTION, *ANGLE_FIELDS)
SCANNERS = (*SOURCES, USER_DATA)
LAS_COLUMNS = (*MIRROR, *SCANNERS)
ANGLE_NOISE = 12  # a step smaller than this part of the angle's span may be noise


def find_lines(t: Ints, columns: Columns, angle: str = '') -> tuple[Ints | None, str]:
    """Find the scan lines of points by the columns of LAS.

    Parameters
    ----------
    t : (N,) int64, nanoseconds
        In any order.
    columns : (N,) each, by name
        Those of :data:`LAS_COLUMNS` that exist, and the one that ``angle`` names.
    angle : str
        Column with the scan angle, any unit. If empty, the first of these that occurs ends lines:
        a point marked as edge of the flight line; a change of the scan direction flag; a step
        of a source's angle by more than half of its span or, if the angle mostly steps one way,
        a step back by more than a twelfth of its span.

    Returns
    -------
    line : (N,) int64 or None
        Numbers of the lines; all returns of a shot are on one. None if no column ends lines.
    found_by : str
        The column whose changes end the lines.

    """
    sources = [columns[name] for name in SOURCES if name in columns]
    line, found_by = _find_lines(t, columns, angle, sources)
    user = columns.get(USER_DATA)
    if line is None or user is None or np.ptp(user) == 0:
        return line, found_by
    of_user, by_user = _find_lines(t, columns, angle, [*sources, user])
    # Scanners in turn: their angles jump all the time.
    if of_user is None or 2 * of_user.max() >= line.max():
        return line, found_by
    return of_user, by_user


def _find_lines(
    t: Ints, columns: Columns, angle: str, sources: Sequence[NDArray[Any]]
) -> tuple[Ints | None, str]:
    """Find the scan lines of each combination of sources."""
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
            line = np.empty(len(order), np.int64)
            line[order] = np.cumsum(begins | source_begins, dtype=np.int64)
            return line, name
    return None, ''


def _begins(values: NDArray[Any], name: str, t: Ints, source_begins: Bools) -> Bools:
    """Return where a line begins by a column, whose values are in order."""
    if name == EDGE:
        return _behind_edges(values, t)
    if name == DIRECTION:
        return np.append([False], values[1:] != values[:-1])[: len(values)]
    parts = np.split(values.astype(np.float64), np.flatnonzero(source_begins))
    return np.concatenate([_turns(part) for part in parts if len(part)] or [source_begins])


def _behind_edges(edge: NDArray[Any], t: Ints) -> Bools:
    """Return where a line begins: at the shot after one with a return that is marked."""
    begins = np.zeros(len(t), np.bool_)
    begins[1:] = t[1:] != t[:-1]
    shot = np.cumsum(begins)
    marked = np.zeros(len(t), np.bool_)
    marked[shot[edge != 0]] = True
    begins &= marked[shot - 1] & (shot > 0)
    return begins


def _turns(angle: Floats) -> Bools:
    """Return where the angle jumps back, of the points of one source, in order."""
    begins = np.zeros(len(angle), np.bool_)
    step, span = np.diff(angle), angle.max() - angle.min()
    begins[1:] = np.abs(step) > span / 2
    small = step[np.abs(step) <= span / ANGLE_NOISE]
    net = small.sum()
    if abs(net) > np.abs(small).sum() / 2:
        # The mirror turns one way: it does not swing.
        begins[1:] |= np.sign(net) * step < -span / ANGLE_NOISE
    return begins
