# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A cloud that is judged as a whole, in memory or in files, and what its chain must not need."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from lidar_outlier_filter.core.annotations import Allocate
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.detectors.registry import DETECTORS, reads
from lidar_outlier_filter.core.engine.chain import Chain, along_lines
from lidar_outlier_filter.core.engine.slow import SaySlow
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.points.scan_lines import has_lines
from lidar_outlier_filter.core.scan_pattern.recovered_rings import (
    MAX_TURN_POINTS,
    find_rows,
    recover_rings,
)
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.errors import CloudError, ParameterError
from lidar_outlier_filter.parameters.filter import FilterParameters


def check_chain(chain: Sequence[str], what: str, lack: str) -> None:
    """Refuse a chain that needs scan lines if the cloud lacks them.

    Parameters
    ----------
    chain : names of detectors
    what, lack : the cloud, and what it lacks, as text for the error

    Raises
    ------
    ParameterError
        If a detector needs scan lines.

    """
    along = along_lines(chain)
    if along:
        raise ParameterError('chain', f'without {along}, as {what} has {lack}', ', '.join(chain))


def with_rings(cloud: Points, parameters: FilterParameters) -> Points:
    """Recover the rings of a cloud without scan lines; it stays as it is where it shows none.

    Parameters
    ----------
    cloud : in the sensor's own frame, or with it, missing returns among its points
    parameters : whose chain may want rings

    """
    if not reads(parameters, 'ring') or has_lines(cloud):
        return cloud
    where = np.flatnonzero(cloud.valid)
    if len(where) > MAX_TURN_POINTS:
        return cloud
    found = recover_rings(cloud.in_own_frame.xyz[where])
    if found is None:
        found = find_rows(cloud.take(where), np.arange(len(where)))
    if found is None:
        return cloud
    ring = np.full(len(cloud), -1)
    ring[where] = found
    return replace(cloud, ring=ring)


def judge_whole(
    cloud: Points,
    parameters: FilterParameters,
    chain: Chain | None = None,
    slow: SaySlow | None = None,
    *,
    tile: float = 0.0,
    allocate: Allocate = np.empty,
) -> Verdict:
    """Judge the valid points of a cloud; the others stay untested.

    Parameters
    ----------
    cloud : N points, whose coordinates may be a file
    parameters : of the filter
    chain : that of the parameters, unless another one is given
    slow : called while a detector takes too long
    tile : side of the tiles, metres, for clouds larger than memory and detectors that judge in
        tiles; all others judge in one piece, with the same verdict
    allocate : returns an array of a shape and a type, which may be a file

    Raises
    ------
    ParameterError
        If tiles are used with a detector that cannot use files.
    CloudError
        If the cloud, or a tile with halo, exceeds ``max_points``.

    """
    count = np.count_nonzero(cloud.valid)
    if tile == 0 and count > parameters.max_points:
        must_be = f'at most max_points = {parameters.max_points}'
        raise CloudError('the number of points judged in one piece', must_be, count)
    for name in parameters.chain if tile > 0 else ():
        if DETECTORS[name].large == 'no':
            raise ParameterError('chain', f'without {name} where there are tiles', name)
    chain = chain or Chain(parameters)
    chain.slow, chain.whole, chain.tile = slow, True, tile
    if tile > 0:
        chain.see = partial(DetectorInput, allocate=allocate)
    if 0 < count == len(cloud):
        return chain.judge(cloud)  # without a copy of its columns
    verdict = Verdict.beforehand(cloud)
    if count:
        where = np.flatnonzero(cloud.valid)
        verdict.put(where, chain.judge(cloud.take(where, allocate)))
    return verdict
