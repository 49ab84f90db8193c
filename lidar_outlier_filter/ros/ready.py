# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The line that a node logs when it has started. Knows no ROS."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lidar_outlier_filter import __version__
from lidar_outlier_filter.core.kernels.threads import cores

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lidar_outlier_filter.parameters.filter import FilterParameters


def ready_line(parameters: FilterParameters, topics: Iterable[str]) -> str:
    """Say in one line what has started: version, inputs, chain, blocks, threads."""
    length = f' ({parameters.block:g} s)' if parameters.blocks != 'message' else ''
    return (
        f'version {__version__} is ready: inputs {", ".join(topics)}; '
        f'chain {", ".join(parameters.chain)}; blocks {parameters.blocks}{length}; '
        f'threads {parameters.threads or cores()}'
    )
