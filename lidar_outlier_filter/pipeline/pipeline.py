# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The steps of a cloud: message → points → blocks → verdict → cleaned and outliers. Without ROS."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.core.engine.blocks import Blocks
from lidar_outlier_filter.core.engine.chain import Chain, uses_lines
from lidar_outlier_filter.core.engine.slow import SlowDetector
from lidar_outlier_filter.core.engine.stream_cloud import StreamCloud
from lidar_outlier_filter.core.engine.stream_lines import StreamLines
from lidar_outlier_filter.core.points.line_recovery import Claim, Decision
from lidar_outlier_filter.core.points.points import Points, no_return
from lidar_outlier_filter.errors import CloudError, JudgingError, ParameterError, printable
from lidar_outlier_filter.messages.array_cloud import as_given, as_message
from lidar_outlier_filter.messages.cloud import is_organised, split
from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_filter.messages.laser_scan import ScanCloud
from lidar_outlier_filter.parameters.filter import FilterParameters, describe
from lidar_outlier_filter.pipeline.motion import PoseQueue, PoseSource
from lidar_outlier_filter.pipeline.statistics import Statistics


@dataclass(eq=False, kw_only=True)
class _PendingCloud(StreamCloud):
    """A cloud on its way, and how it is to be split."""

    msg: Any
    tag: Any
    parameters: FilterParameters
    bypassed: str = ''  # why it is not filtered; empty: it is filtered

    @property
    def is_judged(self) -> bool:
        """Whether it has a verdict of detectors."""
        return self.error is None and not self.bypassed


@dataclass(frozen=True)
class SplitCloud:
    """A cloud's two parts, of its type, and its tag; a part that is not requested is None."""

    cleaned: Any
    outliers: Any
    tag: Any


