# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The Python interface: ``detect_outliers`` for single clouds, ``CloudFilter`` for streams."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidar_outlier_filter.core.detectors.plausible import MIN_SHARE_POINTS
from lidar_outlier_filter.core.detectors.plugins import MAX_USUAL_SHARE
from lidar_outlier_filter.core.detectors.registry import read_field
from lidar_outlier_filter.core.engine.chain import Chain, uses_lines
from lidar_outlier_filter.core.engine.stream_lines import line_period
from lidar_outlier_filter.core.engine.whole_cloud import check_chain, judge_whole, with_rings
from lidar_outlier_filter.core.points import columns as usual
from lidar_outlier_filter.core.points.line_recovery import Claim, settle_lines
from lidar_outlier_filter.core.points.mask import mask_of, masked
from lidar_outlier_filter.core.points.points import Points, is_return
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.errors import CloudError, ParameterError
from lidar_outlier_filter.messages.array_cloud import as_message
from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_filter.messages.laser_scan import is_scan
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.pipeline import Pipeline, SplitCloud

FIELDS = ('time_field', 'line_field', 'angle_field', 'sigma_field')
NO_TIME, NO_LINES = 'no time of each point', 'no scan line of each point'


class CloudFilter(Pipeline):
    """Splits each cloud of a stream into a cleaned and an outlier cloud, in order.

    Parameters
    ----------
    parameters : mapping of flat names to values, or FilterParameters; optional
        Parameters that are not given have their defaults.
    inform, warn : callable, optional
        Called with sentences, each once, on how clouds are read and judged, or on missing fields.
    chain : str or sequence of str, optional
        The detectors, in the order in which they run; short for ``chain`` in ``parameters``.

    Attributes
    ----------
    parameters : FilterParameters
        The current parameters.
    statistics : Statistics
        Counts since the start.
    refuse : callable
        Called with the error of a cloud that is refused after it was accepted.
    fail : callable
        Called with a detector's error, only the first from each line of code.
    slow : callable
        Called from another thread while a detector takes more than 10 × ``max_delay`` for a block,
        for each such block; ``warn`` is called once for each detector.

    Raises
    ------
    ParameterError
        If a parameter or a detector is unknown, or a value is invalid.

    Examples
    --------
    >>> import numpy as np
    >>> from lidar_outlier_filter import CloudFilter
    >>> cloud = np.zeros(2000, [('x', 'f4'), ('y', 'f4'), ('z', 'f4'), ('t', 'u4')])
    >>> cloud['x'], cloud['y'] = np.divmod(np.arange(2000), 50)
    >>> cloud['t'] = np.arange(2000) * 50_000  # nanoseconds after the stamp
    >>> cloud['z'][1234] = 30
    >>> filter = CloudFilter({'lof.threshold': 2.0}, chain=['lof'])
    >>> outputs = filter.push(cloud, stamp=1_700_000_000_000_000_000) + filter.flush()
    >>> outputs[0].outliers['z'].tolist(), outputs[0].cleaned.size
    ([30.0], 1999)

    """

    def __init__(
        self,
        parameters: FilterParameters | Mapping[str, object] | None = None,
        inform: Callable[[str], object] = str,
        warn: Callable[[str], object] = str,
        *,
        chain: str | Sequence[str] | None = None,
    ) -> None:
        super().__init__(with_defaults(parameters, chain), inform, warn)

    def push(
        self, cloud: Any, tag: Any = None, *, stamp: int | np.integer[Any] | None = None
    ) -> list[SplitCloud]:
        """Add the next cloud; return the clouds that are finished, oldest first.

        Parameters
        ----------
        cloud : structured array of shape (N,) or (height, width), or a message
            With the fields x, y and z, metres: anything like a PointCloud2; or anything like a
            LaserScan or a MultiEchoLaserScan. The outputs have the same type.
            It must not be modified until its outputs are returned.
        tag : optional
            Any object; it is returned with the outputs.
        stamp : int, optional
            Reference of an array's relative times, nanoseconds; not needed for absolute times.

        Raises
        ------
        CloudError
            If the cloud is invalid. It is counted as refused; the stream continues.

        Examples
        --------
        >>> import numpy as np
        >>> from lidar_outlier_filter import CloudFilter
        >>> filter = CloudFilter(chain=['sor'])
        >>> cloud = np.zeros(3, [('x', 'f4'), ('y', 'f4'), ('z', 'f4'), ('t', 'f8')])
        >>> [output.tag for output in filter.push(cloud, 'the first', stamp=0) + filter.flush()]
        ['the first']

        """
        return self.process(cloud, tag, stamp=stamp)


