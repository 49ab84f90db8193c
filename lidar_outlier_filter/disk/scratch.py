# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Arrays in files beside an output, for a cloud that is judged in tiles."""

from __future__ import annotations

import math
import os
from contextlib import contextmanager
from itertools import count
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.disk.hidden_folder import hidden_folder
from lidar_outlier_filter.errors import CloudError, ParameterError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Allocate


@contextmanager
def scratch(output: Path, tile: float) -> Iterator[Allocate]:
    """Give what makes arrays: in memory or, for tiles, in files beside the output."""
    if not 0 <= tile < np.inf:
        raise ParameterError('--tile', 'at least 0 and finite', tile)
    if tile == 0:
        yield np.empty
        return
    with hidden_folder(output, 'points') as folder:
        numbers = count()

        def allocate(shape: tuple[int, ...]) -> NDArray[np.float64]:
            path = folder / str(next(numbers))
            _reserve(path, 8 * math.prod(shape))
            return np.asarray(np.memmap(path, np.float64, 'r+', shape=shape))

        yield allocate


def _reserve(path: Path, size: int) -> None:
    """Make a file of so many bytes; a full disk says so here."""
    try:
        with path.open('wb') as stream:
            if size and hasattr(os, 'posix_fallocate'):
                os.posix_fallocate(stream.fileno(), 0, size)
            stream.truncate(max(1, size))
    except OSError as err:
        must_be = f'able to hold {size} bytes beside the output, for the tiles'
        raise CloudError('the disk', must_be, f'"{err.strerror}"') from err
