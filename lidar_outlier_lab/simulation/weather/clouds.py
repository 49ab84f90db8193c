# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Weather in the clouds of one topic: message in, message out, each point labelled by its cause.

Points that the weather leaves alone keep every byte; where it takes light, their intensity falls.
What hides a surface takes the place of its point. Where nothing came back, it takes the place of
the missing return, or gets a point of its own behind the last one of its ring; its other fields are
then those of that point.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from lidar_outlier_filter.core.annotations import Bools, Ints
from lidar_outlier_filter.core.points.columns import NANOSECONDS, to_nanoseconds
from lidar_outlier_filter.core.points.points import LONGEST_NS, Points
from lidar_outlier_filter.errors import CloudError, FilterError, RecordingError
from lidar_outlier_filter.messages.cloud import is_empty
from lidar_outlier_filter.messages.convention import Convention
from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.topics import CLOUD
from lidar_outlier_filter.recordings.bags import NewBag, Recording, Topic, made_by
from lidar_outlier_filter.recordings.replay import choose_clouds
from lidar_outlier_lab.simulation.presets import RETURN_NAMES
from lidar_outlier_lab.simulation.weather import echoes, kinds
from lidar_outlier_lab.simulation.weather.beams import MIN_RING_POINTS, Beams, Optics, find_beams
from lidar_outlier_lab.simulation.weather.echoes import WeatherEchoes
from lidar_outlier_lab.simulation.weather.labelled_cloud import FoundPoints, LabelledCloud

OPTICS = Optics(aperture=0.0)  # cones from a point, as Kilic et al. (2021) have them
SEEN = 99.0  # percent of the points that are above the noise, however dark they are
MIN_TURN_POINTS = 2 * MIN_RING_POINTS  # returns of a ring that show how its sensor turns


@dataclass
class WeatherCounts:
    """What became of the clouds of all topics.

    ``labels`` (256,) counts the points that came out by their label; of ``hidden`` surfaces nothing
    is seen any more. ``untouched`` clouds have too few points to show how their sensor turns.
    ``unread`` messages are counted in the recording, but were not found in it.
    """

    messages: int = 0
    hidden: int = 0
    untouched: int = 0
    unread: int = 0
    labels: Ints = field(default_factory=lambda: np.zeros(256, np.int64))


class CloudWeather:
    """One weather for the clouds of one topic, and what is known of its sensor."""

    def __init__(  # noqa: PLR0913  what the command line offers
        self,
        weather: str,
        seed: int,
        returns: str,
        parameters: FilterParameters,
        number: int = 0,
        inform: Callable[[str], object] = str,
        counts: WeatherCounts | None = None,
    ) -> None:
        """Take the weather, its seed, which returns are measured, and how clouds are read.

        ``number`` is that of the topic: on each, other particles fall. ``counts`` are those of all.

        Raises
        ------
        FilterError
            If there is no such weather or return, or the seed is negative.

        """
        kinds.check(weather, seed)
        if returns not in RETURN_NAMES:
            raise FilterError('the return', f'one of {", ".join(RETURN_NAMES)}', returns)
        self._weather, self._seed, self._returns, self._number = weather, seed, returns, number
        self._decoder = Decoder(parameters, inform, inform)
        self._first: tuple[Optics, kinds.WeatherSite] | None = None
        self._clouds, self.counts = 0, counts or WeatherCounts()

    def put(self, msg: Any) -> Any:
        """Return a cloud with the weather in it, and the field ``label`` behind the others.

        Raises
        ------
        FilterError
            If the cloud cannot be read, has labels already, or is not one of a sensor that spins.

        """
        cloud = LabelledCloud(msg)
        points = self._decoder.decode(msg)
        convention = self._decoder.convention
        if convention is None or is_empty(msg) or not points.valid.any():
            self.counts.untouched += 1
        else:
            self._put(msg, cloud, points, convention)
        self._clouds += 1
        self.counts.messages += 1
        self.counts.labels += np.bincount(cloud.labels, minlength=256)
        return cloud.message()

    def _check(self, msg: Any, convention: Convention) -> None:
        """Refuse clouds that do not say which ring measured a point, or when."""
        names = ', '.join(item.name for item in msg.fields)
        if convention.line_source not in {'field', 'row'}:
            raise CloudError('a cloud for weather', 'one with a field of rings', f'fields {names}')
        if msg.height == 1 and convention.time_field is None:
            raise CloudError('a cloud for weather', 'one with a field of times', f'fields {names}')
        if msg.height > 1 and self._returns == 'dual':
            must_be = 'that of clouds that are not organised, which have room for both'
            raise CloudError('the return dual', must_be, f'{msg.height} × {msg.width} points')

    def _put(self, msg: Any, cloud: LabelledCloud, points: Points, convention: Convention) -> None:
        self._check(msg, convention)
        _, count = np.unique(points.line[points.valid], return_counts=True)
        if count.max() < MIN_TURN_POINTS:  # of the ring that has most
            self.counts.untouched += 1
            return
        reflectance = cloud.learn(points)
        seen = np.flatnonzero(points.valid)
        far = points.range[seen]
        if self._first is None:
            # A surface of reflectance 0.9 would have been seen as far as this.
            reach = np.percentile(far * np.sqrt(0.9 / reflectance[seen]), SEEN)
            optics = replace(OPTICS, farthest=max(float(reach), OPTICS.farthest))
        else:
            optics = self._first[0]
        # What came back was above the noise.
        reflectance[seen] = np.maximum(reflectance[seen], optics.floor * far**2)
        t, empty = _empty_rows(cloud, points, convention)
        beams = find_beams(
            points.xyz, t, points.line, reflectance, points.valid, empty, adds=msg.height == 1
        )
        self._first = self._first or (optics, kinds.survey(beams))
        sweep, returns = (self._number, self._clouds), self._returns
        both = kinds.make_both(
            self._weather, beams, self._seed, optics, returns, sweep, self._first[1]
        )
        shots = _WeatherShots(cloud, beams, convention)
        main, *other = echoes.measured(both, returns)
        self.counts.hidden += shots.measure(main)
        for echo in other:
            shots.measure_second(echo)


