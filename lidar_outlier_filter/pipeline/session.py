# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The way of a cloud, without ROS: message → points → verdict → cleaned and outliers.

With all levers that the node and the replay need; for users there is :class:`~.CloudFilter`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.core.engine.blocks import Stream
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.engine.stream_cloud import StreamCloud
from lidar_outlier_filter.core.points.points import missing
from lidar_outlier_filter.errors import CloudError, JudgingError, ParameterError
from lidar_outlier_filter.messages.array_cloud import as_given, as_message
from lidar_outlier_filter.messages.cloud import is_organised, leave_out, split
from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_filter.parameters.filter import describe
from lidar_outlier_filter.pipeline.compiling import is_ready, make_ready
from lidar_outlier_filter.pipeline.moving import MovingStream
from lidar_outlier_filter.pipeline.statistics import Statistics

if TYPE_CHECKING:
    from collections import Counter
    from collections.abc import Callable

    from lidar_outlier_filter.core.engine.slow import SlowDetector
    from lidar_outlier_filter.core.points.points import Points
    from lidar_outlier_filter.parameters.filter import FilterParameters
    from lidar_outlier_filter.pipeline.motion import PoseSource
    from lidar_outlier_filter.pipeline.visibility import SensorWatch


@dataclass(eq=False, kw_only=True)
class _FilteredCloud(StreamCloud):
    """A cloud on its way, and how it is to be answered."""

    msg: Any
    tag: Any
    form: FilterParameters
    passed: str = ''  # why it passes unfiltered; empty: it does not


@dataclass(frozen=True)
class Answer:
    """The two clouds that one cloud was split into, and what was handed in with it.

    Clouds are of the kind that was pushed. A cloud that nobody wants is None.
    """

    cleaned: Any
    outliers: Any
    tag: Any


