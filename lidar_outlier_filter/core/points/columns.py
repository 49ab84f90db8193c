# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Which columns of messages, arrays and files hold time, line and intensity, and in what unit.

The usual names are here, in the order of preference. A column has a usual name if it is written
so; else in any case; else without separators, CloudCompare's ``scalar_``, or a unit behind it, such
as in ``Laser ID``, ``scalar_Intensity`` and ``time_us``.
"""

import re
from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Bools, Floats, Ints, Singles
from lidar_outlier_filter.core.points.points import LONGEST_NS, SECOND
from lidar_outlier_filter.errors import CloudError

Names = tuple[str, ...]
# LAS; then Ouster, Velodyne, Hesai and others; laser_geometry's stamps; VeloView's tables
TIMES: Names = (
    *('gps_time', 't', 'time', 'timestamp', 'time_stamp', 'offset_time', 'time_offset'),
    *('t_offset', 'timestamps', 'stamp', 'stamps', 'adjusted_gps_time', 'adjustedtime'),
    *('timestamp_offset', 'relative_time'),
)
LINES: Names = (
    *('ring', 'channel', 'line', 'laser_id', 'laser', 'layer', 'laser_number', 'ring_id'),
    *('beam_id', 'beam', 'profile', 'scan_line', 'ring_number', 'channel_id', 'line_id'),
    *('line_number', 'scan_line_number', 'beam_number', 'profile_id', 'profile_number'),
)
# Which of several scanners that share a message or a file measured a point.
HEADS: Names = (
    *('head', 'head_id', 'scanner', 'scanner_id', 'scanner_channel', 'scanner_number'),
    *('lidar_id', 'device_id', 'sensor_id', 'laser_head'),
)
INTENSITIES: Names = ('intensity', 'reflectivity', 'reflectance', 'i', 'amplitude', 'remission')

TIMES_AT_ONCE = 1 << 17  # times that are converted at once: arrays stay in the cache
NANOSECONDS = {'s': SECOND, 'ms': 1_000_000, 'us': 1000, 'ns': 1}
_UNIT = '([mun]?s(?:ec)?)'
_WITH_UNIT = re.compile(rf'(.+?)(?:[ _.]{_UNIT}|[ _]?[\[(]{_UNIT}[\])])')

# Seconds since 1970: from 2001 on, up to LONGEST_NS.
UNIX_S = (1e9, LONGEST_NS / SECOND)
# Nanoseconds from point to point that lidars have, and one that is usual. Those that share a time
# count, too, so that the time of a packet or of a column is not taken for that of a shot.
MIN_INTERVAL_NS, USUAL_INTERVAL_NS, MAX_INTERVAL_NS = 30.0, 3000.0, 300_000.0
# A message of few points spans less, whatever the interval; and its times are not farther apart.
MAX_SPARSE_NS, MAX_SPARSE_STEP_NS = 0.25 * SECOND, 0.02 * SECOND
MIN_POINTS, MIN_TIMES = 100, 3  # that show an interval
MAX_ZERO_SHARE = 0.4  # of intensities: weak returns have 0, too, up to 0.11 of a clean sweep
MAX_STEP_NS = 1e6  # between two float32 that still tell the times of points apart
MAX_FROM_STAMP_NS = SECOND // 2  # that all points of a message are from its stamp
WRAP = 2**32  # of times that are uint32
WRAP_SHARE = 0.9  # of it: a step that long is no step of time


def _plain(name: str) -> str:
    """Return a name in small letters, without separators, prefix and unit."""
    name = name.lower().removeprefix('scalar_')
    match = _WITH_UNIT.fullmatch(name)
    return re.sub('[ _.-]', '', match[1] if match else name)


def unit_of(name: str) -> str:
    """Return the unit that the name of a column ends with, such as ``time_us``; else empty."""
    match = _WITH_UNIT.fullmatch(name.lower().replace('µ', 'u'))
    return (match[2] or match[3]).removesuffix('ec') if match else ''


@lru_cache(maxsize=256)  # of a stream: the same for each cloud
def candidates(names: Names, usual: Names) -> Names:
    """Return the columns that have a usual name, the best first."""
    found: dict[str, None] = {}
    for form in (str, str.lower, _plain):
        for one in usual:
            found |= dict.fromkeys(name for name in names if form(name) == form(one))
    return tuple(found)


def choose(
    names: Iterable[str], usual: Names, objection: Callable[[str], str] = lambda _: ''
) -> tuple[str, list[str]]:
    """Return the best column of a usual name, or empty, and a note for each passed over.

    Parameters
    ----------
    names : of all columns of numbers
    usual : TIMES, LINES or INTENSITIES
    objection : returns why a column cannot be what its name says; empty: it can

    """
    notes: list[str] = []
    for name in candidates(tuple(names), usual):
        if not (why := objection(name)):
            return name, notes
        notes.append(f'{name!r}, which is not used: {why}')
    return '', notes


def missing(field: str) -> str:
    """Say that a field is missing; goes on "among the fields there is"."""
    return f'no {field!r}, which a detector of the chain reads: it tests no point'


def such_as(usual: Names) -> str:
    """Return the first usual names, for a refusal."""
    return f'of a usual name, such as {", ".join(usual[:4])}'


def not_whole(values: NDArray[Any], valid: Bools) -> str:
    """Return why a column cannot number lines; empty: it can."""
    if values.dtype.kind != 'f':
        return ''
    known = values[valid & np.isfinite(values)]
    whole = len(known) > 0 and bool((known == np.floor(known)).all())
    return '' if whole else 'not of whole numbers'


def whole_numbers(values: NDArray[Any], valid: Bools, what: str) -> Ints:
    """Return the line of each point; 0 for a missing return that has none.

    Raises
    ------
    CloudError
        If a valid point has no whole number.

    """
    plain = np.ma.getdata(values)
    if plain.dtype.kind != 'f' and not np.ma.is_masked(values):
        return plain.astype(np.int64)
    known = ~np.ma.getmaskarray(values)
    if plain.dtype.kind == 'f':
        known &= np.isfinite(plain) & (plain == np.floor(plain))
    if not known[valid].all():
        raise CloudError(what, 'of whole numbers', 'others')
    return np.where(known, plain, 0).astype(np.int64)


def too_coarse_times(values: NDArray[Any], valid: Bools) -> str:
    """Return why float32 cannot hold these times; empty: it can."""
    if values.dtype.kind != 'f' or values.dtype.itemsize > 4:  # noqa: PLR2004  bytes
        return ''
    known = values[valid & np.isfinite(values)]
    size = float(np.median(np.abs(known))) if len(known) else 0.0
    unit = find_unit(known, values.dtype).name
    step = float(np.spacing(np.float32(size))) * NANOSECONDS[unit]
    if not step > MAX_STEP_NS:
        return ''
    return f'float32 of {size:.3g} {unit} come in steps of {step / SECOND:.2g} s'


def telling(intensity: Singles | None) -> Singles | None:
    """Return the intensities that say something of their points; NaN are unknown.

    None where all are equal, as in drivers without intensity; where many are 0, these are unknown,
    and none tells anything if the others are equal.
    """
    if intensity is None:
        return None
    known = intensity[intensity >= 0]
    if not len(known) or known.min() == known.max():
        return None
    if np.count_nonzero(known) >= (1.0 - MAX_ZERO_SHARE) * len(known):
        return intensity
    rest = known[known > 0]
    if rest.min() == rest.max():
        return None
    return np.where(intensity == 0, np.float32(np.nan), intensity)


class TimeUnit(NamedTuple):
    """The unit of a column of times.

    Attributes
    ----------
    name : one of ``NANOSECONDS``
    note : why it is not the usual one, or what does not fit it; empty: nothing to say
    is_known : False where neither sizes nor intervals show the unit

    """

    name: str
    note: str = ''
    is_known: bool = True


def find_unit(values: NDArray[Any], kind: np.dtype[Any], name: str = '') -> TimeUnit:
    """Find the unit of times: what the name says, else the usual one, unless it makes no sense.

    Integers are usually nanoseconds (Ouster ``t``, Autoware ``time_stamp``, Livox ``offset_time``),
    float32 seconds (Velodyne ``time``). A float64 is seconds up to 10 (relative). Where it is of
    the size of Unix time in any unit, it is in that. Beyond, it is nanoseconds since the sensor's
    start; below, nanoseconds if all are whole numbers (relative), else seconds.

    Points of a lidar follow each other by 30 ns to 0.3 ms, however a stream is cut. Where they do
    not in the usual unit, the one is taken in which they come nearest to 3 µs.

    Parameters
    ----------
    values : (N,) times of valid points, in any order
    kind : their type in the message or file
    name : of the column

    """
    if named := unit_of(name):
        return TimeUnit(named)
    size = np.abs(values.astype(np.float64))
    largest = float(np.nanmax(size, initial=0))
    usual, is_unix = _usual_unit(kind, size, largest)
    if 'gps' in name.lower() and kind.kind == 'f' and not is_unix:
        return TimeUnit('s')  # by LAS, also where most points were left out
    step, share = _step(values)
    if not step > 0:
        return TimeUnit(usual, is_known=is_unix)
    interval, factor = step / share, NANOSECONDS[usual]
    each = interval * factor
    sparse = each * len(values) <= MAX_SPARSE_NS and step * factor <= MAX_SPARSE_STEP_NS
    if each >= MIN_INTERVAL_NS and (each <= MAX_INTERVAL_NS or sparse):
        return TimeUnit(usual)
    apart = f'points would be {each / SECOND:.2g} s apart (time_unit)'
    fitting = {
        unit: abs(np.log(interval * factor / USUAL_INTERVAL_NS))
        for unit, factor in NANOSECONDS.items()
        if MIN_INTERVAL_NS <= interval * factor <= MAX_INTERVAL_NS and largest * factor < LONGEST_NS
    }
    if not fitting:
        return TimeUnit(usual, f'a time {name!r} in no likely unit: in {usual}, {apart}')
    best = min(fitting, key=lambda unit: fitting[unit])
    return TimeUnit(best, f'a time {name!r} in {best}: in {usual}, {apart}')


def _usual_unit(kind: np.dtype[Any], size: Floats, largest: float) -> tuple[str, bool]:
    """Return the unit that type and size suggest, and whether the size is that of Unix time."""
    unix = [
        unit
        for unit, factor in NANOSECONDS.items()
        if UNIX_S[0] <= largest * (factor / SECOND) < UNIX_S[1]
    ]
    if kind.kind != 'f':
        # A counter passes through the sizes of seconds and milliseconds.
        return ('us', True) if unix == ['us'] else ('ns', unix == ['ns'])
    if kind.itemsize == 4 or largest <= 10:  # noqa: PLR2004  float32; ten seconds
        return 's', False
    if unix:
        return unix[0], True
    whole = bool((size == np.floor(size)).all())
    return ('ns' if largest >= UNIX_S[1] or (largest < UNIX_S[0] and whole) else 's'), False


def _step(values: NDArray[Any]) -> tuple[float, float]:
    """Return the median step of time, NaN if too few show it, and how many points share a time."""
    times = np.unique(values[np.isfinite(values)])
    if len(values) < MIN_POINTS or len(times) < MIN_TIMES:
        return np.nan, 1.0
    return float(np.median(np.diff(times).astype(np.float64))), len(values) / len(times)


def unwrapped(values: NDArray[Any], valid: Bools) -> NDArray[Any]:
    """Return times that go on where a counter of 32 bits began again from 0, as int64.

    Others are returned as they are.
    """
    longest = int(WRAP_SHARE * WRAP)
    if values.dtype.kind not in 'iu' or not len(values):
        return values
    low, high = int(values.min()), int(values.max())
    if low < 0 or high >= WRAP or high - low < longest:
        return values
    times = values.astype(np.int64)
    step = np.diff(times[valid], prepend=times[valid][:1])
    times[valid] += WRAP * np.cumsum((step < -longest).astype(np.int64) - (step > longest))
    return times


class Counter:
    """Lets a clock of 32 bits go on from message to message, by their stamps.

    Of nanoseconds, it begins again every 4.3 s.
    """

    def __init__(self, unit: str) -> None:
        """Count from 0; ``unit`` is that of the field."""
        self._wrap = WRAP * NANOSECONDS[unit]
        self._stamp = self._first = self._start = 0
        self._is_new = True

    @staticmethod
    def is_one(values: NDArray[Any], valid: Bools, unit: str) -> bool:
        """Return whether times are too far from the stamp of their message to count from it."""
        limit = MAX_FROM_STAMP_NS // NANOSECONDS[unit]
        if values.dtype.str[1:] != 'u4' or not int(values.max(initial=0)) > limit:
            return False
        return bool((unwrapped(values, valid)[valid] > limit).all())

    def start(self, first: int, stamp: int, *, is_absolute: bool) -> int:
        """Return what to add to the times of the next message, nanoseconds.

        Parameters
        ----------
        first : its first time
        stamp : that of its header; as far as it went on, the times do, too
        is_absolute : the first message keeps its times; else they begin at its stamp

        """
        if self._is_new:
            self._start = 0 if is_absolute else stamp - first
        else:
            expected = self._first + stamp - self._stamp
            self._start += self._wrap * round((expected - first - self._start) / self._wrap)
        self._is_new, self._stamp, self._first = False, stamp, first + self._start
        return self._start


def to_nanoseconds(values: NDArray[Any], valid: Bools, unit: str) -> Ints:
    """Convert times to whole nanoseconds; what is not valid becomes 0.

    Whole and fractional part of a float are scaled separately: absolute stamps lose no digits.

    Raises
    ------
    CloudError
        If a valid point's time is not finite or beyond ±73 years.

    """
    factor, result = NANOSECONDS[unit], np.empty(len(values), np.int64)
    for begin in range(0, len(values), TIMES_AT_ONCE):
        part = slice(begin, begin + TIMES_AT_ONCE)
        known = np.where(valid[part], values[part], values.dtype.type(0))
        exact = known.astype(np.float64)
        fine = np.abs(exact) < LONGEST_NS / factor
        if not fine.all():
            must_be = f'finite and within 73 years, in {unit} (time_unit)'
            raise CloudError('the time of a point', must_be, known[~fine][0])
        whole = known if known.dtype.kind != 'f' else np.floor(exact)
        result[part] = whole.astype(np.int64) * factor
        if known.dtype.kind == 'f':
            result[part] += np.rint((exact - whole) * factor).astype(np.int64)
    return result
