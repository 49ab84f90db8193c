# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Weather in a real recording: a recording in, a recording out, message by message."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore

from lidar_outlier_filter.errors import FilterError, RecordingError
from lidar_outlier_filter.messages.truth import Cause
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.topics import CLOUD
from lidar_outlier_filter.recordings.bags import NewBag, Recording
from lidar_outlier_filter.recordings.replay import choose_clouds
from lidar_outlier_lab.simulation.weather.clouds import CloudWeather

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping
    from pathlib import Path

    from rosbags.typesys.store import Typestore

    from lidar_outlier_filter.recordings.bags import Topic


@dataclass(frozen=True)
class WeatherReport:
    """What a recording with weather holds.

    ``causes`` counts the points of its clouds; 0 is good. Of ``hidden`` surfaces nothing is seen
    any more. ``untouched`` of the ``messages`` have too few points to show how their sensor turns.
    ``unread`` messages are counted in the recording, but were not found in it.
    """

    output: Path
    messages: int
    causes: Mapping[Cause, int]
    hidden: int
    untouched: int
    unread: int

    @property
    def points(self) -> int:
        """Number of points."""
        return sum(self.causes.values())

    @property
    def outliers(self) -> int:
        """Number of points that are not good."""
        return self.points - self.causes[Cause.GOOD]


def put_onto(  # noqa: PLR0913  what the command line offers
    recording: Path,
    output: Path,
    weather: str,
    topics: Collection[str] = (),
    seed: int = 1,
    returns: str = 'strongest',
    parameters: Mapping[str, object] | None = None,
    *,
    progress: Callable[[int, int], object] = lambda _done, _total: None,
    inform: Callable[[str], object] = str,
) -> WeatherReport:
    """Write a copy of a recording with weather in its clouds, every point labelled by its cause.

    The weather stays the same from the first cloud to the last; its particles do not.

    Parameters
    ----------
    recording : ROS 2 bag folder, ``.mcap``, ``.db3``, or ROS 1 ``.bag``
    output : folder to be made, an MCAP bag
    weather : one of ``WEATHER_NAMES``
    topics : PointCloud2 topics of sensors that spin; none given: all of them
    seed : of all chances, from 0; the same gives the same bytes
    returns : which echo is measured, one of ``RETURN_NAMES``
    parameters : how clouds are read, by flat name, as for a replay
    progress : is called after each message: how many of how many have been read
    inform : is called with a sentence on how the clouds of a topic are read

    Raises
    ------
    FilterError
        If the recording cannot be read, or has clouds that no weather can be put into, or the
        output cannot be written.

    """
    given = FilterParameters().changed(parameters or {})
    store = get_typestore(Stores.ROS2_JAZZY)
    with Recording(recording) as source, NewBag(output, source.custom_data) as bag:
        chosen = choose_clouds(source, topics, 'a topic for weather')
        put = {
            topic: CloudWeather(weather, seed, returns, given, number, _named(topic.name, inform))
            for number, topic in enumerate(chosen)
        }
        for topic in source.topics:
            bag.add(topic)
        done = 0
        for topic, time, data in source.messages():
            changed = _changed(store, topic, data, put[topic]) if topic in put else data
            bag.write(topic, time, changed)
            done += 1
            progress(done, source.message_count)
        counts = [one.counts for one in put.values()]
        causes = {cause: sum(int(count.causes[cause]) for count in counts) for cause in Cause}
        return WeatherReport(
            output,
            sum(count.messages for count in counts),
            causes,
            sum(count.hidden for count in counts),
            sum(count.untouched for count in counts),
            max(0, source.message_count - done),
        )


def _named(name: str, inform: Callable[[str], object]) -> Callable[[str], object]:
    return lambda text: inform(f'{name}: {text}')


def _changed(store: Typestore, topic: Topic, data: bytes, weather: CloudWeather) -> bytes:
    try:
        cloud = weather.put(store.deserialize_cdr(data, CLOUD))
    except (FilterError, SerdeError) as err:
        must_be = 'one that weather can be put into'
        raise RecordingError(f'the topic {topic.name}', must_be, f'"{err}"') from err
    return bytes(store.serialize_cdr(cloud, CLOUD))
