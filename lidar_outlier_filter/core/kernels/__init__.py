# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Compiled loops: how they are made, kept, and run in threads.

It imports nothing heavy, so that commands can add a listener before NumPy and numba are there.
"""

import os
from collections.abc import Callable

# Called in this order, in the thread that compiles, with the name of the kernel's module. One that
# raises keeps the kernel from being compiled, and those behind it from being called.
listeners: list[Callable[[str], object]] = []

# What kernels in a wheel are compiled for: processors of about ten years run that.
PORTABLE = 'x86-64-v3' if os.uname().machine == 'x86_64' else 'generic'
