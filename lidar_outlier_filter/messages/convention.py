# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How clouds are read: which fields hold time and lines, in what unit, and what is claimed."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Bools, Floats, Rows
from lidar_outlier_filter.core.points import columns
from lidar_outlier_filter.core.points.line_recovery import Claim
from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.core.scan_pattern.recognise import rows_are_columns
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.messages.laser_scan import TIME_FIELD, TIME_UNIT
from lidar_outlier_filter.parameters.filter import FilterParameters

SCAN_SOURCE = 'scan'  # the source of lines of a 2-D scanner, whose messages are lines


@dataclass(frozen=True)
class Convention:
    """How clouds of one field layout are read; a field is ``None`` if the layout lacks it."""

    time_field: str | None
    time_unit: str
    time_is_absolute: bool
    line_source: str
    line_field: str | None
    warning: str = ''
    is_final: bool = True  # False while all times are 0, which leaves unit and reference open
    unit_is_known: bool = True  # False while times are too few to show it
    claim: Claim | None = None  # what time and geometry shall confirm; None: lines are as given
    is_counter: bool = False  # of 32 bits: it begins again from 0

    @property
    def has_rings(self) -> bool:
        """Whether the scan lines are the sensor's rings."""
        return self.line_source in {'field', 'row', 'column'}

    @property
    def is_message(self) -> bool:
        """Whether each message is a scan line."""
        return self.line_source in {'message', SCAN_SOURCE}

    def __str__(self) -> str:
        """Describe it for the log."""
        if self.line_source == SCAN_SOURCE:
            return 'times from time_increment, each scan is a scan line'
        if self.time_field is None:
            time = 'times from points_per_second'
        else:
            reference = 'absolute' if self.time_is_absolute else 'from the header stamp'
            reference = 'a counter of 32 bits' if self.is_counter else reference
            time = f'times from field {self.time_field!r} ({self.time_unit}, {reference})'
        if self.claim is not None and self.line_source == 'message':
            return f'{time}, no line field'
        lines = f'field {self.line_field!r}' if self.line_field else self.line_source
        return f'{time}, scan lines by {lines}'


def of_scan(parameters: FilterParameters) -> Convention:
    """Return how scans are read: nothing is to be found, and each is a scan line."""
    has_scores = parameters.scores
    warning = 'scans have no room for scores, which are left out' if has_scores else ''
    return Convention(TIME_FIELD, TIME_UNIT, False, SCAN_SOURCE, None, warning)  # noqa: FBT003


def detect(view: Rows, valid: Bools, xyz: Floats, parameters: FilterParameters) -> Convention:
    """Find how the clouds of a layout are read, by one that has a valid point."""
    names = ', '.join(view.dtype.names or ())
    warnings, is_final, is_known = [], True, True
    time_field, notes = _choose(view, valid, parameters, 'time_field')
    warnings += notes
    unit, absolute = parameters.time_unit, parameters.time_reference == 'absolute'
    if time_field is None:
        if parameters.points_per_second == 0:
            must_be = f'{columns.such_as(columns.TIMES)}, or time_field or points_per_second set'
            raise CloudError('the time field', must_be, f'the fields {names}')
        rate = parameters.points_per_second
        warnings.append(f'no time field: times follow from points_per_second {rate:g}')
    else:
        values = column_of(view, time_field)[valid]
        largest = float(np.nanmax(np.abs(values.astype(np.float64)), initial=0))
        is_final = 'auto' not in {unit, parameters.time_reference} or largest > 0
        if unit == 'auto':
            unit, note, is_known = columns.find_unit(values, view.dtype[time_field], time_field)
            warnings += [note] * bool(note)
        if parameters.time_reference == 'auto':
            absolute = largest * columns.NANOSECONDS[unit] > 10 * SECOND
    source, line_field = parameters.line_source, None
    if source in {'auto', 'field'}:
        line_field, notes = _choose(view, valid, parameters, 'line_field')
        warnings += notes
    if source == 'field' and line_field is None:
        must_be = columns.such_as(columns.LINES)
        raise CloudError('the line field', must_be, f'the fields {names}')
    if source == 'auto':
        source = 'field' if line_field else _unnumbered(view, valid, xyz)
        if source in {'row', 'column'}:
            warnings.append(f'no line field: each {source} is a scan line (line_source)')
    warning, claim = '; '.join(warnings), _claim(parameters, source, line_field, time_field)
    return Convention(
        time_field, unit, absolute, source, line_field, warning, is_final, is_known, claim
    )


def _claim(
    parameters: FilterParameters, source: str, line_field: str | None, time_field: str | None
) -> Claim | None:
    """Return what claims to be a scan line; None where lines are used as they are."""
    # What the user says is not asked after.
    if time_field is None or parameters.line_source != 'auto':
        return None
    names = {
        'row': 'the row',
        'column': 'the column',
        'message': 'the message',
        'angle': 'the scan angle',
    }
    return Claim(source, names.get(source, f'field {line_field!r}'))


def column_of(view: Rows, name: str) -> NDArray[Any]:
    """Return a field, one value for each point, row by row."""
    return np.asarray(view[name]).reshape(-1)


def named_field(view: Rows, name: str, parameter: str) -> NDArray[Any]:
    """Return the field that a parameter names; refuse the cloud if it is absent or not numeric."""
    names = view.dtype.names or ()
    if name not in names:
        must_be = 'one of the fields ' + ', '.join(names)
        raise CloudError(f'{parameter} {name!r}', must_be, 'none of them')
    if view.dtype[name].kind not in 'iuf':
        raise CloudError(f'field {name!r}', 'a single number', str(view.dtype[name]))
    return column_of(view, name)


def numbers_in(view: Rows) -> list[str]:
    """Return the fields of one number each."""
    return [name for name in view.dtype.names or () if view.dtype[name].kind in 'iuf']


def _unnumbered(view: Rows, valid: Bools, xyz: Floats) -> str:
    """Return what is a scan line of a cloud without a line field."""
    if view.shape[0] == 1:
        return 'message'
    is_turned = rows_are_columns(xyz.reshape(*view.shape, 3), valid.reshape(view.shape))
    return 'column' if is_turned else 'row'


def _choose(
    view: Rows, valid: Bools, parameters: FilterParameters, parameter: str
) -> tuple[str | None, list[str]]:
    """Return the field of times or lines, and notes on those that are not used.

    It is the one that the parameter names; with 'auto' one of a usual name, None if there is none.
    """
    name = parameters.value(parameter)
    if name != 'auto':
        named_field(view, name, parameter)
        return name, []
    if parameter == 'time_field':
        usual, objection = columns.TIMES, columns.too_coarse_times
    else:
        usual, objection = columns.LINES, columns.not_whole
    found, notes = columns.choose(
        numbers_in(view), usual, lambda name: objection(column_of(view, name), valid)
    )
    return found or None, notes
