# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Counts of the clouds of one topic, their warnings, and the warning of losses.

Knows no ROS.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass, field

import numpy as np

from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.core.engine.slow import SlowDetector
from lidar_outlier_filter.parameters.node import ERROR_LIMITS, HealthLimits
from lidar_outlier_filter.parameters.yaml_files import config_folder
from lidar_outlier_filter.pipeline.statistics import Statistics
from lidar_outlier_filter.ros.backlog import Treatment

OK, WARN, ERROR = 0, 1, 2
# By the name that ROS has for a middleware. Fast DDS is that of Jazzy, where nobody chose another.
PROFILES = {
    'rmw_fastrtps_cpp': 'fastdds_large_clouds.xml',
    'rmw_cyclonedds_cpp': 'cyclonedds_large_clouds.xml',
}
LOSS_PERIOD = 5.0  # seconds between two warnings
LOST, WITHOUT_POSE = 'lost in transit', 'judged without poses'
DROPPED, UNFILTERED = Treatment.DROP.value, Treatment.PASS.value
DEGRADED = Treatment.DEGRADE.value
# Of the counts since the start, those without a reason of their own.
COUNTS: tuple[str, ...] = ('messages', 'points', 'outliers', 'untested', 'invalid', 'dropped')
COUNTS += ('refused', 'degraded', 'without_pose', 'resets', 'failures')
MOST_REJECTED = 0.5  # of all points, by any detectors
BY_POLICY = {DROPPED, UNFILTERED, DEGRADED}  # load.policy decides these


@dataclass
class _Tally:
    """Events since the last sample."""

    clouds: int = 0
    points: int = 0
    delays: list[float] = field(default_factory=list)
    ages: list[float] = field(default_factory=list)
    spent: list[float] = field(default_factory=list)
    slow: dict[str, SlowDetector] = field(default_factory=dict)


@dataclass(frozen=True)
class Backlog:
    """Queue in clouds and MB, clouds pending in blocks, publishers of the input, age in s."""

    clouds: int
    megabytes: float
    waiting: int
    publishers: int = 0
    oldest: float = 0.0  # seconds that the oldest of all these has waited


class Health:
    """Notes what happens to clouds, from any thread; reports them at each sample."""

    def __init__(self, middleware: str = 'rmw_fastrtps_cpp') -> None:
        """Begin with nothing; the advice against losses is for this middleware."""
        profile = PROFILES.get(middleware)
        self._advice = (
            f'for large clouds all nodes need {config_folder() / profile}'
            if profile
            else f'see doc/large_clouds.md for large clouds over {middleware}'
        )
        self._lock = threading.Lock()
        self._tally = _Tally()
        self._silent = 0.0  # seconds, at the last sample
        self._unpublished = 0.0  # seconds in which clouds were dropped, and none was published
        self._missed: Counter[str] = Counter()  # clouds since the start, lost and dropped
        self._missed_before: Counter[str] = Counter()
        self._counts = self._before = Statistics()
        self._warned: Counter[str] = Counter()  # of the losses
        self._quiet = LOSS_PERIOD  # seconds since the last warning of losses

    def received(self) -> None:
        """Note a cloud that came in."""
        with self._lock:
            self._tally.clouds += 1

    def read(self, points: int) -> None:
        """Note the points of a cloud that was read."""
        with self._lock:
            self._tally.points += points

    def missed(self, what: str, count: int = 1) -> None:
        """Note clouds that get no output: ``LOST`` by the middleware, or ``DROPPED``."""
        with self._lock:
            self._missed[what] += count

    def published(self, delay: float, age: float) -> None:
        """Note an output: seconds since the cloud was received, and since its stamp."""
        with self._lock:
            self._tally.delays.append(delay)
            self._tally.ages.append(age)

    def spent(self, seconds: float) -> None:
        """Note the time that a cloud took to filter."""
        with self._lock:
            self._tally.spent.append(seconds)

    def slow(self, detector: SlowDetector) -> None:
        """Note a detector that takes too long for a block."""
        with self._lock:
            self._tally.slow[detector.name] = detector

    def counted(self, counts: Statistics) -> None:
        """Take a copy of the counts since the start."""
        counts = deepcopy(counts)
        with self._lock:
            self._counts = counts

    def losses(self) -> Counter[str]:
        """Count the clouds since the start that were not filtered fully, by what happened."""
        with self._lock:
            counts = self._counts
            unfiltered = counts.bypassed['overload'] + counts.bypassed['failure']
            others = {
                UNFILTERED: unfiltered,
                DEGRADED: counts.degraded,
                WITHOUT_POSE: counts.without_pose,
            }
            return self._missed + Counter(others)

    def loss_warning(self, policy: str, seconds: float) -> str:
        """Sum up the losses since the last warning; empty where none is due. No loss is left out.

        ``seconds`` is the time since the last call, infinite at the end; ``policy`` is
        ``load.policy``.
        """
        self._quiet += seconds
        losses = self.losses()
        new = losses - self._warned
        if not new or self._quiet < LOSS_PERIOD:
            return ''
        self._warned, self._quiet = losses, 0.0
        counts = ', '.join(f'{count} {what}' for what, count in new.items())
        reason = '' if BY_POLICY.isdisjoint(new) else f' (load.policy is {policy})'
        advice = f'; {self._advice}' if LOST in new else ''
        return f'clouds not filtered fully since the last warning: {counts}{reason}{advice}'

    def sample(
        self,
        seconds: float,
        limits: HealthLimits,
        max_delay: float,
        backlog: Backlog,
        remarks: Sequence[str] = (),
    ) -> Report:
        """Summarise the seconds since the last sample; ``remarks`` are warnings of others."""
        with self._lock:
            tally, self._tally = self._tally, _Tally()
            counts, before = self._counts, self._before
            since = self._missed - self._missed_before
            self._before, self._missed_before = counts, self._missed.copy()
        self._silent = 0.0 if tally.clouds else self._silent + seconds
        if tally.delays:
            self._unpublished = 0.0
        elif since[DROPPED]:
            self._unpublished += seconds
        waits = max(backlog.oldest, self._unpublished)
        state = _Sample(
            tally, since, counts, before, seconds, backlog, self._silent, waits, self._advice
        )
        complaints = [*state.complaints(limits, max_delay), *((WARN, text) for text in remarks)]
        return Report(
            max((level for level, _ in complaints), default=OK),
            '; '.join(text for _, text in complaints) or 'clouds are filtered in time',
            state.values()
            | {'lost': str(self._missed[LOST]), 'dropped': str(self._missed[DROPPED])},
            state.plotted(),
        )


