# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The worst failures of the default chain: what it lost, what it missed, and why."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.detectors.boosted_trees.explanation import explain
from lidar_outlier_filter.core.detectors.boosted_trees.pattern_trees import find_either
from lidar_outlier_filter.core.points.points import concatenate
from lidar_outlier_filter.evaluation.labels import words
from lidar_outlier_filter.messages.truth import Cause, Kind
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_lab.results import gallery_picture
from lidar_outlier_lab.results.gallery_picture import Cutout
from lidar_outlier_lab.results.markdown import image, number, paragraphs, table
from lidar_outlier_lab.results.samples import simulated

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Bools, Floats, Progress
    from lidar_outlier_filter.core.points.points import Points
    from lidar_outlier_lab.results.samples import Sample


MOST = 10  # of each kind, for each sample
APART = 1.0  # metres between two that are shown
SHOWN, REACH = 240, 4.0  # points of a cutout at most, and how far they are, metres
FEWEST = 60  # points of a cutout, however far
NEIGHBOURS = 20  # that a surface is fitted to
FITS = 3  # the later ones with the weights of the earlier residuals
NAMED = 3  # contributions that are listed


class Failure(NamedTuple):
    """One point that was judged wrongly.

    Attributes
    ----------
    lost : whether it is good and was rejected; otherwise an outlier that was left
    what : surface or cause
    score : that it was judged by; above 1 rejected
    off : distance from the surface of its neighbours, metres
    sigma : standard deviation of these from it, metres
    largest : features that speak most for the verdict, and what they add to the log-odds, before
        the threshold is taken away; none where trees did not judge
    cutout : what lies around it

    """

    lost: bool
    what: str
    score: float
    off: float
    sigma: float
    largest: tuple[tuple[str, float], ...]
    cutout: Cutout


def worst(score: NDArray[np.floating], wrong: Bools, xyz: Floats, *, lost: bool) -> list[int]:
    """Choose the ten that are judged most wrongly, each a metre from all that are chosen before.

    Lost points are worse the higher they score, missed ones the lower; untested ones lowest.
    """
    result = np.where(np.isnan(score), -np.inf, score)
    candidates = np.flatnonzero(wrong)
    candidates = candidates[
        np.argsort(-result[candidates] if lost else result[candidates], kind='stable')
    ]
    chosen: list[int] = []
    for i in candidates:
        apart = np.linalg.norm(xyz[chosen] - xyz[i], axis=1)
        if (apart > APART).all():
            chosen.append(int(i))
            if len(chosen) == MOST:
                break
    return chosen


def failures(sample: Sample, parameters: FilterParameters) -> list[Failure]:
    """Judge a recording as the node does; return the worst losses, then the worst misses."""
    points = concatenate(sample.data.clouds)
    verdict = sample.data.judge(parameters)
    rejected, bad = verdict.rejected, sample.data.bad
    picked = [(i, True) for i in worst(verdict.score, rejected & ~bad, points.xyz, lost=True)]
    picked += [(i, False) for i in worst(verdict.score, bad & ~rejected, points.xyz, lost=False)]
    found = []
    for i, lost in picked:
        block = _block(points, i, parameters)
        here, around = int(np.searchsorted(block, i)), points.take(block)
        code = int(sample.code[i])
        kind = None if sample.surface is None else Kind(int(sample.surface[i]))
        found.append(
            Failure(
                lost,
                words((Cause(code) if code or kind is None else kind).name),
                float(verdict.score[i]),
                *_surface_of(around.xyz, here),
                _reasons(around, here, lost=lost),
                _cutout(points.xyz[block], here, bad[block], rejected[block]),
            )
        )
    return found


def _block(points: Points, i: int, parameters: FilterParameters) -> NDArray[np.intp]:
    """Return the points of the block of one of them, and of the halo before and after it."""
    length, halo = (round(1e9 * seconds) for seconds in (parameters.block, parameters.halo))
    begin = points.t[i] // length * length
    return np.flatnonzero((points.t >= begin - halo) & (points.t < begin + length + halo))


def _surface_of(xyz: Floats, i: int) -> tuple[float, float]:
    """Return the distance of a point from the plane of its neighbours, and their σ from it."""
    if len(xyz) <= NEIGHBOURS:
        return np.nan, np.nan
    distance = np.linalg.norm(xyz - xyz[i], axis=1)
    near = np.argsort(distance, kind='stable')[1 : NEIGHBOURS + 1]
    there, weight = xyz[near] - xyz[i], np.ones(NEIGHBOURS)
    off = sigma = np.nan
    for _ in range(FITS):
        middle = np.average(there, axis=0, weights=weight)
        about = there - middle
        _, axes = np.linalg.eigh((about * weight[:, None]).T @ about)
        residual = np.abs(about @ axes[:, 0])
        off, sigma = abs(float(middle @ axes[:, 0])), 1.4826 * float(np.median(residual))
        weight = 1.0 / (1.0 + (residual / (3.0 * sigma + 1e-4)) ** 2) ** 2
    return off, sigma


