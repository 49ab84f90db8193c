# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A cloud that gains the field ``label``: points are moved, hidden and added, the others kept.

Makers give intensities in units of their own, with or without the range taken out. So what counts
is how bright a point is compared with what is usual at its range: the median there is a surface of
the reflectance ``TYPICAL``.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Bytes, Floats, Ints
from lidar_outlier_filter.core.points.columns import INTENSITIES, NANOSECONDS
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.messages.cloud import (
    AXES,
    is_empty,
    laid_out,
    more_fields,
    plain_rows,
    structured,
    with_rows,
)
from lidar_outlier_filter.messages.convention import Convention

TYPICAL = 0.25
DARKEST, BRIGHTEST = 0.02, 2.0  # reflectances; more than 1 is what sends light straight back
BINS = 12  # of the logarithm of the range
ENOUGH = 30  # points of a bin that show its median


class Brightness:
    """What is usual at each range, learnt from one cloud."""

    def __init__(self, distance: Floats, values: Floats) -> None:
        """Take the ranges (N,) of some points, metres, and their intensities (N,)."""
        position = np.log(distance)
        edges = np.linspace(position.min(), position.max() + 1e-9, BINS + 1)
        bins = np.digitize(position, edges) - 1
        known = [k for k in range(BINS) if (bins == k).sum() >= ENOUGH]
        median = [float(np.median(values[bins == k])) for k in known]
        pairs = [(edges[k : k + 2].mean(), m) for k, m in zip(known, median, strict=True) if m > 0]
        # Where nothing is bright, nothing can be said: all is alike.
        self._where = np.array([where for where, _ in pairs] or [0.0])
        self._usual = np.array([usual for _, usual in pairs] or [1.0])
        self._known = bool(pairs)

    def reflectance(self, distance: Floats, values: Floats) -> Floats:
        """Return reflectances (N,), cosine of incidence included, from intensities."""
        if not self._known:
            return np.full(len(values), TYPICAL)
        bright: Floats = TYPICAL * values / self._at(distance)
        return np.clip(bright, DARKEST, BRIGHTEST)

    def intensity(self, distance: Floats, reflectance: Floats) -> Floats:
        """Return the intensities (N,) of what sends back so much."""
        return reflectance / TYPICAL * self._at(distance)

    def _at(self, distance: Floats) -> Floats:
        return np.interp(np.log(distance), self._where, self._usual)


LABEL = 'label'
RANGES = ('range', 'distance')
ALIKE = 0.05  # share of a range by which its field may be off, and of the points where it is more


class FoundPoints(NamedTuple):
    """What weather makes of M shots.

    Attributes
    ----------
    direction : (M, 3) float64
    distance : (M,) float64, metres
    reflectance : (M,) float64, of a surface that were as bright
    cause : (M,) uint8

    """

    direction: Floats
    distance: Floats
    reflectance: Floats
    cause: Bytes


