# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A stream of clouds, for users of the library."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.pipeline.given_parameters import gather
from lidar_outlier_filter.pipeline.session import Session

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import numpy as np

    from lidar_outlier_filter.core.engine.slow import SlowDetector
    from lidar_outlier_filter.errors import CloudError, JudgingError
    from lidar_outlier_filter.parameters.filter import FilterParameters
    from lidar_outlier_filter.pipeline.session import Answer
    from lidar_outlier_filter.pipeline.statistics import Statistics


class CloudFilter:
    """Clouds in, answers out: one for each cloud, in order, however long it takes.

    Parameters
    ----------
    parameters : mapping of flat names to values, or FilterParameters; optional
        What is not named has its default.
    inform, warn : callable, optional
        Are called once with a sentence that says how the clouds are read and judged, and what they
        lack.
    chain : sequence of str, optional
        The detectors, in their order; short for ``chain`` in ``parameters``.

    Attributes
    ----------
    refuse : callable
        Is called with the error of a cloud that is refused after it was taken, when its block was
        judged.
    fail : callable
        Is called with an error that a detector raised, once for each line of code.
    slow : callable
        Is called from another thread while a detector takes more than 10 × ``max_delay`` for a
        block, for each such block; ``warn`` is called once for each detector.

    Raises
    ------
    ParameterError
        If a parameter or a detector is unknown, or a value makes no sense.

    Examples
    --------
    >>> import numpy as np
    >>> from lidar_outlier_filter import CloudFilter
    >>> cloud = np.zeros(2000, [('x', 'f4'), ('y', 'f4'), ('z', 'f4'), ('t', 'u4')])
    >>> cloud['x'], cloud['y'] = np.divmod(np.arange(2000), 50)
    >>> cloud['t'] = np.arange(2000) * 50_000  # nanoseconds after the stamp
    >>> cloud['z'][1234] = 30
    >>> filter = CloudFilter({'lof.threshold': 2.0}, chain=['lof'])
    >>> answers = filter.push(cloud, stamp=1_700_000_000_000_000_000) + filter.flush()
    >>> answers[0].outliers['z'].tolist(), answers[0].cleaned.size
    ([30.0], 1999)

    """

    def __init__(
        self,
        parameters: FilterParameters | Mapping[str, object] | None = None,
        inform: Callable[[str], object] = str,
        warn: Callable[[str], object] = str,
        *,
        chain: Sequence[str] | None = None,
    ) -> None:
        """Compile the kernels."""
        self.refuse: Callable[[CloudError], object] = str
        self.fail: Callable[[JudgingError], object] = str
        self.slow: Callable[[SlowDetector], object] = str
        self._session = Session(gather(parameters, chain), inform, warn)
        self._session.refuse = lambda err: self.refuse(err)  # noqa: PLW0108  set later
        self._session.fail = lambda err: self.fail(err)  # noqa: PLW0108  set later
        self._session.slow = lambda detector: self.slow(detector)  # noqa: PLW0108  set later

    @property
    def parameters(self) -> FilterParameters:
        """The parameters in force."""
        return self._session.parameters

    @property
    def statistics(self) -> Statistics:
        """Counts since the start."""
        return self._session.statistics

    def push(
        self, cloud: Any, tag: Any = None, *, stamp: int | np.integer[Any] | None = None
    ) -> list[Answer]:
        """Take the next cloud; return the answers that are finished by it, the oldest first.

        Parameters
        ----------
        cloud : structured array of shape (N,) or (height, width), or anything like a PointCloud2
            With the fields x, y and z, metres. Its answers are of the same kind. It must not change
            until it is answered.
        tag : optional
            Comes back with the answer.
        stamp : int, optional
            Time that the times of an array count from, nanoseconds. Absolute times need none.

        Raises
        ------
        CloudError
            If the cloud makes no sense. It is counted, and the next one is served.

        Examples
        --------
        >>> import numpy as np
        >>> from lidar_outlier_filter import CloudFilter
        >>> filter = CloudFilter(chain=['sor'])
        >>> cloud = np.zeros(3, [('x', 'f4'), ('y', 'f4'), ('z', 'f4'), ('t', 'f8')])
        >>> [answer.tag for answer in filter.push(cloud, 'the first', stamp=0) + filter.flush()]
        ['the first']

        """
        return self._session.push(cloud, tag, stamp=stamp)

    def flush(self) -> list[Answer]:
        """Answer all that is pending, and begin anew: the end of a recording.

        Examples
        --------
        >>> from lidar_outlier_filter import CloudFilter
        >>> filter = CloudFilter(chain=['sor'])
        >>> filter.flush(), filter.statistics.messages, filter.parameters.chain
        ([], 0, ('sor',))

        """
        return self._session.flush()