def _reasons(points: Points, i: int, *, lost: bool) -> tuple[tuple[str, float], ...]:
    """Return the features that added most to the log-odds of a point, or took most away."""
    if find_either(points, 'auto') is None:
        return ()
    reasons = explain(points, sensor='auto', wanted=np.arange(len(points)) == i)
    added = reasons.added[:, i]
    speaks = added if lost else -added
    order = np.argsort(-speaks, kind='stable')[:NAMED]
    return tuple((reasons.names[f], float(added[f])) for f in order if speaks[f] > 0)


def _cutout(xyz: Floats, i: int, bad: Bools, rejected: Bools) -> Cutout:
    """Look at what lies nearest around a point along its surface, from the side.

    To the right is the direction in which it extends most, up that in which it extends least.
    """
    distance = np.linalg.norm(xyz - xyz[i], axis=1)
    near = np.argsort(distance, kind='stable')[:SHOWN]
    near = near[: max(int((distance[near] <= REACH).sum()), FEWEST)]
    there = xyz[near] - xyz[i]
    shape = there[~bad[near]] if np.count_nonzero(~bad[near]) > NEIGHBOURS else there
    shape = shape - shape.mean(axis=0)
    _, axes = np.linalg.eigh(shape.T @ shape)
    return Cutout(there @ axes[:, [2, 0]], bad[near], rejected[near])


def section(presets: Sequence[str], seeds: Sequence[int], folder: Path, progress: Progress) -> str:
    """Draw and list the worst failures on each preset, of all seeds together."""
    parameters = FilterParameters()
    parts: list[str] = []
    for done, preset in enumerate(presets):
        found: list[Failure] = []
        for number_, seed in enumerate(seeds):
            what = f'failures on {preset}, seed {seed}'
            progress(done * len(seeds) + number_, len(presets) * len(seeds), what)
            for sample in simulated(preset, seed):
                found += failures(sample, parameters)
        parts += _part(preset, _worst_of(found), folder)
    if not parts:
        return paragraphs(
            '## Failure gallery', 'None of the presets with a target were in this run.'
        )
    return paragraphs(
        '## Failure gallery',
        f'Of each preset with a target, on seeds {", ".join(map(str, seeds))} together: up to '
        f'{MOST} good points that the default lost with the highest scores, and as many outliers '
        f'that it left with the lowest; each more than {APART:g} m from the others of its drive. '
        f'A panel shows the {SHOWN} points nearest to one of them, up to {REACH:g} m away, or the '
        f'{FEWEST} nearest where fewer are within that. They are judged in the same block, and '
        'seen from the side: right is the direction in which they extend most, up that in which '
        'they extend least, with scales of their own, in metres. Named are the features that '
        'speak most for the verdict, and what each adds to the log-odds of the trees '
        '([their meaning](../detectors/boosted_trees.md#why-a-point-is-rejected)); none are '
        'named where there was no scan pattern.',
        *parts,
    )


def _worst_of(found: Sequence[Failure]) -> list[Failure]:
    lost = sorted((one for one in found if one.lost), key=lambda one: -one.score)
    missed = sorted((one for one in found if not one.lost), key=lambda one: one.score)
    return lost[:MOST] + missed[:MOST]


def _part(preset: str, found: Sequence[Failure], folder: Path) -> tuple[str, ...]:
    title = f'### {preset}'
    if not found:
        return title, 'Nothing was lost, and nothing missed.'
    name = f'results_failures_{preset.replace("-", "_")}.png'
    gallery_picture.draw([_panel(one) for one in found], folder / name)
    lost = sum(one.lost for one in found)
    text = f'{lost} good points that were lost and {len(found) - lost} outliers that were missed'
    return title, image(name, text), _table(found)


def _panel(failure: Failure) -> tuple[str, Cutout]:
    kind = 'lost' if failure.lost else 'missed'
    return f'{kind}: {failure.what}, {number(failure.score, 2)}', failure.cutout


def _table(found: Sequence[Failure]) -> str:
    return table(
        ('point', 'score', 'off its surface, cm', 'σ of that, cm', 'log-odds by feature'),
        [
            (
                f'{"lost" if one.lost else "missed"}: {one.what}',
                number(one.score, 2),
                number(100 * one.off, 1),
                number(100 * one.sigma, 1),
                ', '.join(f'`{name}` {added:+.1f}' for name, added in one.largest) or 'none',
            )
            for one in found
        ],
    )
