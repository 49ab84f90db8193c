# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The content of a report: points with scores, verdicts at every step, reasons, truth, counts."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lidar_outlier_filter.core.annotations import (
    Bools,
    Bytes,
    Floats,
    Ints,
    Progress,
    Rows,
    Singles,
)
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.evaluation.labels import Codes
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.report.chains import NEAR_SCORE, ExplainingChain, SharedInputs
from lidar_outlier_filter.report.points import RECORDED, fill, thin
from lidar_outlier_filter.report.sources import ReportCloud, Source, SourceFacts
from lidar_outlier_filter.report.steps import (
    BAD,
    GOOD,
    NO_TRUTH,
    Counts,
    RowCounts,
    ScoreCounts,
    Slider,
    Tally,
    all_values,
    choose_steps,
)

FRAME_NS = SECOND // 10  # nanoseconds: shorter clouds within this time are one frame
SHORT = FRAME_NS // 4
MAX_DRAWN_FRAMES = 1000
APART = 0.3  # of the size of a frame: frames whose middles are farther apart lie side by side
DRAWN_POINTS = 100_000  # points of a file that are drawn together


@dataclass(frozen=True)
class Frames:
    """Points that are drawn together, and that the time slider steps through.

    Attributes
    ----------
    first : (F + 1,) int64
        Where each frame begins among the points. In each, marked points come first: those that any
        step rejects, or that are near the threshold.
    marked : (F,) int64
        How many of a frame are marked.
    clouds : for each frame the numbers of its clouds; empty for files
    start : (F,) int64
        Earliest time, nanoseconds.
    together : whether the frames lie side by side, as those of a drive in a fixed frame

    """

    first: Ints
    marked: Ints
    clouds: tuple[Ints, ...]
    start: Ints
    together: bool

    def __len__(self) -> int:
        """Count the frames."""
        return len(self.marked)


@dataclass(frozen=True)
class Gathered:
    """Data of a report.

    Attributes
    ----------
    name : of the recording or file
    found : what was found of its clouds
    parameters : of the filter
    sliders : one for each detector
    tally : counts at the given settings
    counts : of the points that each step of each slider rejects
    points : those that can be drawn, frame by frame; ``RECORDED``, and columns of the source
    frames : how the points are cut
    methods : the methods of the detectors
    has_frames : whether clouds follow each other in time

    """

    name: str
    found: SourceFacts
    parameters: FilterParameters
    sliders: tuple[Slider, ...]
    tally: Tally
    counts: list[list[Counts]]
    points: Rows
    frames: Frames
    methods: tuple[str, ...]
    has_frames: bool

    @property
    def all(self) -> Counts:
        """Counts of all points."""
        return self.tally.given.above(0)


def gather(
    source: Source, codes: Codes, most: int, progress: Progress = lambda _done, _total, _text: None
) -> Gathered:
    """Judge all clouds, once, and at every step of every slider.

    Where a threshold only divides the score, the score says what each step rejects. Where it does
    not, or where a score is as close to a limit as rounding, the clouds are judged at that step.

    Parameters
    ----------
    source : of the clouds
    codes : meaning of their labels
    most : points that are kept to be drawn
    progress : is called with the number of judged clouds

    """
    possible = all_values(source.parameters)
    tally, keeper = Tally(), Keeper(most)
    chain = ExplainingChain(source.parameters, possible)
    scores = ScoreCounts(possible[0].limits) if len(possible) == 1 else None
    for done, (_, cloud) in enumerate(_judged(source, codes, [chain]), 1):
        progress(done, 0, 'judging')
        tally.add(cloud)
        if scores:
            scores.add_scores(cloud)
        keeper.add(cloud, *chain.why(cloud))
    points = keeper.finish()
    given = tally.given.above(1)
    rejected = [scores.rejected()] if scores else list(chain.rejected.values())
    chosen = choose_steps(possible, rejected, tally.given.above(0).points - tally.untested)
    counts = [[given] * len(slider.values) for slider in chosen]
    judged: list[tuple[int, int]] = []
    for number, slider in enumerate(chosen):
        for step, value in enumerate(slider.values):
            row = possible[number].values.index(value)
            if step == slider.given:
                _put_bit(points, points['rejected'], slider, step)
            elif scores and chain.scaled and not scores.uncertain[row]:
                counts[number][step] = scores.above(row + 1, slider.detector)
                above = points['score'].astype(np.float64) > slider.limits[step]
                _put_bit(points, above, slider, step)
            else:
                judged.append((number, step))
    for (number, step), table in _judge_steps(source, codes, chosen, judged, points, progress):
        counts[number][step] = table.above(1)
    if not tally.given.above(0).bad:
        points['truth'] = NO_TRUTH
    points, frames = cut(points, source, np.array(sorted(given.clouds), np.int64))
    return Gathered(
        source.name,
        source.found,
        source.parameters,
        chosen,
        tally,
        counts,
        points,
        frames,
        tuple(sorted(chain.used)),
        source.has_frames,
    )