class Session:
    """Clouds in, answers out: one for each cloud, in order, however long it takes.

    Parameters
    ----------
    parameters : FilterParameters
    inform, warn : callable, optional
        Are called once with a sentence that says how the clouds are read and judged, and what they
        lack.
    motion : PoseSource, optional
        With it clouds wait for their poses, too.
    compiles : bool, optional
        Whether all kernels are made ready here; else each is ready, or compiled, when it is needed.

    Attributes
    ----------
    statistics : Statistics
        Counts since the start.
    refuse : callable
        Is called with the error of a cloud that is refused after it was taken: when its poses
        have come, or when its block was judged.
    fail : callable
        Is called with an error that a detector raised, once for each line of code.
    slow : callable
        Is called from another thread while a detector takes more than 10 × ``max_delay`` for a
        block, for each such block; ``warn`` is called once for each detector.
    show : callable or None
        Is called with each cloud that was judged, and its message.
    watch : SensorWatch or None
        Looks at each cloud that was judged.
    pass_failed : bool
        Whether clouds that could not be judged are passed on, instead of being refused.
    wanted : pair of bool
        Cleaned and outliers: what nobody wants is not made.

    """

    def __init__(
        self,
        parameters: FilterParameters,
        inform: Callable[[str], object] = str,
        warn: Callable[[str], object] = str,
        motion: PoseSource | None = None,
        *,
        compiles: bool = True,
    ) -> None:
        """Compile the kernels, if it does."""
        self._compiles = compiles
        self.statistics = Statistics()
        self.refuse: Callable[[CloudError], object] = str
        self.fail: Callable[[JudgingError], object] = str
        self.slow: Callable[[SlowDetector], object] = str
        self.show: Callable[[StreamCloud, Any], object] | None = None
        self.watch: SensorWatch | None = None
        self.pass_failed = False
        self.wanted = (True, True)
        self._parameters = parameters
        self._decoder = Decoder(parameters, inform, warn)
        self._stream: Stream[_FilteredCloud] = Stream(parameters)
        self._stream.fail = self._failed
        self._inform = self._stream.choice.inform = inform
        self._raised_at: set[str] = set()  # where detectors have raised errors
        self._moving = None
        if motion is not None:
            self._moving = MovingStream(self._stream, motion, parameters, self.refused)
            self.statistics.poses = motion.refusals
        self._entrance = self._moving or self._stream
        if compiles and not is_ready(parameters):
            make_ready(parameters)
        self._warn = warn
        self._slow: set[str] = set()  # detectors that took too long
        self._watch(self._stream.chain)
        self._sheds = False

    @property
    def parameters(self) -> FilterParameters:
        """The parameters in force."""
        return self._parameters

    @property
    def waiting(self) -> int:
        """Count the clouds without an answer."""
        return self._entrance.waiting

    @property
    def oldest(self) -> Any:
        """The tag of the cloud that has waited longest; None where none waits."""
        first = self._entrance.oldest
        return None if first is None else first.tag

    def push(
        self,
        msg: Any,
        tag: Any = None,
        *,
        stamp: int | np.integer[Any] | None = None,
        known: bool = False,
    ) -> list[Answer]:
        """Take the next cloud; return the answers that are finished by it, the oldest first.

        Parameters
        ----------
        msg : structured array of shape (N,) or (height, width), or anything like a PointCloud2
            With the fields x, y and z, metres. Its answers are of the same kind. It must not change
            until it is answered.
        tag : optional
            Comes back with the answer.
        stamp : int, optional
            Time that the times of an array count from, nanoseconds. Absolute times need none.
        known : bool, optional
            Its answer is known elsewhere. It is judged no further than other clouds need, and is
            not counted; both clouds of its answer are None.

        Raises
        ------
        CloudError
            If the cloud makes no sense. It is counted, and the next one is served; ``advance`` has
            the answers that it finished all the same.

        """
        msg = self._as_message(msg, stamp)
        self.statistics.shed += self._sheds and self.can_shed
        try:
            points = self._decoder.decode(msg)
            finished = self._push(points, msg, tag, known=known)
        except CloudError as err:
            self._decoder.undo()
            self.statistics.refusals.note(err.what)
            raise
        return self._answers(finished)

    def pass_by(self, msg: Any, reason: str, tag: Any = None) -> list[Answer]:
        """Take a cloud that is not to be filtered: all of it is cleaned, in its turn.

        Raises
        ------
        CloudError
            If the cloud cannot be split. It is counted, and the next one is served.

        """
        msg = self._as_message(msg)
        try:
            view = self._decoder.view(msg)
            points = missing(0 if view is None else view.size)
            finished = self._push(points, msg, tag, reason)
        except CloudError as err:
            self.statistics.refusals.note(err.what)
            raise
        return self._answers(finished)

    def flush(self) -> list[Answer]:
        """Answer all that is pending, and begin anew: the end of a recording."""
        self._decoder.begin_anew()
        return self._answers(self._entrance.flush())

    def reset(self) -> list[Answer]:
        """Answer all that is pending, and begin anew: the clock was set back. It is counted."""
        return self._answers(self._entrance.reset())

    def hurry(self) -> list[Answer]:
        """Answer all that is pending with what is there, and go on: they waited too long."""
        return self._answers(self._entrance.hurry())

    def hurry_oldest(self) -> list[Answer]:
        """Answer what has waited too long; what waits for its poses may wait on."""
        moving = self._moving
        return self._answers(self._stream.hurry() if moving is None else moving.hurry_oldest())

    def advance(self) -> list[Answer]:
        """Go on with the clouds that have their poses by now, or that a refused one completed."""
        return self._answers(self._entrance.advance())

    def judge_by(self, chain: Chain) -> None:
        """Judge the blocks to come by what stands in for the chain of the parameters."""
        self._stream.chain = self._chain = chain

    @property
    def convention(self) -> str:
        """How clouds are read, for people; empty: none had a valid point yet."""
        return str(self._decoder.convention or '')

    @property
    def has_rings(self) -> bool:
        """Whether the scan lines of the last cloud with a valid point are its sensor's rings."""
        return self._decoder.convention is not None and self._decoder.convention.has_rings

    @property
    def can_shed(self) -> bool:
        """Whether the detectors that look along the line can do without the others."""
        return self._short is not None

    def shed(self, *, on: bool) -> None:
        """Judge the blocks to come along the line only, or by the whole chain again."""
        self._sheds = on
        self._stream.chain = self._short if on and self._short is not None else self._chain

    def change(self, parameters: FilterParameters) -> None:
        """Judge the blocks to come by other parameters; clouds that wait keep their form.

        Raises
        ------
        ParameterError
            If a parameter would change that shapes the stream.

        """
        before, after = self._parameters.flat(), parameters.flat()
        for parameter in describe():
            if parameter.fixed and before[parameter.name] != after[parameter.name]:
                must_be = f'{before[parameter.name]!r} as at the start'
                raise ParameterError(parameter.name, must_be, repr(after[parameter.name]))
        chain = Chain(parameters)
        # What the old chain did not need is compiled before the next cloud.
        try:
            if self._compiles or is_ready(parameters):
                chain.compile()
        except Exception as err:  # noqa: BLE001  it would cost the next block, and no more
            self._failed(JudgingError(err))
        self._parameters = self._decoder.parameters = parameters
        self._watch(chain)
        self.shed(on=self._sheds)
        if self._moving is not None:
            self._moving.wait_at_most(parameters.max_delay)

    def refused(self, err: CloudError, count: int = 1) -> None:
        """Count and report a cloud, or several alike, that was refused elsewhere on its way."""
        self.statistics.refusals.note(err.what, count)
        self.refuse(err)

    def _push(
        self, points: Points, msg: Any, tag: Any, passed: str = '', *, known: bool = False
    ) -> list[_FilteredCloud]:
        frame = '' if self._moving is None else str(msg.header.frame_id)
        cloud = _FilteredCloud(
            points, frame, known=known, msg=msg, tag=tag, form=self._parameters, passed=passed
        )
        return self._entrance.push(cloud)

    def _watch(self, chain: Chain) -> None:
        """Judge by a chain, and by what of it is fast; say where a detector takes too long."""
        self._chain, self._short = chain, _short(chain)
        for one in (chain, self._short):
            if one is not None:
                one.slow = self._takes_long

    def _takes_long(self, slow: SlowDetector) -> None:
        """Report a detector that takes too long; it still runs."""
        self.slow(slow)
        if slow.name not in self._slow:
            self._slow.add(slow.name)
            self._warn(str(slow))

    def _note_ways(self, ways: Counter[str]) -> None:
        """Count the blocks that were judged in each way since the last time; say each way once."""
        for way, count in ways.items():
            if way not in self.statistics.ways:
                self._inform(f'judged by {way}')
            self.statistics.ways[way] += count
        ways.clear()

    def _failed(self, err: JudgingError) -> None:
        """Count a block that a detector raised an error in."""
        self.statistics.failures += 1
        if err.place not in self._raised_at:
            self._raised_at.add(err.place)
            self.fail(err)

    def _as_message(self, cloud: Any, stamp: int | np.integer[Any] | None = None) -> Any:
        try:
            return as_message(cloud, stamp)
        except CloudError as err:
            self.statistics.refusals.note(err.what)
            raise

    def _answers(self, finished: list[_FilteredCloud]) -> list[Answer]:
        self.statistics.resets = self._stream.resets
        self.statistics.unmoved = 0 if self._moving is None else self._moving.unmoved
        self.statistics.passes = max(self.statistics.passes, self._stream.chain.passes)
        self._note_ways(self._stream.chain.ways)
        answers = []
        for cloud in finished:
            if cloud.known:
                answers.append(Answer(None, None, cloud.tag))
                continue
            if cloud.passed:
                self.statistics.count_passed(cloud.count, cloud.passed)
            elif cloud.error is not None:
                if not self.pass_failed:
                    self.refused(cloud.error)
                    continue
                self.statistics.count_passed(cloud.count, 'failure')
            else:
                self.statistics.count(cloud.verdict, len(cloud.points))
                self.statistics.dropped += cloud.absent if _drops(cloud) else 0
                if self.watch is not None:
                    self.watch.add(cloud, has_rings=self.has_rings)
                if self.show is not None:
                    self.show(cloud, cloud.msg)
            answers.append(_answer(cloud, self.wanted))
        return answers


