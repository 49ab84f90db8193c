# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The namespaces that a launch starts a node in. Knows no ROS."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lidar_outlier_filter.errors import ParameterError

if TYPE_CHECKING:
    from collections.abc import Iterable


def split_namespaces(text: str, topics: Iterable[str]) -> list[str]:
    """Return the namespaces that a text lists with commas between; one may be empty.

    Raises
    ------
    ParameterError
        If there are several, and two are one, or a topic would be the same in all.

    """
    names = [name.strip() for name in text.split(',')]
    if len(names) > 1:
        full = {name.strip('/') for name in names}
        if '' in full or len(full) < len(names):
            raise ParameterError('namespace', 'different names with commas between', repr(text))
        for topic in topics:
            if topic.startswith('/'):
                must_be = 'without a leading slash, because namespace names several'
                raise ParameterError('input_topic', must_be, repr(topic))
    return names
