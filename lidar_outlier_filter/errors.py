# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the package refuses, in one sentence form: what, must be, got."""


class FilterError(Exception):
    """Something was refused: ``<what> must be <must_be>, got <got>``."""

    def __init__(self, what: str, must_be: str, got: object) -> None:
        """Keep ``what`` apart, so that refusals can be counted by it."""
        super().__init__(f'{what} must be {must_be}, got {got}')
        self.what = what


class ParameterError(FilterError):
    """A parameter, or a set of them, that makes no sense."""


class CloudError(FilterError):
    """A cloud that cannot be read, or that cannot be true."""


class PoseError(FilterError):
    """A pose that cannot be true."""


class RecordingError(FilterError):
    """A recording that cannot be read or written."""
