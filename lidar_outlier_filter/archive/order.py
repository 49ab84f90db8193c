# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What is to be done with each recording of an archive."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.recordings.unpack import LARGEST

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True)
class Order:
    """What is to be done with each recording, as :func:`replay` takes it."""

    topics: tuple[str, ...] = ()
    parameters: Mapping[str, object] = field(default_factory=dict)
    drop_input: bool = False
    salvage: bool = False
    resume: bool = False
    largest: int = LARGEST

    @property
    def options(self) -> dict[str, Any]:
        """What the bytes of an output depend on, beside the parameters."""
        names = ('topics', 'drop_input', 'salvage', 'largest')
        return {name: getattr(self, name) for name in names}

    @property
    def filter(self) -> FilterParameters:
        """All parameters."""
        return FilterParameters().changed(self.parameters)