def _empty_rows(cloud: LabelledCloud, points: Points, convention: Convention) -> tuple[Ints, Bools]:
    """Return the times of all rows (N,), and which (N,) are missing returns whose time is known."""
    no_return, name = ~points.valid, convention.time_field
    if name is None or not no_return.any():
        return points.t, no_return
    raw = cloud.column(name)
    fine = np.abs(raw.astype(np.float64)) < LONGEST_NS / NANOSECONDS[convention.time_unit]
    every = to_nanoseconds(raw, fine, convention.time_unit)
    known = points.t[points.valid]
    every += known[0] - every[points.valid][0]
    within = no_return & fine & (every >= known.min()) & (every <= known.max())
    return np.where(points.valid, points.t, every), within


class _WeatherShots:
    """The beams of a cloud, and the rows that are theirs."""

    def __init__(self, cloud: LabelledCloud, beams: Beams, convention: Convention) -> None:
        self._cloud, self._beams, self._convention = cloud, beams, convention
        # A beam without a row is like the last of its ring that has one; before that, the next.
        index = np.arange(len(beams))
        own = beams.source >= 0
        last = np.maximum.accumulate(np.where(own, index, -1))
        following = np.minimum.accumulate(np.where(own, index, len(beams))[::-1])[::-1]
        same = (last >= 0) & (beams.ring[last] == beams.ring)
        self._like = beams.source[np.where(same, last, np.minimum(following, len(beams) - 1))]

    def measure(self, echo: WeatherEchoes) -> int:
        """Let all beams measure; return the number of points that are seen no more."""
        cloud, beams = self._cloud, self._beams
        own, there = beams.source >= 0, np.isfinite(echo.distance)
        had = np.isfinite(beams.range)
        kept = had & there & (echo.cause == 0)
        clear = np.where(had, beams.reflectance, 1.0) / np.where(had, beams.range, 1.0) ** 2
        cloud.dim(beams.source[kept], echo.power[kept] / clear[kept])
        moved = own & there & (echo.cause != 0)
        cloud.move(beams.source[moved], self._found(echo, moved))
        if (~own & there).any():
            self._add(echo, ~own & there)
        # Behind all additions, which are like what goes.
        hidden = had & ~there
        cloud.hide(beams.source[hidden])
        return int((had & (~there | (echo.cause != 0))).sum())

    def measure_second(self, echo: WeatherEchoes) -> None:
        """Add the second return of those beams that have one."""
        self._add(echo, np.isfinite(echo.distance))

    def _add(self, echo: WeatherEchoes, which: Bools) -> None:
        rows = self._cloud.add(self._like[which], self._found(echo, which))
        self._cloud.set_time(rows, self._beams.t[which], self._convention)

    def _found(self, echo: WeatherEchoes, which: Bools) -> FoundPoints:
        distance = echo.distance[which]
        reflectance = echo.power[which] * distance**2
        return FoundPoints(self._beams.direction[which], distance, reflectance, echo.cause[which])


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
) -> WeatherCounts:
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
    given, counts = FilterParameters().changed(parameters or {}), WeatherCounts()
    store = get_typestore(Stores.ROS2_JAZZY)
    made = made_by('simulate', given, weather=weather, seed=seed, returns=returns)
    with (
        Recording(recording) as source,
        NewBag(output, {**source.custom_data, **made}) as bag,
    ):
        chosen = choose_clouds(source, topics, 'a topic for weather')
        put = {
            topic: CloudWeather(
                weather, seed, returns, given, number, _named(topic.name, inform), counts
            )
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
        counts.unread = max(0, source.message_count - done)
    return counts


def _named(name: str, inform: Callable[[str], object]) -> Callable[[str], object]:
    return lambda text: inform(f'{name}: {text}')


def _changed(store: Typestore, topic: Topic, data: bytes, weather: CloudWeather) -> bytes:
    try:
        cloud = weather.put(store.deserialize_cdr(data, CLOUD))
    except (FilterError, SerdeError) as err:
        must_be = 'one that weather can be put into'
        raise RecordingError(f'the topic {topic.name}', must_be, f'"{err}"') from err
    return bytes(store.serialize_cdr(cloud, CLOUD))
