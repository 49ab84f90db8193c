# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The cleaned and outlier clouds in the output of a run."""

from collections.abc import Iterator
from typing import Any

from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.pipeline.topics import CLEANED, CLOUD, OUTLIERS
from lidar_outlier_filter.recordings.bags import Recording
from lidar_outlier_filter.recordings.channels import known_types


def filtered_topic(source: Recording, topic: str | None) -> str:
    """Find the topic that was filtered; None: the only one."""
    names = {channel.name for channel in source.topics if channel.msgtype == CLOUD}
    inputs = sorted(name.removesuffix(CLEANED) for name in names if name.endswith(CLEANED))
    filtered = [name for name in inputs if name + OUTLIERS in names]
    if topic is None and len(filtered) == 1:
        return filtered[0]
    if topic not in filtered:
        known = ', '.join(filtered) or 'none'
        must_be = f"one of those with '{CLEANED}' and '{OUTLIERS}' ({known})"
        raise RecordingError(f'the topic to score in {source.path}', must_be, repr(topic))
    return str(topic)


def split_clouds(
    source: Recording, topic: str, *, with_inputs: bool = False
) -> Iterator[tuple[bool | None, Any]]:
    """Yield messages, and whether their points were rejected; None: an input."""
    kinds: dict[str, bool | None] = {topic + CLEANED: False, topic + OUTLIERS: True}
    if with_inputs:
        kinds[topic] = None
    channels = [one for one in source.topics if one.name in kinds and one.msgtype == CLOUD]
    if len(channels) < len(kinds):
        must_be = f'with {topic}, which the labels are for'
        raise RecordingError(f'the recording {source.path}', must_be, f'no {topic}')
    for channel, _, data in source.messages(channels):
        yield kinds[channel.name], known_types().deserialize_cdr(data, CLOUD)
