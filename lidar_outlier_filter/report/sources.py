# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Where the points of a report come from: a recording, or a file; judged as by other commands."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Bytes, Ints
from lidar_outlier_filter.core.engine.blocks import Blocks
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.engine.stream_cloud import StreamCloud
from lidar_outlier_filter.core.engine.whole_cloud import judge_whole, with_rings
from lidar_outlier_filter.core.points.columns import INTENSITIES, candidates
from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.evaluation.labels import LABEL, CloudLabels, read_codes_of
from lidar_outlier_filter.files import points as columns
from lidar_outlier_filter.files.cloud_file import filled, open_cloud
from lidar_outlier_filter.files.judged_file import UNITS
from lidar_outlier_filter.messages.cloud import structured
from lidar_outlier_filter.parameters.declaration import MASK
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.recordings.cloud_topic import MessageTimes
from lidar_outlier_filter.recordings.recorded_clouds import RecordedCloud, RecordedClouds

# Columns that a page shows of a point and saves, and their usual names.
SAVED = {
    'intensity': INTENSITIES,
    'class': (columns.CLASSIFICATION,),
    'gps_time': ('gps_time',),
    'return_number': ('return_number',),
    **{name: (name,) for name in ('red', 'green', 'blue')},
}
MAX_GAPS = 50  # that are listed


@dataclass(eq=False, kw_only=True)
class ReportCloud(StreamCloud):
    """The valid points of a cloud, and what is known of each beside its verdict.

    Attributes
    ----------
    number : of the cloud, from 0
    index : (N,) int64
        Index of each point in its message or file.
    code : (N,) int64 or None
        Label of each point.
    saved : columns by the names of ``SAVED``, as far as they are there
    truth : (N,) uint8
        Meaning of the labels: ``NO_TRUTH``, ``GOOD`` or ``BAD``.

    """

    number: int
    index: Ints
    code: Ints | None = None
    saved: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    truth: Bytes = field(init=False)


@dataclass
class SourceFacts:
    """What was found of the clouds, beside their points.

    Attributes
    ----------
    clouds, invalid : clouds taken, and their missing returns
    masked : points on the own vehicle, which are not drawn
    refusals : refused clouds by what was wrong with them
    sentences : the first message for each of these
    without_pose : clouds that were taken without poses, though there is odometry
    convention : how clouds are read
    span : times of the first and the last valid point, nanoseconds; None without valid points
    times : of all messages with clouds in their recording, nanoseconds
    topic : of the clouds; empty for a file
    moved : whether the points were moved to a fixed frame
    path : position of the sensor, metres, cloud by cloud
    units : metres of one unit of x, y and z in the file
    unit : name of the unit

    """

    clouds: int = 0
    invalid: int = 0
    masked: int = 0
    refusals: dict[str, int] = field(default_factory=dict)
    sentences: dict[str, str] = field(default_factory=dict)
    without_pose: int = 0
    convention: str = ''
    span: tuple[int, int] | None = None
    times: list[int] = field(default_factory=list)
    topic: str = ''
    moved: bool = False
    path: list[tuple[float, float, float]] = field(default_factory=list)
    units: tuple[float, float, float] = (1.0, 1.0, 1.0)
    unit: str = 'm'

    def period_and_gaps(self) -> tuple[float, list[tuple[float, float]]]:
        """Return the usual time from cloud to cloud, s, and begin and length of gaps.

        The time is NaN of less than two clouds. Gaps are in seconds after the first cloud; the
        longest come first.
        """
        counted = MessageTimes(self.times)
        gaps = [
            ((time - self.times[0]) / SECOND, distance / SECOND)
            for time, distance in counted.gaps_found()
        ]
        return counted.usual, sorted(gaps, key=lambda gap: -gap[1])[:MAX_GAPS]


