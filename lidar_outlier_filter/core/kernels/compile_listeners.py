# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What is called before a kernel is compiled. It imports nothing: all may ask early."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

# Called in this order, in the thread that compiles, with the name of the kernel's module. One that
# raises keeps the kernel from being compiled, and those behind it from being called.
listeners: list[Callable[[str], object]] = []