@dataclass(frozen=True)
class Report:
    """A sample: a level, one sentence, values to read and values to plot."""

    level: int
    message: str
    values: dict[str, str]
    plotted: dict[str, float]


@dataclass(frozen=True)
class _Sample:
    tally: _Tally
    missed: Counter[str]
    now: Statistics
    before: Statistics
    seconds: float
    backlog: Backlog
    silent: float
    waits: float  # seconds that the longest wait for output has taken so far
    advice: str  # where clouds are lost in transit

    def since(self, name: str) -> int:
        """Return by how much a count has grown since the last sample."""
        return int(getattr(self.now, name) - getattr(self.before, name))

    @property
    def unfiltered(self) -> int:
        """Clouds that the filter let pass since the last sample."""
        reasons = ('overload', 'failure')
        return sum(self.now.bypassed[reason] - self.before.bypassed[reason] for reason in reasons)

    def share(self, name: str) -> float:
        """Return a count ÷ the points, both since the last sample; 0 without points."""
        return self.since(name) / max(self.since('points'), 1)

    def complaints(self, limits: HealthLimits, max_delay: float) -> Iterator[tuple[int, str]]:
        """Return what is above its limit."""
        if failures := self.since('failures'):
            yield ERROR, f'a detector raised an error in {failures} blocks: see the log'
        yield from ((WARN, str(slow)) for slow in self.tally.slow.values())
        # Whatever the limits are: only clouds with output have a delay.
        if self.waits > max_delay:
            level = ERROR if self.backlog.oldest > ERROR_LIMITS['delay'] * max_delay else WARN
            yield level, f'no output for {self.waits:.1f} s, max_delay {max_delay:g} s'
        delay = _percentiles(self.tally.delays)[1]
        unfiltered, said = self._unfiltered()
        silence = f'no cloud for {self.silent:.0f} s'
        if self.backlog.publishers:
            silence += f', publishers: {self.backlog.publishers} ({self.advice})'
        late = f'the 95th percentile of the delay is {delay:.2f} s, max_delay {max_delay:g} s'
        rejected, untested = self.share('outliers'), self.share('untested')
        yield from self._unusual(limits)
        for name, value, text in (
            ('silence', self.silent, silence),
            ('delay', delay / max_delay, late),
            ('unfiltered', unfiltered, said),
            ('rejected', rejected, f'{100 * rejected:.1f} % of the points are rejected'),
            ('untested', untested, f'{100 * untested:.1f} % of the points are untested'),
        ):
            limit = getattr(limits, f'{name}_warn')
            if value > (limit or (MOST_REJECTED if name == 'rejected' else 0)):
                yield ERROR if value > ERROR_LIMITS[name] else WARN, text

    def _unusual(self, limits: HealthLimits) -> Iterator[tuple[int, str]]:
        """Name the detectors that reject more than is usual, unless a limit for all is set."""
        rejected = self.now.rejected - self.before.rejected
        for name, one in DETECTORS.items():
            share = rejected[name] / max(self.since('points'), 1)
            if share > one.usual and not limits.rejected_warn:
                said = f'{100 * share:.1f} % of the points, usually at most {100 * one.usual:g} %'
                yield WARN, f'{name} rejects {said}'

    def _unfiltered(self) -> tuple[float, str]:
        """Return the share of clouds that were not filtered fully, and a sentence on them."""
        missed = Counter({'refused': self.since('refused')}) + self.missed
        missed[UNFILTERED], missed[WITHOUT_POSE] = self.unfiltered, self.since('without_pose')
        received = self.tally.clouds + missed[LOST]
        counts = ', '.join(f'{count} {what}' for what, count in missed.items() if count)
        said = f'clouds not filtered fully: {missed.total()} ({counts})'
        said += f'; received in the same time: {self.tally.clouds}'
        if missed[LOST]:
            said += f'; {self.advice}'
        return min(missed.total() / max(received, 1), 1.0), said

    def values(self) -> dict[str, str]:
        """Return all values by name: rates since the last sample, counts since the start."""
        tally, now = self.tally, self.now
        found = {
            'clouds/s': f'{tally.clouds / self.seconds:.1f}',
            'points/s': f'{tally.points / self.seconds:.0f}',
            'backlog, clouds': str(self.backlog.clouds),
            'backlog, MB': f'{self.backlog.megabytes:.1f}',
            'waiting for their block, clouds': str(self.backlog.waiting),
        }
        for name, seconds in (
            ('delay since received', tally.delays),
            ('delay since stamp', tally.ages),
            ('processing time', tally.spent),
        ):
            for which, value in zip(('p50', 'p95', 'max'), _percentiles(seconds), strict=True):
                found[f'{name}, {which}, ms'] = f'{1e3 * value:.1f}'
        for name in COUNTS:
            found[name] = str(getattr(now, name))
        if now.lines:
            found['scan lines'] = now.lines
        for text, counter in (
            ('blocks judged by', now.methods),
            ('rejected by', now.rejected),
            ('reason', now.reasons),
            ('undecided by', now.undecided),
            ('refused for', now.refusals),
            ('refused poses for', now.poses),
            ('unfiltered for', now.bypassed),
        ):
            found |= {f'{text} {name}': str(count) for name, count in sorted(counter.items())}
        return found

    def plotted(self) -> dict[str, float]:
        """Name what is plotted: seconds, shares, and counts since the last sample."""
        tally, backlog = self.tally, self.backlog
        p50, p95, largest = _percentiles(tally.delays)
        return {
            'clouds_per_second': tally.clouds / self.seconds,
            'points_per_second': tally.points / self.seconds,
            'rejected_share': self.share('outliers'),
            'untested_share': self.share('untested'),
            'refused': float(self.since('refused')),
            'lost': float(self.missed[LOST]),
            'dropped': float(self.missed[DROPPED]),
            'bypassed': float(self.unfiltered),
            'backlog_clouds': float(backlog.clouds),
            'backlog_megabytes': backlog.megabytes,
            'waiting_clouds': float(backlog.waiting),
            'delay_p50': p50,
            'delay_p95': p95,
            'delay_max': largest,
            'age_p95': _percentiles(tally.ages)[1],
            'processing_p95': _percentiles(tally.spent)[1],
        }


def _percentiles(values: Sequence[float]) -> tuple[float, float, float]:
    """Return median, 95th percentile and the largest, each a value of those given; 0 of none."""
    if not values:
        return 0.0, 0.0, 0.0
    ordered = np.sort(values)
    last = len(ordered) - 1
    p50, p95 = (float(ordered[round(share * last)]) for share in (0.5, 0.95))
    return p50, p95, float(ordered[-1])
