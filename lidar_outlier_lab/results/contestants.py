# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Who is compared: sets of parameters of this filter by name, and peers with their own code."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats, Reals
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_lab.results.papers.methods import SMOOTHER
from lidar_outlier_lab.results.peers import loads, lof, open3d_cloud, rejected_but
from lidar_outlier_lab.results.samples import Sample

Judge = Callable[[Floats], 'Judgement']

DEFAULT = 'default'
NEIGHBOURS, FACTOR, DEVIATIONS = 20, 1.2, 2.0
RADIUS, MIN_NEIGHBOURS = 0.5, 3  # the defaults of sor.statistic: radius
MAX_PEER_POINTS = 300_000  # points of one cloud that slow peers are given


class Judgement(NamedTuple):
    """What is said of N points: whether rejected, and the score behind it, where there is one."""

    rejected: Bools
    score: Reals | None


@dataclass(frozen=True)
class Contestant:
    """Somebody who judges samples: what the tables call it, which ones suit it, and its verdict."""

    name: str
    suits: Callable[[Sample], bool]
    judge: Callable[[Sample], Judgement]  # of all points of a sample, in their order


@dataclass(frozen=True)
class Ours(Contestant):
    """A set of parameters of this filter."""

    parameters: FilterParameters


def ours(
    name: str,
    values: Mapping[str, object] | None = None,
    *,
    needs_origin: bool = False,
    only: tuple[str, ...] = (),
) -> Ours:
    """Let this filter judge a recording in blocks, as the node, and one cloud whole, as ``clean``.

    Parameters
    ----------
    name : what the tables call it
    values : parameters by their dotted names; all others are the defaults
    needs_origin : whether it uses the distance from the sensor, which only sweeps in the sensor's
        own frame show
    only : beginnings of names of the samples that it is for; empty: all

    """
    parameters = FilterParameters().changed(values or {})

    def suits(sample: Sample) -> bool:
        meant = not only or sample.name.startswith(only)
        placed = sample.in_own_frame or not needs_origin
        return meant and placed and sample.suits(parameters.chain)

    def judge(sample: Sample) -> Judgement:
        verdict = sample.data.judge(parameters)
        return Judgement(verdict.rejected, verdict.score)

    return Ours(name, suits, judge, parameters)


def peer(name: str, cloud: Judge, most: float = math.inf) -> Contestant:
    """Let somebody else's code judge cloud by cloud; those of more than ``most`` points not."""

    def judge(sample: Sample) -> Judgement:
        result = [cloud(xyz) for xyz in sample.clouds]
        scores = [one.score for one in result if one.score is not None]
        rejected = np.concatenate([one.rejected for one in result])
        return Judgement(rejected, np.concatenate(scores) if scores else None)

    return Contestant(name, lambda sample: max(map(len, sample.clouds)) <= most, judge)


# Near to Leslar et al. (2010), whose published forms are on the pages of the papers.
ONE_SURFACE = {
    'quadric.surfaces': 1,
    'quadric.significance': SMOOTHER['alpha_beta_gamma.significance'],
}
PATCH = {**ONE_SURFACE, 'quadric.window': 'patch'}
SMALL_ONES = ('leslar-b', 'leslar-c')  # a surface for each point takes minutes on larger ones
ALL_THREE = ('alpha_beta_gamma', 'quadric', 'lof')
# What others tune for a scene: distances to neighbours, and of them as parts of the range.
RULES = ('`sor`', '`sor`, radius', '`sor` as DROR', '`sor` as DSOR')

OURS: tuple[Ours, ...] = (
    ours(DEFAULT),
    ours('`alpha_beta_gamma`', {'chain': ('alpha_beta_gamma',)}),
    ours('smoother ±5, σ of each line', {**SMOOTHER, 'chain': ('alpha_beta_gamma',)}),
    ours('`quadric`', {'chain': ('quadric',)}),
    ours('`quadric`, one surface, `patch`', {**PATCH, 'chain': ('quadric',)}, only=SMALL_ONES),
    ours('`quadric`, one surface', {**ONE_SURFACE, 'chain': ('quadric',)}),
    ours(
        'smoother ±5, then one surface, `patch`',
        {**SMOOTHER, **PATCH, 'chain': ('alpha_beta_gamma', 'quadric')},
        only=SMALL_ONES,
    ),
    ours('`lof`', {'chain': ('lof',)}),
    ours('`sor`', {'chain': ('sor',)}),
    ours('`sor`, radius', {'chain': ('sor',), 'sor.statistic': 'radius'}),
    ours(
        '`sor` as DROR',
        {
            'chain': ('sor',),
            'sor.statistic': 'radius',
            'sor.range_scaled': True,
            'sor.radius': 0.05,
            'sor.range_factor': 0.035,
        },
        needs_origin=True,
    ),
    ours(
        '`sor` as DSOR',
        {
            'chain': ('sor',),
            'sor.k': 4,
            'sor.multiplier': 0.01,
            'sor.range_scaled': True,
            'sor.range_factor': 0.05,
        },
        needs_origin=True,
    ),
    ours('`hierarchical`', {'chain': ('hierarchical',)}),
    ours('`elevation`', {'chain': ('elevation',)}),
    ours('`elevation`, k = 60', {'chain': ('elevation',), 'elevation.k': 60}, only=('kang-',)),
    ours('`alpha_beta_gamma`, `quadric`, `lof`', {'chain': ALL_THREE}),
    ours('two of these three (`vote: 2`)', {'chain': ALL_THREE, 'vote': 2}),
)


def peers() -> tuple[Contestant, ...]:
    """List the peers that are installed."""
    found: list[Contestant] = []
    if loads('open3d'):
        found += [
            peer(f'Open3D SOR({NEIGHBOURS}, {DEVIATIONS})', _open3d_sor),
            peer(f'Open3D radius({MIN_NEIGHBOURS}, {RADIUS})', _open3d_radius, MAX_PEER_POINTS),
        ]
    if loads('sklearn'):
        name = f'scikit-learn LOF({NEIGHBOURS}) > {FACTOR}'
        found.append(peer(name, _sklearn_lof, MAX_PEER_POINTS))
    return tuple(found)


def missing() -> list[str]:
    """List the packages of peers that are not installed."""
    packages = {'open3d': 'Open3D', 'sklearn': 'scikit-learn'}
    return [name for module, name in packages.items() if not loads(module)]


def _open3d_sor(xyz: Floats) -> Judgement:
    kept = open3d_cloud(xyz).remove_statistical_outlier(NEIGHBOURS, DEVIATIONS)[1]
    return Judgement(rejected_but(kept, len(xyz)), None)


def _open3d_radius(xyz: Floats) -> Judgement:
    kept = open3d_cloud(xyz).remove_radius_outlier(MIN_NEIGHBOURS, RADIUS)[1]
    return Judgement(rejected_but(kept, len(xyz)), None)


def _sklearn_lof(xyz: Floats) -> Judgement:
    factor = lof(xyz, NEIGHBOURS)
    return Judgement(factor > FACTOR, factor)