class LabelledCloud:
    """A cloud whose points all have the label 0, to be changed; ``count`` are its own."""

    def __init__(self, msg: Any) -> None:
        """Copy the points.

        Raises
        ------
        CloudError
            If it has labels.

        """
        if any(item.name == LABEL for item in msg.fields):
            raise CloudError('the fields', f'without {LABEL!r}', 'a cloud with labels')
        self._msg, plain = msg, plain_rows(msg)
        self.count = len(plain)
        wider = np.zeros(len(plain), [('point', plain.dtype), (LABEL, 'u1')])
        wider['point'] = plain
        # As plain bytes: a copy of a structured array would lose its padding.
        self._rows = wider.view(np.dtype((np.void, wider.dtype.itemsize)))
        self._layout = wider.dtype if is_empty(msg) else _layout(structured(msg).dtype)
        self._position = np.arange(len(plain), dtype=np.float64)
        self._kept = np.ones(len(plain), np.bool_)
        self._curves: dict[str, Brightness] = {}
        self._ranges: dict[str, float] = {}

    def column(self, name: str) -> NDArray[Any]:
        """View a field of all points."""
        return np.asarray(self._rows.view(self._layout)[name])

    def learn(self, points: Points) -> Floats:
        """Learn what its intensities and ranges mean; return reflectances (N,), of all points."""
        there, distance = points.valid, points.range
        result = np.full(self.count, TYPICAL)
        for name in self._numbers(INTENSITIES):
            values = self.column(name).astype(np.float64)
            fine = there & np.isfinite(values)
            self._curves[name] = Brightness(distance[fine], values[fine])
            if len(self._curves) == 1:
                result[fine] = self._curves[name].reflectance(distance[fine], values[fine])
        for name in self._numbers(RANGES):
            ratio = self.column(name)[there] / distance[there]
            usual = float(np.median(ratio))
            if np.mean(np.abs(ratio - usual) <= ALIKE * usual) >= 1.0 - ALIKE:
                self._ranges[name] = usual
        return result

    def _numbers(self, requested: tuple[str, ...]) -> list[str]:
        """List those fields that are there and hold one number."""
        names = self._layout.names or ()
        return [n for n in requested if n in names and self._layout[n].kind in 'iuf']

    def dim(self, rows: Ints, share: Floats) -> None:
        """Let points keep a share of their light."""
        darker = share < 1.0
        for name in self._curves:
            values = self.column(name)[rows[darker]].astype(np.float64)
            self._store(name, rows[darker], values * share[darker])

    def move(self, rows: Ints, found: FoundPoints) -> None:
        """Put points elsewhere, and label them."""
        for axis, name in enumerate(AXES):
            self._store(name, rows, found.direction[:, axis] * found.distance)
        for name, curve in self._curves.items():
            self._store(name, rows, curve.intensity(found.distance, found.reflectance))
        for name, ratio in self._ranges.items():
            self._store(name, rows, ratio * found.distance)
        self.column(LABEL)[rows] = found.cause

    def hide(self, rows: Ints) -> None:
        """Let points be missing: as 0 or NaN in an organised cloud, otherwise they go.

        All axes alike, as in the rows that are missing already; whole numbers know no NaN.
        """
        if self._msg.height == 1:
            self._kept[rows] = False
            return
        xyz = np.stack([self.column(name)[: self.count] for name in AXES])
        whole = any(self._layout[name].kind != 'f' for name in AXES)
        no_return = 0 if whole or (xyz == 0).all(axis=0).any() else np.nan
        for name in AXES:
            self.column(name)[rows] = no_return
        for name in self._ranges:
            self.column(name)[rows] = 0

    def add(self, like: Ints, found: FoundPoints) -> Ints:
        """Add points behind others and like these; return their rows."""
        first = len(self._rows)
        self._rows = np.concatenate([self._rows, self._rows[like]])
        self._position = np.concatenate([self._position, like + 0.5])
        self._kept = np.concatenate([self._kept, np.ones(len(like), np.bool_)])
        rows = np.arange(first, len(self._rows))
        self.move(rows, found)
        return rows

    def set_time(self, rows: Ints, t: Ints, convention: Convention) -> None:
        """Give points the time at which they were measured, nanoseconds."""
        name = convention.time_field
        if name is None:
            return
        seconds, stamp = divmod(t, NANOSECONDS['s']), self._msg.header.stamp
        whole, part = seconds
        if not convention.time_is_absolute:
            whole, part = whole - stamp.sec, part - stamp.nanosec
        unit = NANOSECONDS[convention.time_unit]
        each = NANOSECONDS['s'] // unit
        if self._layout[name].kind == 'f':
            # Whole seconds apart, so that a float64 of absolute times keeps what it can hold.
            self._store(name, rows, whole * float(each) + part / unit)
        else:
            self._store(name, rows, whole * each + part // unit)

    def _store(self, name: str, rows: Ints, values: NDArray[Any]) -> None:
        """Store numbers as their field can hold them; what is too bright is as bright as can be."""
        kind = self._layout[name]
        if kind.kind in 'iu':
            limits = np.iinfo(kind)
            values = np.clip(np.rint(values), limits.min, limits.max)
        self.column(name)[rows] = values

    @property
    def labels(self) -> Bytes:
        """The labels of the points that are there, missing ones left out."""
        here = self._kept.copy()
        if not is_empty(self._msg):
            xyz = np.stack([self.column(name) for name in AXES]).astype(np.float64)
            here &= np.isfinite(xyz).all(axis=0) & (xyz != 0).any(axis=0)
        return np.asarray(self.column(LABEL)[here])

    def message(self) -> Any:
        """Make the message, its points in order."""
        order = np.argsort(self._position, kind='stable')
        rows = self._rows[order[self._kept[order]]]
        msg, step = self._msg, self._rows.dtype.itemsize
        if not msg.fields:
            return msg
        fields = more_fields(msg, {LABEL: 'u1'})
        result = with_rows(msg, rows, fields, step, msg.height if len(rows) else 1)
        if msg.height > 1:
            result.is_dense = bool(msg.is_dense) and not np.isnan(self.column('x')).any()
        return result


def _layout(dtype: np.dtype[np.void]) -> np.dtype[np.void]:
    """Put the label behind the other fields."""
    fields: Any = dtype.fields
    columns = {name: fields[name][:2] for name in dtype.names or ()}
    return laid_out(columns | {LABEL: (np.dtype('u1'), dtype.itemsize)}, dtype.itemsize + 1)
