# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Find outliers in lidar point clouds, live and offline, with the same verdicts.

    from lidar_outlier_filter import CloudFilter, detect_outliers

These names are imported on first use, so that importing the package takes no time.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from lidar_outlier_filter.core.detectors.plugins import find_detectors
from lidar_outlier_filter.parameters.filter import register

if TYPE_CHECKING:
    from lidar_outlier_filter.core.verdict import Verdict
    from lidar_outlier_filter.errors import CloudError, FilterError, ParameterError
    from lidar_outlier_filter.pipeline.library import CloudFilter, detect_outliers

__all__ = [
    'CloudError',
    'CloudFilter',
    'FilterError',
    'ParameterError',
    'Verdict',
    '__version__',
    'detect_outliers',
]
__version__ = '1.0.0'
register(find_detectors)

_MODULES = {
    'CloudError': 'errors',
    'CloudFilter': 'pipeline.library',
    'FilterError': 'errors',
    'ParameterError': 'errors',
    'Verdict': 'core.verdict',
    'detect_outliers': 'pipeline.library',
}

# A type checker reads the imports above, and so finds names that are not there.
if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        """Import one of the names."""
        if name not in _MODULES:
            raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
        value = getattr(import_module(f'{__name__}.{_MODULES[name]}'), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    """List what is here, and what is imported when it is used."""
    return sorted({*globals(), *__all__})
