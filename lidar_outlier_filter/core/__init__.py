# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The filter itself: points, neighbours, kernels, detectors, and the chain that judges blocks.

It needs numpy, scipy and its compiled module. Importing ROS here is a lint error.
"""

from importlib import import_module

from lidar_outlier_filter.errors import FilterError


def __getattr__(name: str) -> object:
    """Import the compiled module; in a clone it may not have been built."""
    if name != '_kernels':
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    try:
        return import_module(f'{__name__}.{name}')
    except ModuleNotFoundError:
        must_be = (
            f'compiled in {__path__[0]} (by scripts/environment or python setup.py build_ext '
            '--inplace), or Python started elsewhere, to import what pip installed'
        )
        raise FilterError(f'the module {name}', must_be, 'its sources alone') from None
