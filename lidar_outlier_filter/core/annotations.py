# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Types that all rooms share: arrays by what they hold, and who shows how far work is."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Single = np.float32
Singles = NDArray[np.float32]
Ints = NDArray[np.int64]
Index = NDArray[np.int32]  # of rows, where many are kept
Bools = NDArray[np.bool_]
Bytes = NDArray[np.uint8]
Words = NDArray[np.uint32]
Reals = NDArray[np.floating]  # of either precision
Rows = NDArray[np.void]  # of a structured array
Columns = Mapping[str, NDArray[Any]]  # of a file; masked where a whole number is missing
Triple = tuple[float, float, float]

Allocate = Callable[..., Any]  # an array of a shape and a type, in memory or in a file
Progress = Callable[[int, int, str], object]  # so many of so many are done, and of what; may leave
