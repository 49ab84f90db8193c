# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Filter a recording as the node would, without the node: nothing is dropped."""

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter

from lidar_outlier_filter.disk.new_files import FOLDER, check_new
from lidar_outlier_filter.errors import NoCloudsError, ParameterError, RecordingError
from lidar_outlier_filter.parameters.declaration import OFF
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.topics import CLOUD, SCAN, check_name
from lidar_outlier_filter.recordings.bags import (
    MAX_MESSAGE_BYTES,
    NewBag,
    Recording,
    Topic,
    made_by,
)
from lidar_outlier_filter.recordings.cloud_topic import (
    CloudTopic,
    TopicReport,
    check_motion,
    cloud_topics,
)
from lidar_outlier_filter.recordings.remote_path import RecordingPath
from lidar_outlier_filter.recordings.salvage import Losses, salvaged

OWN_CHUNK_BYTES = 2**21  # bytes: a chunk that we write, beside a message that is longer


@dataclass(frozen=True)
class ReplayReport:
    """Counts of a replayed recording.

    ``recorded`` and ``elapsed`` are seconds: the length of the recording, and the time that the
    replay took. ``unread`` messages are counted in the recording, but were not found in it.
    ``lost`` counts the losses of a salvaged recording.
    """

    output: RecordingPath
    topics: tuple[TopicReport, ...]
    recorded: float
    elapsed: float
    unread: int
    lost: Losses = field(default_factory=Losses)

    @property
    def is_complete(self) -> bool:
        """Whether every message is in the output, and every cloud was filtered."""
        whole = self.unread == 0 and not self.lost.reasons
        return whole and not any(topic.refused for topic in self.topics)


def replay(  # noqa: PLR0913  what the command line offers
    recording: RecordingPath,
    output: Path,
    topics: Collection[str] = (),
    parameters: Mapping[str, object] | None = None,
    *,
    drop_input: bool = False,
    salvage: bool = False,
    largest: int = MAX_MESSAGE_BYTES,
    progress: Callable[[int, int], object] = lambda _done, _total: None,
    inform: Callable[[str], object] = str,
) -> ReplayReport:
    """Write a copy of a recording, with the cleaned and the outlier clouds added.

    Output clouds have the bag time of their cloud, and follow it: first the cleaned, then the
    outlier cloud.

    Parameters
    ----------
    recording : ROS 2 bag folder, ``.mcap``, ``.db3``, or ROS 1 ``.bag``
    output : folder to be made, an MCAP bag
    topics : topics of clouds or 2-D scans to filter, each as a stream of its own; none given: all.
        Those that point_cloud_transport has compressed are filtered where the plain one is not
        recorded
    parameters : of the filter, by flat name
    drop_input : do not copy the input clouds
    salvage : filter the readable part of a damaged recording; losses are counted
    largest : bytes that a message, or a chunk of messages, may have
    progress : called after each message with the number of messages read, and of all
    inform : is called with a sentence on how the clouds of a topic are read, once for each layout

    Raises
    ------
    FilterError
        If the recording cannot be read or has no such topic, all of its clouds were refused, the
        output cannot be written, or a parameter is invalid.

    """
    given = FilterParameters().changed(parameters or {})
    if isinstance(recording, Path) and recording.resolve() in output.resolve().parents:
        raise RecordingError('the output', f'outside of {recording}, which stays as it is', output)
    check_new(output, FOLDER)
    with ExitStack() as stack:
        path, lost = recording, Losses()
        if salvage:
            if not isinstance(recording, Path):
                raise RecordingError('a recording to salvage', 'on this machine', recording)
            path, lost = stack.enter_context(salvaged(recording, output, largest))
            largest += OWN_CHUNK_BYTES  # the copy has chunks of its own
        source = stack.enter_context(Recording(path, largest))
        source.path = recording  # errors name the recording that was given, not its copy
        custom_data = {**source.custom_data, **made_by('replay', given)}
        bag = stack.enter_context(NewBag(output, custom_data))
        chosen = choose_clouds(source, topics, 'a topic to filter', scans=True)
        if len(chosen) > 1:
            _check_several(given)
        check_motion(source, given.motion)
        streams = {topic: CloudTopic(topic, given, inform) for topic in chosen}
        started = perf_counter()
        done = _copy(source, bag, streams, set(streams) if drop_input else set(), progress)
        elapsed = perf_counter() - started
        reports = tuple(stream.report() for stream in streams.values())
        _check_outputs(source, reports)
        unread = max(0, source.message_count - done)
        return ReplayReport(output, reports, source.duration * 1e-9, elapsed, unread, lost)


def _copy(
    source: Recording,
    bag: NewBag,
    streams: Mapping[Topic, CloudTopic],
    dropped: Collection[Topic],
    progress: Callable[[int, int], object],
) -> int:
    """Write the messages that are kept, and all output clouds; count the messages read."""
    for topic in source.topics:
        if topic not in dropped:
            bag.add(topic)
    names = {topic.name for topic in source.topics}
    listeners: dict[tuple[str, str], list[Callable[[int, bytes], object]]] = {}
    for stream in streams.values():
        stream.begin(bag, names)
        for key, take in stream.listeners.items():
            listeners.setdefault(key, []).append(take)
    done = 0
    for topic, time, data in source.messages():
        if topic not in dropped:
            bag.write(topic, time, data)
        for listener in listeners.get((topic.name, topic.msgtype), ()):
            listener(time, data)
        done += 1
        progress(done, source.message_count)
    for stream in streams.values():
        stream.finish()
    return done


def choose_clouds(
    source: Recording, requested: Collection[str], what: str, *, scans: bool = False
) -> list[Topic]:
    """Find the requested topics of clouds, which errors call ``what``; without a request, all.

    With ``scans``, those of 2-D scanners, too.
    """
    clouds = cloud_topics(source, scans=scans)
    if not clouds:
        found = ', '.join(f'{topic.name} ({topic.msgtype})' for topic in source.topics)
        must_be = f'one with a topic of type {CLOUD}' + (f' or {SCAN}' if scans else '')
        raise NoCloudsError(f'the recording {source.path}', must_be, found or 'no topic at all')
    names = dict.fromkeys(requested or clouds)
    for name in names:
        if name not in clouds:
            raise RecordingError(what, f'one of {", ".join(clouds)}', repr(name))
        check_name(what, name)  # ROS 1 allowed more
    return [clouds[name] for name in names]


def _check_outputs(source: Recording, reports: Sequence[TopicReport]) -> None:
    """Refuse to write a copy if every cloud was refused: it would have no output clouds."""
    clouds = sum(report.messages for report in reports)
    if clouds and clouds == sum(report.refused for report in reports):
        reasons = '; '.join(f'{one.topic}: {one.refused_because}' for one in reports if one.refused)
        must_be = 'such that one at least can be filtered'
        got = f'{clouds} refused, for: {reasons}'
        raise RecordingError(f'the clouds of {source.path}', must_be, got)


def _check_several(parameters: FilterParameters) -> None:
    """Refuse one mask, and one path, for several sensors."""
    if parameters.mask != OFF:
        must_be = f"'{OFF}' for several topics, whose sensors see the vehicle from elsewhere"
        raise ParameterError('mask', must_be, repr(parameters.mask))
    if parameters.motion.source == 'odometry':
        must_be = "'none' for several topics, whose sensors are not at the same place"
        raise ParameterError('motion.source', must_be, repr(parameters.motion.source))
