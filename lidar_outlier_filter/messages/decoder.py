# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Convert messages to Points: time field, scan lines and missing returns."""

import copy
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Bools, Floats, Ints, Rows, Singles
from lidar_outlier_filter.core.detectors.registry import read_field, reads
from lidar_outlier_filter.core.points import columns
from lidar_outlier_filter.core.points.line_recovery import Claim
from lidar_outlier_filter.core.points.mask import NEEDS_RINGS, mask_of, masked
from lidar_outlier_filter.core.points.points import SECOND, Points, check_sigma, returns, too_coarse
from lidar_outlier_filter.core.points.scan_lines import LineCounter
from lidar_outlier_filter.core.scan_pattern.recognise import rows_are_columns
from lidar_outlier_filter.errors import CloudError, short
from lidar_outlier_filter.messages.cloud import (
    AXES,
    MAX_LAYOUTS,
    SCORE_FIELDS,
    is_empty,
    structured,
)
from lidar_outlier_filter.messages.laser_scan import TIME_FIELD, TIME_UNIT, ScanCloud
from lidar_outlier_filter.messages.stamps import StampCheck
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


class Decoder:
    """Decodes the clouds of one topic; keeps their conventions and the current scan line."""

    def __init__(
        self,
        parameters: FilterParameters,
        inform: Callable[[str], object] = str,
        warn: Callable[[str], object] = str,
    ) -> None:
        """Store the parameters; ``inform`` and ``warn`` receive one sentence per layout."""
        self.parameters = parameters
        self._inform = inform
        self._warn = warn
        self.convention: Convention | None = None  # of the last cloud with a valid point
        self._conventions: dict[np.dtype[np.void], Convention] = {}
        self._clocks: dict[np.dtype[np.void], columns.Counter] = {}
        self._reports = 0  # of conventions
        self._counter = LineCounter()
        self._previous_counter = self._counter
        self._stamps = self._previous_stamps = StampCheck()
        self._mask = mask_of(parameters)
        self._has_warned_of_steps = self._has_warned_of_field = False

    # Signalling NaNs raise no warning when they are converted or compared.
    @np.errstate(invalid='ignore')
    def decode(self, msg: Any) -> Points:
        """Convert a cloud to points, in row-major order.

        Returns
        -------
        Points
            One per point of the message. Invalid points have time 0.

        Raises
        ------
        CloudError
            If the cloud cannot be decoded, a coordinate is beyond ``FARTHEST``, or a valid point
            has no time or no standard deviation.

        """
        self._previous_counter = copy.copy(self._counter)
        self._previous_stamps = copy.copy(self._stamps)
        view = self.view(msg)
        if view is None:
            return _empty_points(with_sigma=bool(self.parameters.sigma_field))
        xyz = np.empty((view.size, 3))
        for i, axis in enumerate(AXES):
            xyz[:, i] = _column(view, axis)
        valid = returns(xyz)
        if isinstance(msg, ScanCloud):
            convention = self._of_scan() if valid.any() else None
        else:
            convention = self._convention(view, valid, xyz)
        if convention is None:
            # Without a valid point there is no convention, and nothing to judge.
            zeros = np.zeros(view.size, np.int64)
            return Points(xyz, zeros, zeros, valid, self._sigma(view, valid))
        t = self._time(view, valid, msg.header.stamp, convention)
        sigma = self._sigma(view, valid)
        line = self._line(view, xyz, valid, convention)
        if not convention.time_is_absolute and convention.time_field is not None:
            t = self._in_turn(t, line, valid, msg.header.stamp, convention)
        # The cloud is accepted from here on.
        self._store(view.dtype, convention)
        if not self._has_warned_of_steps:
            self._warn_of_steps(view.dtype, xyz, valid)
        points = Points(xyz, t, line, valid, sigma, intensity=self._intensity(view))
        if name := read_field(self.parameters):
            points = replace(points, field=self._field(view, name))
        if convention.claim is not None:
            points = replace(points, head=self._head(view))
        return masked(points, self._mask, self.parameters)

    def view(self, msg: Any) -> Rows | None:
        """Return a cloud's points as a structured view; None if it is empty.

        Raises
        ------
        CloudError
            If its fields or shape cannot be processed.

        """
        self._refuse_scores(msg)
        if is_empty(msg):
            return None
        view = structured(msg)
        self._refuse_integers(view)
        return view

    def undo(self) -> None:
        """Restore line counter and stamps from before the last cloud, which was refused."""
        self._counter, self._stamps = self._previous_counter, self._previous_stamps

    def reset(self) -> None:
        """Reset the line counter: the next cloud does not continue the last one."""
        self._counter.reset()
        self._clocks.clear()
        self._stamps = StampCheck()

    def _refuse_scores(self, msg: Any) -> None:
        """Refuse a cloud that already has score fields, if scores are to be added."""
        names = [item.name for item in msg.fields]
        if self.parameters.scores and not SCORE_FIELDS.keys().isdisjoint(names):
            must_be = 'without ' + ', '.join(SCORE_FIELDS)
            raise CloudError('the fields', must_be, ', '.join(names))

    def _refuse_integers(self, view: Rows) -> None:
        """Refuse an organised cloud whose coordinates cannot be NaN, if it keeps its shape."""
        if self.parameters.keep_organized and view.shape[0] > 1:
            for axis in AXES:
                if view.dtype[axis].kind != 'f':
                    must_be = 'a float, to become NaN under keep_organized'
                    raise CloudError(f'field {axis!r}', must_be, str(view.dtype[axis]))

    def _convention(self, view: Rows, valid: Bools, xyz: Floats) -> Convention | None:
        """Return the convention of this layout; None until it has a valid point."""
        found = self._conventions.get(view.dtype)
        is_final = found is not None and found.is_final
        if found is not None and ((is_final and found.unit_is_known) or not valid.any()):
            return self._noting_counter(found, view, valid)
        if not valid.any():
            return None
        new = self._detect(view, valid, xyz)
        if found is None or not is_final or new.time_unit != found.time_unit:
            return self._noting_counter(new, view, valid)
        return replace(found, unit_is_known=new.unit_is_known)

    def _noting_counter(self, found: Convention, view: Rows, valid: Bools) -> Convention:
        """Note that times do not count from the stamp, once they show it."""
        if found.is_counter or not found.time_field or self.parameters.time_reference != 'auto':
            return found
        times = _column(view, found.time_field)
        return replace(found, is_counter=columns.Counter.is_one(times, valid, found.time_unit))

    def _store(self, dtype: np.dtype[np.void], convention: Convention) -> None:
        """Keep the convention for later clouds of this layout, and report it once."""
        self.convention = convention
        previous = self._conventions.pop(dtype, None)
        if len(self._conventions) == MAX_LAYOUTS:
            # That which was used longest ago; a flood of layouts must not refuse honest ones.
            oldest = next(iter(self._conventions))
            del self._conventions[oldest]
            self._clocks.pop(oldest, None)
        self._conventions[dtype] = convention
        is_new = previous is None or str(previous) != str(convention)
        is_worse = convention.warning and (
            previous is None or previous.warning != convention.warning
        )
        if self._reports == MAX_LAYOUTS or not (is_new or is_worse):
            return
        self._reports += 1
        if is_new:
            self._inform(str(convention))
        if is_worse:
            names = short(', '.join(dtype.names or ()))
            text = f'among the fields {names} there is {convention.warning}'
            self._warn(convention.warning if convention.line_source == SCAN_SOURCE else text)

    def _warn_of_steps(self, dtype: np.dtype[np.void], xyz: Floats, valid: Bools) -> None:
        """Warn once of coordinates whose float32 resolution is too coarse."""
        single = [dtype[axis].base.itemsize == 4 and dtype[axis].kind == 'f' for axis in AXES]  # noqa: PLR2004  bytes
        if warning := too_coarse(xyz, valid, single):
            self._has_warned_of_steps = True
            self._warn(warning)

    def _of_scan(self) -> Convention:
        """Return how scans are read: nothing is to be found, and each is a scan line."""
        has_scores = self.parameters.scores
        warning = 'scans have no room for scores, which are left out' if has_scores else ''
        return self._with_rings(
            Convention(TIME_FIELD, TIME_UNIT, False, SCAN_SOURCE, None, warning)  # noqa: FBT003
        )

    def _with_rings(self, found: Convention) -> Convention:
        """Refuse a convention without rings, if there is a mask."""
        if self._mask is not None and not found.has_rings:
            raise CloudError('the scan lines', NEEDS_RINGS, f'by {found.line_source}')
        return found

    def _detect(self, view: Rows, valid: Bools, xyz: Floats) -> Convention:
        parameters = self.parameters
        names = ', '.join(view.dtype.names or ())
        warnings, is_final, is_known = [], True, True
        time_field, notes = _choose(view, valid, parameters, 'time_field')
        warnings += notes
        unit, absolute = parameters.time_unit, parameters.time_reference == 'absolute'
        if time_field is None:
            if parameters.points_per_second == 0:
                must_be = (
                    f'{columns.such_as(columns.TIMES)}, or time_field or points_per_second set'
                )
                raise CloudError('the time field', must_be, f'the fields {names}')
            rate = parameters.points_per_second
            warnings.append(f'no time field: times follow from points_per_second {rate:g}')
        else:
            values = _column(view, time_field)[valid]
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
        warning, claim = '; '.join(warnings), self._claim(source, line_field, time_field)
        found = Convention(
            time_field, unit, absolute, source, line_field, warning, is_final, is_known, claim
        )
        return self._with_rings(found)

    def _claim(self, source: str, line_field: str | None, time_field: str | None) -> Claim | None:
        """Return what claims to be a scan line; None where lines are used as they are."""
        parameters = self.parameters
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

    def _time(self, view: Rows, valid: Bools, stamp: Any, convention: Convention) -> Ints:
        if convention.time_field is None:
            # All lines of an organised cloud are measured at once.
            height, width = view.shape
            rings, shot = height, np.tile(np.arange(width), height)
            if convention.line_source == 'column':
                rings, shot = width, np.repeat(np.arange(height), width)
            step = rings * SECOND / self.parameters.points_per_second
            offset: Ints = np.rint(shot * step).astype(np.int64)
            return offset + _nanoseconds(stamp)
        values = columns.unwrapped(_column(view, convention.time_field), valid)
        t = columns.to_nanoseconds(values, valid, convention.time_unit)
        is_absolute = convention.time_is_absolute
        sent = 0 if is_absolute and stamp is None else _nanoseconds(stamp)
        start = 0 if is_absolute else sent
        if convention.is_counter and valid.any():
            clock = self._clocks.setdefault(view.dtype, columns.Counter(convention.time_unit))
            start = clock.start(int(t[valid.argmax()]), sent, is_absolute=is_absolute)
        return np.asarray(np.where(valid, t + start, 0))

    def _in_turn(
        self, t: Ints, line: Ints, valid: Bools, stamp: Any, convention: Convention
    ) -> Ints:
        """Let sweeps follow each other where their stamps stand still, or come too early."""
        start, before = _nanoseconds(stamp), copy.copy(self._stamps)
        known = np.zeros(1, np.int64) if convention.is_message else line[valid]
        behind = self._stamps.behind(start, t[valid] - start, known)
        if self._stamps.stands_still and not before.stands_still:
            self._warn('stamps stand still: each cloud follows the one before, by its own times')
        if self._stamps.jitters and not before.jitters:
            self._warn(
                f'stamps jitter: a cloud began {behind / 1e6:.1f} ms before the end of the one '
                'before; such clouds follow it, by their own times'
            )
        return np.asarray(np.where(valid, t + behind, 0)) if behind else t

    def _line(self, view: Rows, xyz: Floats, valid: Bools, convention: Convention) -> Ints:
        height, width = view.shape
        if convention.line_source == 'field':
            name = str(convention.line_field)
            return columns.whole_numbers(_column(view, name), valid, f'field {name!r}')
        if convention.line_source == 'row':
            return np.repeat(np.arange(height), width)
        if convention.line_source == 'column':
            return np.tile(np.arange(width), height)
        if convention.is_message:
            return self._counter.next_line(view.size)
        return self._counter.by_angle(self._angle(view, xyz), valid)

    def _angle(self, view: Rows, xyz: Floats) -> Floats:
        parameters = self.parameters
        if parameters.angle_field:
            angle = _named(view, parameters.angle_field, 'angle_field').astype(np.float64)
            return np.deg2rad(angle) if parameters.angle_unit == 'deg' else angle
        first, second = (AXES.index(axis) for axis in parameters.angle_plane)
        return np.arctan2(xyz[:, second], xyz[:, first])

    def _intensity(self, view: Rows) -> Singles | None:
        """Return the intensity field, if it exists and a detector uses it."""
        if not reads(self.parameters, 'intensity'):
            return None
        name, _ = columns.choose(_numbers(view), columns.INTENSITIES)
        with np.errstate(over='ignore'):  # larger than float32: inf
            return _column(view, name).astype(np.float32) if name else None

    def _field(self, view: Rows, name: str) -> Floats | None:
        """Return the field of a name, if it exists; warn once if not."""
        if found := columns.candidates(tuple(_numbers(view)), (name,)):
            return _column(view, found[0]).astype(np.float64)
        if not self._has_warned_of_field:
            self._has_warned_of_field = True
            fields = short(', '.join(view.dtype.names or ()))
            self._warn(f'among the fields {fields} there is {columns.missing(name)}')
        return None

    def _head(self, view: Rows) -> Ints | None:
        """Return which of several scanners measured each point, if a field says so."""
        names = [name for name in view.dtype.names or () if view.dtype[name].kind in 'iu']
        name, _ = columns.choose(names, columns.HEADS)
        return _column(view, name).astype(np.int64) if name else None

    def _sigma(self, view: Rows, valid: Bools) -> Floats | None:
        name = self.parameters.sigma_field
        if not name:
            return None
        sigma = _named(view, name, 'sigma_field').astype(np.float64)
        check_sigma(sigma, valid, f'field {name!r}')
        return sigma