def detect_outliers(  # noqa: PLR0913  arrays and options
    xyz: Any,
    *,
    t: ArrayLike | None = None,
    line: ArrayLike | None = None,
    intensity: ArrayLike | None = None,
    chain: str | Sequence[str] | None = None,
    parameters: FilterParameters | Mapping[str, object] | None = None,
    inform: Callable[[str], object] = str,
    warn: Callable[[str], object] = str,
) -> Verdict:
    """Find the outliers of a single cloud, judging all its points together.

    Parameters
    ----------
    xyz : (N, 3) array of numbers, structured array, or anything like a PointCloud2 or LaserScan
        Coordinates, metres. Missing returns (NaN, Inf, or all three 0) are kept; their score is
        NaN. Structured arrays and PointCloud2 have times, rings and intensities as fields.
    t : (N,) array, optional
        Time of each point, in the unit ``time_unit``; 'auto': floats are seconds, integers are
        nanoseconds, unless only another unit makes sense of the steps from point to point.
    line : (N,) array of whole numbers, optional
        Scan line of each point: a ring, or the number of a profile scanner's revolution.
    intensity : (N,) array, optional
        Intensity of each point, in any unit; NaN if unknown.
    chain : str or sequence of str, optional
        Detectors in their order; those along scan lines need ``t`` and ``line``, and
        ``boosted_trees``, the default, uses them if they are given.
    parameters : mapping of flat names to values, or FilterParameters; optional
        Such as ``{'lof.threshold': 1.5}``. ``block`` and ``halo`` concern profile scanners only,
        which the default judges as their streams.
    inform, warn : callable, optional
        Called with sentences on how it is read and judged, as those of :class:`CloudFilter`.

    Returns
    -------
    Verdict
        In the order of the points, row by row: ``outlier`` (N,) bool; ``score`` (N,) float32, more
        than 1 if a detector rejects the point, NaN if no detector tested it; ``detectors`` (N,)
        uint16, the sum of the bits of the rejecting detectors, which :func:`.registry.bits` names.

    Raises
    ------
    FilterError
        If an array or a parameter is invalid, or the chain needs scan lines that are not given.

    Examples
    --------
    >>> import numpy as np
    >>> from lidar_outlier_filter import detect_outliers
    >>> x, y = np.divmod(np.arange(900.0), 30)
    >>> xyz = np.column_stack([x, y, 0.01 * np.sin(x)])
    >>> xyz[77, 2] = 6  # a bird above a floor
    >>> verdict = detect_outliers(xyz, chain='lof', parameters={'lof.threshold': 2.0})
    >>> np.flatnonzero(verdict.outlier).tolist()
    [77]

    """
    settings = with_defaults(parameters, chain)
    columns = {'t': t, 'line': line, 'intensity': intensity}
    points, reason = _decode(xyz, columns, settings, inform, warn)
    if reason:
        check_chain(settings.chain, 'the cloud', reason)
        zeros = np.zeros(len(points), np.int64)
        points = with_rings(replace(points, t=zeros, line=zeros), settings)
    return _judged(points, settings, inform, warn)


def _judged(
    points: Points,
    parameters: FilterParameters,
    inform: Callable[[str], object],
    warn: Callable[[str], object],
) -> Verdict:
    """Judge points, and say how; and that more is rejected than is usual."""
    chain = Chain(parameters)
    verdict = judge_whole(points, parameters, chain)
    chain.say_methods(inform, warn)
    tested = int(np.count_nonzero(~np.isnan(verdict.score)))
    share = int(np.count_nonzero(verdict.rejected)) / max(tested, 1)
    if chain.methods and tested >= MIN_SHARE_POINTS and share > MAX_USUAL_SHARE:
        warn(f'{share:.1%} of the points are rejected: either many are outliers, or it is misread')
    return verdict


def _decode(
    cloud: Any,
    columns: Mapping[str, ArrayLike | None],
    parameters: FilterParameters,
    inform: Callable[[str], object],
    warn: Callable[[str], object],
) -> tuple[Points, str]:
    """Convert a cloud to points; also return why they have no scan lines ('' if they do)."""
    points, claim, reason = _claimed(cloud, columns, parameters, inform, warn)
    if claim is None or not uses_lines(parameters.chain):
        return points, reason
    points, decision = settle_lines(points, claim, line_period(parameters))
    if decision.kind != 'given':
        reason = ''
    if decision.text and not reason:
        (warn if decision.contradicts else inform)(decision.text)
    return points, reason