class Pipeline:
    """Filters a stream of clouds; each gives one split cloud, in order, unless it is refused.

    A cloud may wait for its poses and for its blocks: its split cloud is returned by the call that
    completes them.

    Parameters
    ----------
    parameters : FilterParameters
    inform, warn : callable, optional
        Called with sentences, each once, on how clouds are read and judged, and what they lack.
    motion : PoseSource, optional
        With it points are moved to a fixed frame before they are judged.

    Attributes
    ----------
    statistics, refuse, fail, slow : see :class:`.CloudFilter`
    show : list of callable
        Each is called with each judged cloud and its message.
    pass_failed : bool
        Whether clouds that could not be judged pass unfiltered, instead of being refused.
    requested_outputs : pair of bool
        Which of cleaned and outliers are made.

    """

    def __init__(
        self,
        parameters: FilterParameters,
        inform: Callable[[str], object] = str,
        warn: Callable[[str], object] = str,
        motion: PoseSource | None = None,
    ) -> None:
        self.refuse: Callable[[CloudError], object] = str
        self.fail: Callable[[JudgingError], object] = str
        self.slow: Callable[[SlowDetector], object] = str
        self.show: list[Callable[[StreamCloud, Any], object]] = []
        self.pass_failed = False
        self.requested_outputs = (True, True)
        self.statistics = Statistics()
        self._parameters = parameters
        # A line break in the name of a field would begin a line of its own in a log.
        inform, warn = _printing(inform), _printing(warn)
        self._inform, self._warn = inform, warn
        self._decoder = Decoder(parameters, inform, warn)
        self._lines: StreamLines[_PendingCloud] = StreamLines(parameters, self._say_lines)
        self._is_moving = motion is not None
        if motion is not None:
            self.statistics.poses = motion.refusals
        self._queue: PoseQueue[_PendingCloud] = PoseQueue(motion, parameters)
        self._blocks: Blocks[_PendingCloud] = Blocks(parameters)
        self._blocks.inform, self._blocks.fail = inform, self._failed
        self._finished: list[_PendingCloud] = []
        self._failed_at: set[str] = set()  # lines of code
        self._slow_detectors: set[str] = set()
        self._is_degraded = False
        self._set_chain(self._blocks.chain)

    def process(
        self,
        cloud: Any,
        tag: Any = None,
        *,
        stamp: int | np.integer[Any] | None = None,
        bypassed: str = '',
    ) -> list[SplitCloud]:
        """Filter the next cloud, as :meth:`.CloudFilter.push` does.

        ``bypassed`` is the reason why it is not filtered, if any: all its points go to its cleaned
        cloud. Where it is refused, ``advance`` returns the clouds that its time completes.
        """
        with self._counted_refusals():
            msg = as_message(cloud, stamp)
        self.statistics.degraded += self._is_degraded and self.has_line_detectors and not bypassed
        with self._counted_refusals(tuple if bypassed else self._decoder.undo):
            # Decode: position, time and scan line of each point.
            points = self._without_points(msg) if bypassed else self._decoder.decode(msg)
            frame = str(msg.header.frame_id) if self._is_moving else ''
            cloud = _PendingCloud(
                points,
                frame=frame,
                msg=msg,
                tag=tag,
                parameters=self._parameters,
                bypassed=bypassed,
            )
            # Lines: numbered as decided, once a stretch of the stream shows what they are.
            self._pass_on(self._lines.push(cloud, self._claim), cloud)
        # Verdict: a cloud is finished when all its points have one.
        # Split: cleaned and outliers, every point in one of them, byte for byte.
        return self._split()

    def _pass_on(self, lined: Iterable[_PendingCloud], new: _PendingCloud | None = None) -> None:
        """Move and judge clouds whose lines are known; raise the refusal of the ``new`` one."""
        for cloud in lined:
            try:
                self._enter(cloud)
                # Move: each point to the fixed frame, once the pose at its own time is known.
                # Blocks: each complete one goes, with its halo, through the chain of detectors.
                self._judge(self._queue.ready(), cloud)
            except CloudError as err:
                if cloud is new:
                    raise
                self.refused(err)

    def advance(self) -> list[SplitCloud]:
        """Return the clouds completed by new poses, or by the time of a refused cloud."""
        self._judge(self._queue.ready())
        return self._split()

    def flush_pending(self) -> list[SplitCloud]:
        """Return all pending clouds, judged with the poses and points that have arrived."""
        self._pass_on(self._lines.release())
        self._judge(self._queue.release_all())
        self._finished += self._blocks.flush_pending()
        return self._split()

    def release_oldest(self) -> list[SplitCloud]:
        """Return the oldest pending cloud and all that have their poses; others may wait."""
        if not self._blocks.pending and not self._queue.clouds:
            self._pass_on(self._lines.release())
        if not self._blocks.pending and self._queue.clouds:
            self._judge([self._queue.release()])
            self._judge(self._queue.ready())
        self._finished += self._blocks.flush_pending()
        return self._split()

    def flush(self) -> list[SplitCloud]:
        """Return all pending clouds, and reset: the end of a recording."""
        self._decoder.reset()
        self._pass_on(self._lines.release())
        self._lines.reset()
        self._end_stream()
        return self._split()

    def reset(self) -> list[SplitCloud]:
        """Return all pending clouds, and reset, because the clock was set back."""
        self._pass_on(self._lines.release())
        self._lines.reset()
        self._blocks.resets += 1
        self._end_stream()
        return self._split()

    @property
    def parameters(self) -> FilterParameters:
        """The parameters in force."""
        return self._parameters

    @property
    def pending(self) -> int:
        """Number of clouds that were accepted and not returned."""
        return len(self._lines.held) + len(self._queue.clouds) + len(self._blocks.pending)

    @property
    def oldest(self) -> Any:
        """Tag of the oldest pending cloud; None if no cloud is pending."""
        pending = self._blocks.pending or self._queue.clouds or self._lines.held
        return pending[0].tag if pending else None

    @property
    def convention(self) -> str:
        """How clouds are read, in words; empty before the first valid point."""
        lines = '' if self._lines.decision is None else self._lines.decision.text
        return '; '.join(filter(None, (str(self._decoder.convention or ''), lines)))

    @property
    def has_rings(self) -> bool:
        """Whether the scan lines of the last cloud with a valid point are the sensor's rings."""
        return self._decoder.convention is not None and self._decoder.convention.has_rings

    @property
    def has_line_detectors(self) -> bool:
        """Whether the detectors that judge each scan line by itself can run alone."""
        return self._line_chain is not None

    def use_chain(self, chain: Chain) -> None:
        """Judge the next blocks by a chain in place of that of the parameters."""
        self._blocks.chain = self._chain = chain

    def degrade(self, *, on: bool) -> None:
        """Judge the next blocks by the fast line detectors only, or by the whole chain again."""
        self._is_degraded = on
        self._blocks.chain = (self._line_chain if on else None) or self._chain

    def change(self, parameters: FilterParameters) -> None:
        """Apply new parameters from the next block; pending clouds keep their output layout.

        Raises
        ------
        ParameterError
            If a parameter changes that is fixed at the start.

        """
        before, after = self._parameters.flat(), parameters.flat()
        for parameter in describe():
            if parameter.fixed and before[parameter.name] != after[parameter.name]:
                must_be = f'{before[parameter.name]!r} (read-only)'
                raise ParameterError(parameter.name, must_be, repr(after[parameter.name]))
        chain = Chain(parameters)
        self._parameters = self._decoder.parameters = parameters
        self._set_chain(chain)
        self.degrade(on=self._is_degraded)
        self._queue.set_max_delay(parameters.max_delay)

    def refused(self, err: CloudError) -> None:
        """Count and report a refused cloud."""
        self.statistics.refusals.note(err.what)
        self.refuse(err)

    @property
    def _claim(self) -> Claim | None:
        """What the last cloud's lines claim to be; None where they are not needed."""
        convention = self._decoder.convention
        return convention.claim if convention and uses_lines(self._parameters.chain) else None

    def _say_lines(self, decision: Decision) -> None:
        self.statistics.lines = decision.text.removeprefix('scan lines: ')
        if decision.text:
            (self._warn if decision.contradicts else self._inform)(decision.text)

    def _without_points(self, msg: Any) -> Points:
        view = self._decoder.view(msg)
        return no_return(0 if view is None else view.size)

    def _enter(self, cloud: _PendingCloud) -> None:
        """Let a cloud wait for its poses."""
        self._blocks.refuse_span(cloud)
        if self._blocks.is_set_back(cloud, self._queue.newest):
            self._blocks.refuse_more_than_fit(cloud.count)
            self._blocks.resets += 1
            self._end_stream()
        self._queue.newest = max(self._queue.newest, cloud.last)
        self._judge(self._queue.ready())
        self._blocks.make_room(cloud, self._queue.points + self._lines.points)
        self._queue.append(cloud)

    def _judge(self, clouds: Iterable[_PendingCloud], entered: _PendingCloud | None = None) -> None:
        """Judge the blocks that clouds complete; raise the refusal of one that has just entered."""
        for cloud in clouds:
            try:
                self._finished += self._blocks.push(cloud)
            except CloudError as err:
                if cloud is entered:
                    raise
                self.refused(err)

    def _end_stream(self) -> None:
        self._judge(self._queue.release_all())
        self._finished += self._blocks.flush()
        self._queue.reset()

    def _take_finished(self) -> list[_PendingCloud]:
        """Return the clouds that were finished, and update the counts of the stream."""
        finished = self._finished + self._blocks.take_finished()
        self._finished = []
        statistics, chain = self.statistics, self._blocks.chain
        statistics.resets = self._blocks.resets
        statistics.without_pose = self._queue.without_pose
        statistics.passes = max(statistics.passes, chain.passes)
        chain.say_methods(self._inform, self._warn, known=statistics.methods)
        statistics.methods.update(chain.methods)
        chain.methods.clear()
        return finished

    def _split(self) -> list[SplitCloud]:
        """Split the clouds that were finished; there is nothing for a refused one."""
        return [self._split_one(cloud) for cloud in self._take_finished() if self._note(cloud)]

    def _note(self, cloud: _PendingCloud) -> bool:
        """Count and show a finished cloud; return False for a refused one."""
        if cloud.error is not None and not self.pass_failed:
            self.refused(cloud.error)
            return False
        if not cloud.is_judged:
            self.statistics.count_bypassed(cloud.count, cloud.bypassed or 'failure')
            return True
        self.statistics.count(cloud.verdict, len(cloud.where))
        for show in self.show:
            show(cloud, cloud.msg)
        return True

    def _split_one(self, cloud: _PendingCloud) -> SplitCloud:
        if isinstance(cloud.msg, ScanCloud):
            parts = cloud.msg.split(cloud.verdict.rejected, self.requested_outputs)
            return SplitCloud(*parts, cloud.tag)
        parameters, left_out = cloud.parameters, None
        keeps_shape = parameters.keep_organized and is_organised(cloud.msg)
        if parameters.missing == 'drop' and cloud.is_judged and not keeps_shape:
            self.statistics.dropped += cloud.absent
            left_out = np.ones(cloud.count, np.bool_)
            left_out[cloud.where] = False
        cleaned, outliers = split(
            cloud.msg,
            cloud.verdict,
            keep_organized=keeps_shape,
            scores=parameters.scores,
            left_out=left_out,
            requested=self.requested_outputs,
        )
        return SplitCloud(as_given(cleaned), as_given(outliers), cloud.tag)

    @contextmanager
    def _counted_refusals(self, undo: Callable[[], object] = tuple) -> Iterator[None]:
        try:
            yield
        except CloudError as err:
            undo()
            self.statistics.refusals.note(err.what)
            raise

    def _set_chain(self, chain: Chain) -> None:
        self._chain, self._line_chain = chain, _line_chain(chain)
        for one in (self._chain, self._line_chain):
            if one is not None:
                one.slow = self._takes_long

    def _takes_long(self, slow: SlowDetector) -> None:
        self.slow(slow)
        if slow.name not in self._slow_detectors:
            self._slow_detectors.add(slow.name)
            self._warn(str(slow))

    def _failed(self, err: JudgingError) -> None:
        self.statistics.failures += 1
        if err.place not in self._failed_at:
            self._failed_at.add(err.place)
            self.fail(err)


def _line_chain(chain: Chain) -> Chain | None:
    """Return the chain of the detectors that judge each line by itself, or None."""
    parameters = chain.parameters
    names = tuple(name for name in parameters.chain if DETECTORS[name].lines == 'needs')
    if len(names) < max(parameters.vote, 1):
        return None
    return chain if names == parameters.chain else Chain(parameters.changed({'chain': names}))


def _printing(say: Callable[[str], object]) -> Callable[[str], object]:
    """Return what escapes a sentence before it says it."""
    return lambda text: say(printable(text))