def _put_bit(points: Rows, rejected: Bools, slider: Slider, step: int) -> None:
    points['bits'] |= rejected.astype(np.uint32) << np.uint32(slider.first + step)


def _judged(
    source: Source, codes: Codes, chains: Sequence[Chain]
) -> Iterator[tuple[int, ReportCloud]]:
    """Judge the clouds of a source, and translate their labels."""
    for number, cloud in source.judged(chains):
        cloud.truth = translate(cloud.code, codes, len(cloud.points))
        yield number, cloud


def translate(code: Ints | None, codes: Codes, count: int) -> Bytes:
    """Return whether labels (N,) mean a good or a bad point; ``NO_TRUTH`` without labels."""
    if code is None:
        return np.zeros(count, np.uint8)
    truth = np.where(codes.bad(code), BAD, GOOD)
    return np.where(codes.counted(code), truth, NO_TRUTH).astype(np.uint8)


def _judge_steps(  # noqa: PLR0913  what a second reading adds to
    source: Source,
    codes: Codes,
    sliders: Sequence[Slider],
    steps: Sequence[tuple[int, int]],
    points: Rows,
    progress: Progress,
) -> Iterator[tuple[tuple[int, int], RowCounts]]:
    """Judge the clouds at some steps; count, and write the bits of the kept points."""
    if not steps:
        return
    with_reasons = source.parameters.changed({'scores': True})
    chains = [Chain(sliders[one].changed(with_reasons, step)) for one, step in steps]
    sight = SharedInputs()
    for chain in chains:
        chain.see = sight
    tables = [RowCounts(2) for _ in steps]
    for done, (number, cloud) in enumerate(_judged(source, codes, chains), 1):
        progress(done, len(steps) * max(source.found.clouds, 1), 'judging at every step')
        tables[number].add(cloud, cloud.verdict.rejected)
        first, last = np.searchsorted(points['cloud'], (cloud.number, cloud.number + 1))
        mine = points[first:last]
        slider, step = steps[number]
        _put_bit(mine, cloud.verdict.rejected[mine['valid']], sliders[slider], step)
    yield from zip(steps, tables, strict=True)