def _answer(cloud: _FilteredCloud, wanted: tuple[bool, bool]) -> Answer:
    cleaned, outliers = split(
        cloud.msg,
        cloud.verdict,
        keep_organized=cloud.form.keep_organized,
        scores=cloud.form.scores,
        wanted=wanted,
    )
    if cleaned is not None and _drops(cloud):
        absent = np.ones(cloud.count, bool)
        absent[cloud.where] = False
        cleaned = leave_out(cleaned, absent[~cloud.verdict.rejected])
    return Answer(as_given(cleaned), as_given(outliers), cloud.tag)


def _drops(cloud: _FilteredCloud) -> bool:
    """Return whether its missing returns are in neither answer; else all are in the cleaned one.

    A cloud that passed unfiltered was not looked at: it keeps them.
    """
    form = cloud.form
    if form.missing == 'keep' or cloud.passed or cloud.error is not None:
        return False
    return not (form.keep_organized and is_organised(cloud.msg))


def _short(chain: Chain) -> Chain | None:
    """Leave all but those that judge each line by itself, which are fast; None: none is left."""
    parameters = chain.parameters
    names = tuple(name for name in parameters.chain if DETECTORS[name].lines == 'needs')
    if len(names) < max(parameters.vote, 1):
        return None
    return chain if names == parameters.chain else Chain(parameters.changed({'chain': names}))
