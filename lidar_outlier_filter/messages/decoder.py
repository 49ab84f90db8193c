# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Convert messages to Points: time field, scan lines and missing returns."""

import copy
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats, Ints, Rows, Singles
from lidar_outlier_filter.core.detectors.registry import read_field, reads
from lidar_outlier_filter.core.points import columns
from lidar_outlier_filter.core.points.mask import NEEDS_RINGS, mask_of, masked
from lidar_outlier_filter.core.points.points import SECOND, Points, check_sigma, returns, too_coarse
from lidar_outlier_filter.core.points.scan_lines import LineCounter
from lidar_outlier_filter.errors import CloudError, short
from lidar_outlier_filter.messages.cloud import (
    AXES,
    MAX_LAYOUTS,
    SCORE_FIELDS,
    is_empty,
    structured,
)
from lidar_outlier_filter.messages.convention import (
    SCAN_SOURCE,
    Convention,
    column_of,
    detect,
    named_field,
    numbers_in,
    of_scan,
)
from lidar_outlier_filter.messages.laser_scan import ScanCloud
from lidar_outlier_filter.messages.stamps import StampCheck
from lidar_outlier_filter.parameters.filter import FilterParameters


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
            xyz[:, i] = column_of(view, axis)
        valid = returns(xyz)
        if isinstance(msg, ScanCloud):
            convention = self._with_rings(of_scan(self.parameters)) if valid.any() else None
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
        new = self._with_rings(detect(view, valid, xyz, self.parameters))
        if found is None or not is_final or new.time_unit != found.time_unit:
            return self._noting_counter(new, view, valid)
        return replace(found, unit_is_known=new.unit_is_known)

    def _noting_counter(self, found: Convention, view: Rows, valid: Bools) -> Convention:
        """Note that times do not count from the stamp, once they show it."""
        if found.is_counter or not found.time_field or self.parameters.time_reference != 'auto':
            return found
        times = column_of(view, found.time_field)
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

    def _with_rings(self, found: Convention) -> Convention:
        """Refuse a convention without rings, if there is a mask."""
        if self._mask is not None and not found.has_rings:
            raise CloudError('the scan lines', NEEDS_RINGS, f'by {found.line_source}')
        return found

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
        values = columns.unwrapped(column_of(view, convention.time_field), valid)
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
            return columns.whole_numbers(column_of(view, name), valid, f'field {name!r}')
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
            angle = named_field(view, parameters.angle_field, 'angle_field').astype(np.float64)
            return np.deg2rad(angle) if parameters.angle_unit == 'deg' else angle
        first, second = (AXES.index(axis) for axis in parameters.angle_plane)
        return np.arctan2(xyz[:, second], xyz[:, first])

    def _intensity(self, view: Rows) -> Singles | None:
        """Return the intensity field, if it exists and a detector uses it."""
        if not reads(self.parameters, 'intensity'):
            return None
        name, _ = columns.choose(numbers_in(view), columns.INTENSITIES)
        with np.errstate(over='ignore'):  # larger than float32: inf
            return column_of(view, name).astype(np.float32) if name else None

    def _field(self, view: Rows, name: str) -> Floats | None:
        """Return the field of a name, if it exists; warn once if not."""
        if found := columns.candidates(tuple(numbers_in(view)), (name,)):
            return column_of(view, found[0]).astype(np.float64)
        if not self._has_warned_of_field:
            self._has_warned_of_field = True
            fields = short(', '.join(view.dtype.names or ()))
            self._warn(f'among the fields {fields} there is {columns.missing(name)}')
        return None

    def _head(self, view: Rows) -> Ints | None:
        """Return which of several scanners measured each point, if a field says so."""
        names = [name for name in view.dtype.names or () if view.dtype[name].kind in 'iu']
        name, _ = columns.choose(names, columns.HEADS)
        return column_of(view, name).astype(np.int64) if name else None

    def _sigma(self, view: Rows, valid: Bools) -> Floats | None:
        name = self.parameters.sigma_field
        if not name:
            return None
        sigma = named_field(view, name, 'sigma_field').astype(np.float64)
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
