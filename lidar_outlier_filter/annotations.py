# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Types that all rooms share: arrays by what they hold, and who shows how far work is.

Imported for types only.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Ints = NDArray[np.int64]
Index = NDArray[np.int32]  # of rows, where many are kept
Bools = NDArray[np.bool_]
Rows = NDArray[np.void]  # of a structured array

Progress = Callable[[int, int, str], object]  # so many of so many are done, and of what; may leave