def _claimed(
    cloud: Any,
    columns: Mapping[str, ArrayLike | None],
    parameters: FilterParameters,
    inform: Callable[[str], object],
    warn: Callable[[str], object],
) -> tuple[Points, Claim | None, str]:
    """Convert a cloud to points; also return what claims to be their lines, and why none does."""
    is_array = isinstance(cloud, np.ndarray)
    if is_array:
        is_message = cloud.dtype.names is not None
    else:
        is_message = hasattr(cloud, 'fields') or is_scan(cloud)
    if not is_message:
        return _from_arrays(cloud, columns, parameters, warn)
    for name, values in columns.items():
        if values is not None:
            raise CloudError(name, 'a field of the cloud', 'a separate array')
    decoder = Decoder(parameters, inform, warn)
    # Within one cloud the reference of its times has no effect.
    points = decoder.decode(as_message(cloud, 0 if is_array else None))
    convention = decoder.convention
    if convention is None:
        return points, None, ''
    is_one_line = convention.line_source == 'message' and parameters.line_source == 'auto'
    if convention.time_field is None:
        return points, None, NO_TIME
    return points, convention.claim, NO_LINES if is_one_line else ''


def _from_arrays(
    xyz: Any,
    columns: Mapping[str, ArrayLike | None],
    parameters: FilterParameters,
    warn: Callable[[str], object],
) -> tuple[Points, Claim | None, str]:
    """Convert plain arrays to points; see :func:`_decode`."""
    for name in FIELDS:
        value = parameters.value(name)
        if value not in {'', 'auto'}:
            must_be = 'unset for an array without fields'
            raise ParameterError(name, must_be, repr(value))
    array = _numeric('xyz', xyz)
    if array.ndim != 2 or array.shape[1] != 3:  # noqa: PLR2004  x, y, z
        raise CloudError('the shape of xyz', '(N, 3)', array.shape)
    xyz, count = np.ascontiguousarray(array, np.float64), len(array)
    given = {
        name: None if values is None else _column(name, values, count)
        for name, values in columns.items()
    }
    t, line, intensity = given.values()
    field = given.get(field_name := read_field(parameters))
    if field_name and field is None:
        warn(f'among the arrays there is {usual.missing(field_name)}')
    mask = mask_of(parameters)
    if mask is not None and line is None:
        raise CloudError('line', 'the ring of each point if mask is set', 'none')
    valid, zeros = is_return(xyz), np.zeros(count, np.int64)
    unit = parameters.time_unit
    if t is not None and unit == 'auto':
        unit, note, _ = usual.find_unit(t[valid], t.dtype, 't')
        if note:
            warn(f'among the arrays there is {note}')
    points = Points(
        xyz,
        zeros if t is None else usual.to_nanoseconds(t, valid, unit),
        zeros if line is None else usual.whole_numbers(line, valid, 'line'),
        valid,
        intensity=None if intensity is None else intensity.astype(np.float32),
        field=None if field is None else field.astype(np.float64),
    )
    reason = NO_TIME if t is None else NO_LINES if line is None else ''
    claim = Claim('message', 'the cloud') if line is None else Claim('field', "'line'")
    return masked(points, mask, parameters), None if t is None else claim, reason


def _column(name: str, values: ArrayLike, count: int) -> NDArray[Any]:
    array = _numeric(name, values)
    if array.shape != (count,):
        must_be = f'({count},), as xyz has {count} points'
        raise CloudError(f'the shape of {name}', must_be, array.shape)
    return array


def _numeric(name: str, values: Any) -> NDArray[Any]:
    must_be = 'an array of numbers'
    if isinstance(values, np.ma.MaskedArray):
        raise CloudError(name, f'{must_be} without a mask', 'a masked array')
    try:
        array = np.asarray(values)
    except ValueError as err:
        raise CloudError(name, must_be, 'rows of different lengths') from err
    if array.dtype.kind not in 'iuf' and array.size:
        raise CloudError(name, must_be, f'{array.dtype}')
    return array


def with_defaults(parameters: object, chain: str | Sequence[str] | None = None) -> FilterParameters:
    """Return the parameters, with defaults for those that are not given.

    Parameters
    ----------
    parameters : mapping of flat names to values, or FilterParameters; optional
        Values may be NumPy scalars.
    chain : str or sequence of str, optional
        The detectors, in the order in which they run.

    Raises
    ------
    ParameterError
        If a name is unknown, a value is invalid, or the chain is given in both.

    """
    chain = [chain] if isinstance(chain, str) else chain
    if isinstance(parameters, FilterParameters):
        return parameters if chain is None else parameters.changed({'chain': chain})
    if not isinstance(parameters, Mapping | None):
        must_be = "a mapping as in {'max_points': 1000}"
        raise ParameterError('the parameters', must_be, repr(parameters))
    values = dict(parameters or {})
    if chain is not None:
        if 'chain' in values:
            raise ParameterError('chain', 'given once', 'chain= and parameters')
        values['chain'] = chain
    plain = {
        name: value.item() if isinstance(value, np.generic) else value
        for name, value in values.items()
    }
    return FilterParameters().changed(plain)
