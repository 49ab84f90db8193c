# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What becomes of the clouds of one topic, whether that is well, and the warning of losses.

Knows no ROS.
"""

from __future__ import annotations

import threading
from collections import Counter
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.parameters.node import ERROR_LIMITS
from lidar_outlier_filter.pipeline.statistics import Statistics

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from lidar_outlier_filter.core.engine.slow import SlowDetector
    from lidar_outlier_filter.parameters.node import HealthLimits
    from lidar_outlier_filter.pipeline.visibility import SensorView

OK, WARN, ERROR = 0, 1, 2
# By the name that ROS has for a middleware. Fast DDS is that of Jazzy, where nobody chose another.
PROFILES = {
    'rmw_fastrtps_cpp': 'config/fastdds_large_clouds.xml',
    'rmw_cyclonedds_cpp': 'config/cyclonedds_large_clouds.xml',
}
# Of one look, in this order, in the message for plotting.
PLOTTED = (
    'clouds_per_second',
    'points_per_second',
    'rejected_share',
    'untested_share',
    'refused',
    'lost',
    'dropped',
    'passed',
    'backlog_clouds',
    'backlog_megabytes',
    'waiting_clouds',
    'delay_p50',
    'delay_p95',
    'delay_max',
    'age_p95',
    'processing_p95',
)
LOSS_PERIOD = 5.0  # seconds between two warnings


class Loss(Enum):
    """What happened to a cloud that was not filtered as asked, for people."""

    ON_THE_WAY = 'lost on the way'
    DROPPED = 'dropped'
    PASSED = 'passed unfiltered'
    SHED = 'filtered by the smoother alone'
    UNMOVED = 'judged without poses'

    @property
    def is_by_policy(self) -> bool:
        """Whether ``load.policy`` decided it."""
        return self in {Loss.DROPPED, Loss.PASSED, Loss.SHED}


class LossWarning:
    """Sums up losses, and warns of them at a bounded rate; no loss is left out."""

    def __init__(self) -> None:
        """Begin with nothing lost; the first loss is warned of at once."""
        self._said: Counter[Loss] = Counter()
        self._quiet = LOSS_PERIOD  # seconds since the last warning

    def look(self, lost: Mapping[Loss, int], policy: str, seconds: float) -> str:
        """Return the warning that is due; empty where there is none.

        Parameters
        ----------
        lost : counts since the start, by what happened
        policy : ``load.policy``
        seconds : time since the last look; infinite at the end

        """
        self._quiet += seconds
        new = Counter(lost) - self._said
        if not new or self._quiet < LOSS_PERIOD:
            return ''
        self._said, self._quiet = Counter(lost), 0.0
        counts = ', '.join(f'{count} {loss.value}' for loss, count in new.items())
        reason = f' (load.policy is {policy})' if any(loss.is_by_policy for loss in new) else ''
        return f'clouds not filtered as asked since the last warning: {counts}{reason}'


@dataclass
class _Tally:
    """What has happened since the last look."""

    clouds: int = 0
    points: int = 0
    lost: int = 0
    dropped: int = 0
    delays: list[float] = field(default_factory=list)
    ages: list[float] = field(default_factory=list)
    spent: list[float] = field(default_factory=list)
    slow: dict[str, SlowDetector] = field(default_factory=dict)


@dataclass(frozen=True)
class Backlog:
    """Clouds to be filtered, their megabytes, those without an answer; who publishes; the age."""

    clouds: int
    megabytes: float
    waiting: int
    publishers: int = 0
    oldest: float = 0.0  # seconds that the oldest of all these has waited


@dataclass(frozen=True)
class Report:
    """What a look has found: a level, one sentence, values to read and values to plot."""

    level: int
    message: str
    values: dict[str, str]
    plotted: tuple[float, ...]
    view: SensorView | None = None  # None: it has seen no cloud


class Health:
    """Takes down what happens, from any thread; says it at each look."""

    def __init__(self, middleware: str = 'rmw_fastrtps_cpp') -> None:
        """Begin with nothing; what is lost on the way is advised on for this middleware."""
        profile = PROFILES.get(middleware)
        self._advice = (
            f'for large clouds set {profile} for both sides'
            if profile
            else f'doc/large_clouds.md says what helps with large clouds over {middleware}'
        )
        self._lock = threading.Lock()
        self._tally = _Tally()
        self._lost = self._dropped = 0  # since the start
        self._silent = 0.0  # seconds, at the last look
        self._unanswered = 0.0  # seconds in which clouds were dropped, and none was answered
        self._counts = self._before = Statistics()

    def received(self, points: int) -> None:
        """Note a cloud that came in."""
        with self._lock:
            self._tally.clouds += 1
            self._tally.points += points

    def lost(self, count: int) -> None:
        """Note clouds that the middleware says it has lost."""
        with self._lock:
            self._tally.lost += count
            self._lost += count

    def dropped(self, count: int = 1) -> None:
        """Note clouds that were too many, and get no answer."""
        with self._lock:
            self._tally.dropped += count
            self._dropped += count

    def answered(self, delay: float, age: float) -> None:
        """Note an answer: seconds since the cloud was received, and since its stamp."""
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
        counts = counts.copy()
        with self._lock:
            self._counts = counts

    def losses(self) -> dict[Loss, int]:
        """Count the clouds since the start that were not filtered as asked, by what happened."""
        with self._lock:
            counts = self._counts
            return {
                Loss.ON_THE_WAY: self._lost,
                Loss.DROPPED: self._dropped,
                Loss.PASSED: counts.bypassed['overload'] + counts.bypassed['failure'],
                Loss.SHED: counts.degraded,
                Loss.UNMOVED: counts.without_pose,
            }

    def look(  # noqa: PLR0913  what others know
        self,
        seconds: float,
        limits: HealthLimits,
        max_delay: float,
        backlog: Backlog,
        remarks: Sequence[str] = (),
        view: SensorView | None = None,
    ) -> Report:
        """Return what has happened in the seconds since the last look.

        ``remarks`` are warnings of others, ``view`` is what the sensor saw.
        """
        with self._lock:
            tally, self._tally = self._tally, _Tally()
            counts, before = self._counts, self._before
            self._before = counts
        self._silent = 0.0 if tally.clouds else self._silent + seconds
        if tally.delays:
            self._unanswered = 0.0
        elif tally.dropped:
            self._unanswered += seconds
        waits = max(backlog.oldest, self._unanswered)
        look = _Look(tally, counts, before, seconds, backlog, self._silent, waits, self._advice)
        complaints = [*look.complaints(limits, max_delay), *((WARN, text) for text in remarks)]
        if view is not None:
            complaints += [(WARN, text) for text in view.complaints(limits)]
        level = max((level for level, _ in complaints), default=OK)
        return Report(
            level,
            '; '.join(text for _, text in complaints) or 'clouds are filtered in time',
            look.values()
            | {'lost': str(self._lost), 'dropped': str(self._dropped)}
            | ({} if view is None else view.values()),
            look.plotted(),
            view,
        )


@dataclass(frozen=True)
class _Look:
    """One look at what has happened."""

    tally: _Tally
    now: Statistics
    before: Statistics
    seconds: float
    backlog: Backlog
    silent: float
    waits: float  # seconds that the longest wait for an answer takes already
    advice: str  # where clouds are lost on the way

    @property
    def refused(self) -> int:
        return self.now.refused - self.before.refused

    @property
    def passed(self) -> int:
        reasons = ('overload', 'failure', 'compiling')
        return sum(self.now.bypassed[reason] - self.before.bypassed[reason] for reason in reasons)

    def share(self, name: str) -> float:
        """Return the share of the points answered since the last look; 0 of none."""
        points = self.now.points - self.before.points
        count: int = getattr(self.now, name) - getattr(self.before, name)
        return count / points if points else 0.0

    def complaints(self, limits: HealthLimits, max_delay: float) -> Iterator[tuple[int, str]]:
        """Return what is above its limit."""
        tally = self.tally
        failures = self.now.failures - self.before.failures
        if failures:
            yield ERROR, f'a detector raised an error in {failures} blocks: see the log'
        yield from ((WARN, str(slow)) for slow in tally.slow.values())
        # Whatever the limits are: delays are those of clouds that have an answer.
        if self.waits > max_delay:
            level = ERROR if self.backlog.oldest > ERROR_LIMITS['delay'] * max_delay else WARN
            yield level, f'no answer for {self.waits:.1f} s, max_delay {max_delay:g} s'
        delay = _percentiles(tally.delays)[1]
        missed = {
            'refused': self.refused,
            'lost on the way': tally.lost,
            'dropped': tally.dropped,
            'passed unfiltered': self.passed,
            'judged without poses': self.now.without_pose - self.before.without_pose,
        }
        total = max(tally.clouds + tally.lost, 1)
        said = ', '.join(f'{count} {what}' for what, count in missed.items() if count)
        said = f'of {tally.clouds + tally.lost} clouds {said}'
        if tally.lost:
            said += f' ({self.advice})'
        silence = f'no cloud for {self.silent:.0f} s'
        if self.backlog.publishers:
            silence += f', publishers: {self.backlog.publishers} ({self.advice})'
        for name, value, text in (
            ('silence', self.silent, silence),
            (
                'delay',
                delay / max_delay,
                f'the 95th percentile of the delay is {delay:.2f} s, max_delay {max_delay:g} s',
            ),
            ('unfiltered', min(sum(missed.values()) / total, 1.0), said),
            (
                'rejected',
                self.share('outliers'),
                f'{self.share("outliers"):.1%} of the points are rejected',
            ),
            (
                'untested',
                self.share('untested'),
                f'{self.share("untested"):.1%} of the points are untested',
            ),
        ):
            if value > getattr(limits, f'{name}_warn'):
                yield ERROR if value > ERROR_LIMITS[name] else WARN, text

    def values(self) -> dict[str, str]:
        """Name all: rates and times since the last look, counts since the start."""
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
        for name in (
            'messages',
            'points',
            'outliers',
            'untested',
            'invalid',
            'dropped',
            'refused',
            'degraded',
            'without_pose',
            'resets',
            'failures',
        ):
            found[name] = str(getattr(now, name))
        for text, counter in (
            ('blocks judged by', now.ways),
            ('rejected by', now.rejected),
            ('reason', now.reasons),
            ('undecided by', now.undecided),
            ('refused for', now.refusals),
            ('refused poses for', now.poses),
            ('unfiltered for', now.bypassed),
        ):
            found |= {f'{text} {name}': str(count) for name, count in sorted(counter.items())}
        return found

    def plotted(self) -> tuple[float, ...]:
        """Return the values of ``PLOTTED``; seconds, shares, and counts since the last look."""
        tally = self.tally
        return (
            tally.clouds / self.seconds,
            tally.points / self.seconds,
            self.share('outliers'),
            self.share('untested'),
            float(self.refused),
            float(tally.lost),
            float(tally.dropped),
            float(self.passed),
            float(self.backlog.clouds),
            self.backlog.megabytes,
            float(self.backlog.waiting),
            *_percentiles(tally.delays),
            _percentiles(tally.ages)[1],
            _percentiles(tally.spent)[1],
        )


def _percentiles(values: Sequence[float]) -> tuple[float, float, float]:
    """Return median, 95th percentile and the largest, each a value of those given; 0 of none."""
    if not values:
        return 0.0, 0.0, 0.0
    ordered = np.sort(values)
    last = len(ordered) - 1
    p50, p95 = (float(ordered[round(share * last)]) for share in (0.5, 0.95))
    return p50, p95, float(ordered[-1])