class RecordedSource:
    """One topic of a recording, judged as by a replay."""

    has_frames = True  # clouds follow each other in time

    def __init__(
        self,
        recording: Path,
        parameters: FilterParameters,
        topic: str | None = None,
        label: str = '',
        files: Sequence[Path] = (),
    ) -> None:
        """Name the recording; the truth is a field of the clouds, or in a file for each."""
        self.name = recording.name
        self.parameters = parameters
        self.found = SourceFacts(moved=parameters.motion.source != 'none')
        self._clouds = RecordedClouds(recording, parameters, topic, with_path=True)
        self._labels = CloudLabels(topic or 'the topic', label, files)
        self._required = bool(label)

    def judged(self, chains: Sequence[Chain]) -> Iterator[tuple[int, ReportCloud]]:
        """Judge all clouds by each of the chains; they are read once for all of them."""
        streams: list[Blocks[ReportCloud]] = []
        for chain in chains:
            streams.append(Blocks(chain.parameters))
            streams[-1].chain = chain
        found = SourceFacts(moved=self.found.moved)
        for taken in self._clouds:
            if len(taken.cloud.points):
                first = found.span[0] if found.span else taken.cloud.first
                found.span = first, taken.cloud.last
            if taken.eye is not None and len(taken.eye):
                found.path.append(tuple(taken.eye[0, 0].tolist()))
            for number, stream in enumerate(streams):
                for cloud in stream.push(self._cloud(taken)):
                    yield number, cloud
        for number, stream in enumerate(streams):
            for cloud in stream.flush():
                yield number, cloud
        pipeline, report = self._clouds.read.pipeline, self._clouds.read.report()
        found.clouds, found.invalid = report.messages - report.refused, report.invalid
        found.masked = report.rejected_by.get(MASK, 0)
        found.refusals, found.sentences = dict(report.refusals), dict(report.sentences)
        found.without_pose, found.convention = pipeline.statistics.without_pose, pipeline.convention
        found.topic, found.times = self._clouds.topic, self._clouds.times
        self._labels.check_count(len(found.times))
        self.found = found

    def _cloud(self, taken: RecordedCloud) -> ReportCloud:
        where = taken.cloud.where
        points, frame = taken.cloud.points, taken.cloud.frame
        made = ReportCloud(points, frame, number=taken.number, index=where.astype(np.int64))
        names: tuple[str, ...] = ()
        if taken.cloud.count:
            view = structured(taken.msg).reshape(-1)
            names = view.dtype.names or ()
            made.saved = {name: view[one][where] for name, one in saved_columns(names).items()}
        has_labels = LABEL in names and view.dtype[LABEL].kind in 'iu'
        if self._labels.files or self._required or has_labels:
            made.code = self._labels.read(taken.number, taken.msg)[where]
        return made


class FileSource:
    """A file of points, judged in one piece as by ``clean``."""

    has_frames = False

    def __init__(
        self,
        path: Path,
        parameters: FilterParameters,
        *,
        truth: tuple[Path, str],
        named: bool = False,
    ) -> None:
        """Read the file.

        Parameters
        ----------
        path : of any format that ``clean`` reads
        parameters : of the filter
        truth : a file with labels, and the name of their column; empty: the usual one
        named : whether labels were named; if not, they are optional

        """
        self.name = path.name
        file = open_cloud(path)
        names, saved = columns.choose_coordinates(file, ()), saved_columns(file.columns)
        loaded = columns.load(file, names, parameters, timed=True, more=[*saved.values()])
        self._saved = {name: filled(loaded.more[one]) for name, one in saved.items()}
        loaded = columns.recovered(file, loaded, with_rings(loaded.points, parameters))
        self.parameters, self._loaded = parameters, loaded.points
        labels, column = truth
        has_labels = LABEL in file.columns or (
            file.classes and columns.CLASSIFICATION in file.columns
        )
        self._code = read_codes_of(labels, len(file), column) if named or has_labels else None
        without = 'so that it is judged without scan lines'
        if loaded.rings:
            without = f'{loaded.rings} rings are recovered from elevation'
        how = loaded.lines or f'{loaded.lack}, {without}'
        how += f'; coordinate system {file.crs}' if file.crs else ''
        x, y, z = [*(file.metres.get(name, 1.0) for name in names), 1.0][:3]
        unit = _unit_name(x) if x == z else f'{_unit_name(x)}, z in {_unit_name(z)}'
        self.found = SourceFacts(1, convention=how, units=(x, y, z), unit=unit)

    def judged(self, chains: Sequence[Chain]) -> Iterator[tuple[int, ReportCloud]]:
        """Judge all points by each of the chains."""
        for number, chain in enumerate(chains):
            verdict = judge_whole(self._loaded, chain.parameters, chain)
            where = np.flatnonzero(self._loaded.valid)
            cloud = ReportCloud(self._loaded, number=0, index=where)
            self.found.invalid = cloud.absent
            self.found.masked = int(np.count_nonzero(verdict.masked))
            cloud.verdict = verdict.take(where)
            cloud.code = None if self._code is None else self._code[where]
            cloud.saved = {name: values[where] for name, values in self._saved.items()}
            yield number, cloud


Source = RecordedSource | FileSource  # clouds that can be judged several times


def saved_columns(names: Iterable[str]) -> dict[str, str]:
    """Find the columns of ``SAVED`` among names."""
    there = tuple(names)
    found = {name: candidates(there, usual) for name, usual in SAVED.items()}
    return {name: those[0] for name, those in found.items() if those}


def _unit_name(size: float) -> str:
    """Name a unit of so many metres."""
    return next((name for name, one in UNITS.items() if np.isclose(one, size, 1e-9)), f'{size:g} m')
