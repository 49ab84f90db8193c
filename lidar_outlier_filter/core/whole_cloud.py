# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A cloud that is judged as a whole, in one piece, and the chain for one without scan lines."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.chain import Chain, along_lines
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.errors import CloudError, ParameterError

if TYPE_CHECKING:
    from lidar_outlier_filter.core.points import Points
    from lidar_outlier_filter.core.slow import SaySlow
    from lidar_outlier_filter.parameters.filter import FilterParameters

WITHOUT_LINES = ('sor',)  # the chain where nobody asks for one, and there are no scan lines


def chain_without_lines(
    parameters: FilterParameters, *, chosen: bool, what: str, lack: str
) -> FilterParameters:
    """Return the parameters for a cloud that has no scan lines.

    Parameters
    ----------
    parameters : as they are for a cloud that has
    chosen : whether somebody chose the chain; otherwise it is replaced where it needs lines
    what, lack : the cloud, and what it lacks, for people

    Raises
    ------
    ParameterError
        If the chain that was chosen needs scan lines.

    """
    along = along_lines(parameters.chain)
    if not along:
        return parameters
    if chosen:
        must_be = f'without {along}, as {what} has {lack}'
        raise ParameterError('chain', must_be, ', '.join(parameters.chain))
    return parameters.changed({'chain': WITHOUT_LINES})


def judge_whole(
    cloud: Points,
    parameters: FilterParameters,
    chain: Chain | None = None,
    slow: SaySlow | None = None,
) -> Verdict:
    """Judge the valid points of a cloud in one piece; the others stay untested.

    The ``chain`` is that of the parameters, unless another one is given. ``slow`` is called while a
    detector takes too long.

    Raises
    ------
    CloudError
        If they are more than ``max_points``.

    """
    where = np.flatnonzero(cloud.valid)
    if len(where) > parameters.max_points:
        must_be = f'at most max_points = {parameters.max_points}'
        raise CloudError('the number of points judged in one piece', must_be, len(where))
    verdict = Verdict.untested(len(cloud))
    if len(where):
        chain = chain or Chain(parameters)
        chain.slow = slow
        verdict.put(where, chain.judge(cloud.take(where)))
    return verdict
