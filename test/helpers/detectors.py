# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The bits of the detectors, and detectors that are installed for a while."""

from collections.abc import Iterator
from contextlib import contextmanager

from lidar_outlier_filter.core.detectors.declaration import Detector
from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.parameters import filter as filter_parameters

BITS = {name: one.bit for name, one in DETECTORS.items()}


@contextmanager
def added(detector: Detector) -> Iterator[None]:
    """Let this process know a detector, as if another distribution had brought it."""
    known = filter_parameters.installed().detectors
    known[detector.name] = detector
    _forget()
    try:
        yield
    finally:
        del known[detector.name]
        _forget()


def _forget() -> None:
    filter_parameters.describe.cache_clear()
    filter_parameters._sections.cache_clear()