class Keeper:
    """Keeps at most so many points: rejected ones, those near the threshold, an even sample."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._parts: list[Rows] = []
        self._held = 0
        self._rng = np.random.default_rng(0)

    def add(self, cloud: ReportCloud, why: Ints, added: Singles) -> None:
        """Take the points of a judged cloud; the bits of steps are not known yet."""
        if not self._parts:
            more = {name: one.dtype for name, one in cloud.saved.items() if name != 'intensity'}
            self._parts.append(np.empty(0, [*RECORDED, *more.items()]))
        rows = np.zeros(len(cloud.points), self._parts[0].dtype)
        fill(rows, cloud.points, cloud.verdict, cloud.saved.get('intensity'))
        rows['range'] = cloud.points.range
        for name in cloud.saved.keys() & set(rows.dtype.names or ()):
            rows[name] = cloud.saved[name]
        rows['truth'], rows['why'], rows['added'] = cloud.truth, why, added
        rows['cloud'], rows['valid'], rows['index'] = cloud.number, range(len(rows)), cloud.index
        rows['order'] = self._rng.integers(0, 2**32, len(rows), np.uint32)
        self._parts.append(rows)
        self._held += len(rows)
        if self._held > self._most * 5 // 4:
            self._join()

    def _join(self) -> Rows:
        kept = thin(np.concatenate(self._parts or [np.empty(0, RECORDED)]), self._most)
        self._parts, self._held = [kept], len(kept)
        return kept

    def finish(self) -> Rows:
        """Return the kept points, in the order of their clouds and indices."""
        kept = self._join()
        return kept[np.lexsort((kept['valid'], kept['cloud']))]


def cut(points: Rows, source: Source, known: Ints) -> tuple[Rows, Frames]:
    """Cut the points of the known clouds into frames; return them by frame, marked ones first."""
    if source.has_frames:
        number, clouds = _by_time(points, known)
    else:
        number, clouds = _by_place(points), ()
    marked = (points['bits'] != 0) | points['rejected'] | (points['score'] > NEAR_SCORE)
    order = np.lexsort((~marked, number))
    count = int(number.max()) + 1 if len(number) else 0
    first = np.searchsorted(number[order], np.arange(count + 1))
    start = np.full(count, np.iinfo(np.int64).max)
    np.minimum.at(start, number, points['t'])
    together = not source.has_frames or source.found.moved or _are_apart(points['xyz'], number)
    marks = np.bincount(number[marked], minlength=count)
    return points[order], Frames(first, marks, clouds, start, together)


def _are_apart(xyz: Floats, number: Ints) -> bool:
    """Return whether the first and the last frame lie side by side."""
    if len(number) == 0:
        return True
    ends = [xyz[number == end, :2] for end in (0, number.max())]
    middle = [np.median(xy, axis=0) for xy in ends]
    size = float(np.hypot(*np.ptp(np.percentile(ends[0], [10, 90], axis=0), axis=0)))
    return bool(np.hypot(*(middle[1] - middle[0])) > APART * size)


def _by_time(points: Rows, known: Ints) -> tuple[Ints, tuple[Ints, ...]]:
    """Return the frame of each point of a recording, and the clouds of each frame."""
    if len(points) == 0:
        return np.empty(0, np.int64), ()
    there, begin = np.unique(points['cloud'], return_index=True)
    t = points['t']
    first, last = np.minimum.reduceat(t, begin), np.maximum.reduceat(t, begin)
    frame = np.arange(len(there))
    if np.median(last - first) < SHORT:
        frame = np.unique(first // FRAME_NS, return_inverse=True)[1]
    frame = frame // -(-(int(frame.max()) + 1) // MAX_DRAWN_FRAMES)
    frame = np.unique(frame, return_inverse=True)[1]
    # A cloud without kept points belongs to the frame before it.
    of_known = frame[np.maximum(np.searchsorted(there, known, side='right') - 1, 0)]
    clouds = tuple(known[of_known == number] for number in range(int(frame.max()) + 1))
    return frame[np.searchsorted(there, points['cloud'])], clouds


def _by_place(points: Rows) -> Ints:
    """Cut a file into parts: in order of time, or tile by tile without times."""
    if len(points) == 0:
        return np.empty(0, np.int64)
    parts = min(-(-len(points) // DRAWN_POINTS), MAX_DRAWN_FRAMES)
    t, xy = points['t'], points['xyz'][:, :2]
    if t.min() < t.max():
        key = np.argsort(t, kind='stable')
    else:
        xy = xy - xy.min(axis=0)
        tile = np.floor(xy / max(float(xy.max()), 1e-9) * np.sqrt(parts))
        key = np.lexsort((tile[:, 0], tile[:, 1]))
    number = np.empty(len(points), np.int64)
    number[key] = np.arange(len(points)) * parts // len(points)
    return number
