# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How the two answers to the clouds of a topic are named."""

from __future__ import annotations

# Behind the name of the topic; in the middle of a name they are nothing special.
CLEANED, OUTLIERS = '/cleaned', '/outliers'


def answers(topic: str) -> tuple[str, str]:
    """Name the topics of the cleaned and of the outlier clouds of ``topic``."""
    return topic + CLEANED, topic + OUTLIERS