def _empty_points(*, with_sigma: bool) -> Points:
    no_integers = np.empty(0, np.int64)
    sigma = np.empty(0) if with_sigma else None
    return Points(np.empty((0, 3)), no_integers, no_integers, np.empty(0, np.bool_), sigma)


def _nanoseconds(stamp: Any) -> int:
    """Return the stamp of a header; refuse an array that was passed without ``stamp``."""
    if stamp is None:
        must_be = 'given, in nanoseconds, for an array whose times count from it'
        raise CloudError('the stamp', must_be, 'none')
    return int(stamp.sec * SECOND + stamp.nanosec)


def _column(view: Rows, name: str) -> NDArray[Any]:
    return np.asarray(view[name]).reshape(-1)


def _named(view: Rows, name: str, parameter: str) -> NDArray[Any]:
    """Return the field that a parameter names; refuse the cloud if it is absent or not numeric."""
    names = view.dtype.names or ()
    if name not in names:
        must_be = 'one of the fields ' + ', '.join(names)
        raise CloudError(f'{parameter} {name!r}', must_be, 'none of them')
    if view.dtype[name].kind not in 'iuf':
        raise CloudError(f'field {name!r}', 'a single number', str(view.dtype[name]))
    return _column(view, name)


def _numbers(view: Rows) -> list[str]:
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
        _named(view, name, parameter)
        return name, []
    if parameter == 'time_field':
        usual, objection = columns.TIMES, columns.too_coarse_times
    else:
        usual, objection = columns.LINES, columns.not_whole
    found, notes = columns.choose(
        _numbers(view), usual, lambda name: objection(_column(view, name), valid)
    )
    return found or None, notes
