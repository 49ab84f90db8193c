# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The papers' tables, and ours beside them on the presets that are like their clouds."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lidar_outlier_filter.evaluation.confusion import Confusion
from lidar_outlier_filter.evaluation.report import percent
from lidar_outlier_filter.parameters.detectors import Hierarchical
from lidar_outlier_filter.results.contestants import (
    DEFAULT,
    FORM_A,
    FORM_AB,
    FORM_B,
    FORM_C,
    KANG_60,
)
from lidar_outlier_filter.results.markdown import paragraphs, table
from lidar_outlier_filter.simulation import sotoodeh_clusters as hod_scene

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from lidar_outlier_filter.results.contest import Standing, Standings

CLOUDS = ('leslar-a', 'leslar-b', 'leslar-c')
POINTS = (1_098_689, 295_147, 237_740)
OUTLIERS = (11_035, 872, 31)
# Leslar, Wang and Hu (2010), tables 2 to 5: identified, good points identified, missed, on A, B, C.
# In table 4 of the paper cloud A's identified and missed do not add up to its outliers.
LESLAR: Mapping[str, tuple[tuple[int, int, int], ...]] = {
    FORM_A: ((3414, 55, 7621), (291, 27, 581), (4, 3, 27)),
    FORM_B: ((16, 0, 11024), (33, 0, 839), (4, 0, 27)),
    FORM_C: ((5221, 15431, 5060), (712, 0, 160), (15, 193, 16)),
    FORM_AB: ((3460, 54, 7575), (314, 25, 558), (5, 4, 27)),
}
# Sotoodeh (2006), table 3: LOF, MinPts = 20, > 1.2, on an airborne cloud.
SOTOODEH_LOF = Confusion(found=319, missed=4273, lost=1261, kept=109_967)
# Kang, Huang and Yang (2018), table 1: share eliminated with k = 30 and 60.
KANG = {'kang-urban': (0.00047, 0.00051), 'kang-mountain': (0.00022, 0.00024)}
AIRBORNE = 'kang-urban'


def leslar(found: Standings) -> str:
    """Put Tables 2 to 5 of Leslar et al. (2010) beside ours."""
    head = ['', *(f'{cloud}: {what}' for cloud in 'ABC' for what in ('found', 'missed', 'wrong'))]
    rows: list[Sequence[str]] = []
    for form, paper in LESLAR.items():
        rows.append([f'paper: {form}', *_paper(paper)])
        rows.append([f'ours: {form}', *_ours(found, form)])
    rows += [[f'ours: {other}', *_ours(found, other)] for other in (DEFAULT, '`quadric`')]
    return paragraphs(
        'Leslar, Wang and Hu (2010), tables 2 to 5, of the outliers the share identified and '
        'missed, and of the cloud the share identified incorrectly. Theirs is a strip of a car '
        'park, ours a street with all that lines it: what is wrong with edges cannot be seen '
        'in theirs. (b) fits a surface around each point, and is run on the smaller two only.',
        table(head, rows),
        _worse(found),
    )


def _worse(found: Standings) -> str:
    """Say in which figures ours are worse than those of the paper, form by form."""
    lines = []
    for form, paper in LESLAR.items():
        less, more = [], []
        for cloud, (good, wrong, _), points, outliers in zip(
            CLOUDS, paper, POINTS, OUTLIERS, strict=True
        ):
            standing = found.get(cloud, {}).get(form)
            if standing is None:
                continue
            if standing.whole.recall.ratio < good / outliers:
                less.append(cloud[-1].upper())
            if standing.whole.alpha_error.ratio > wrong / points:
                more.append(cloud[-1].upper())
        texts = [
            f'{what} on {", ".join(which)}'
            for what, which in (('finds less', less), ('is wrong more often', more))
            if which
        ]
        if texts:
            lines.append(f'* {form}: {", ".join(texts)}')
    return paragraphs('Where ours is worse than the paper:', '\n'.join(lines)) if lines else ''


def _paper(counts: Sequence[tuple[int, int, int]]) -> list[str]:
    cells: list[str] = []
    for (found, wrong, missed), points, outliers in zip(counts, POINTS, OUTLIERS, strict=True):
        cells += [percent(found / outliers), f'{missed:,}', percent(wrong / points)]
    return cells


def _ours(found: Standings, name: str) -> list[str]:
    cells: list[str] = []
    for cloud in CLOUDS:
        standing = found.get(cloud, {}).get(name)
        if standing is None:
            cells += ['–'] * 3
            continue
        whole, seeds = standing.whole, len(standing.records)
        missed = f'{whole.missed / seeds:,.0f}'
        cells += [percent(whole.recall.ratio), missed, percent(whole.alpha_error.ratio)]
    return cells


def sotoodeh(found: Standings, seeds: Iterable[int] = range(101, 121)) -> str:
    """Put Table 3 of Sotoodeh (2006) and Table 1 of Sotoodeh (2007) beside ours."""
    head = ('', 'recall', 'α-error', 'β-error', 'F1')
    rows = [('paper', *_errors(SOTOODEH_LOF))]
    standing = found.get(AIRBORNE, {}).get('`lof`')
    if standing is not None:
        rows.append((f'ours, {AIRBORNE}', *_errors(standing.whole)))
    names = ('phase 1: α-error', 'phase 1: β-error', 'phase 2: α-error', 'phase 2: β-error')
    seeds = list(seeds)
    means = hod_scene.mean_errors(seeds, Hierarchical())
    phases = [
        (name, percent(paper), percent(mine))
        for name, paper, mine in zip(names, hod_scene.PAPER, means, strict=True)
    ]
    return paragraphs(
        'Sotoodeh (2006), table 3: LOF with 20 neighbours, rejected above 1.2. Both errors are '
        'shares of the whole cloud. His truth is what lies more than 3.07 m off a model from '
        'images, 4 % of an airborne cloud, much of it trees; ours are 0.05 % gross errors.',
        table(head, rows),
        'Sotoodeh (2007), table 1: `hierarchical` on `sotoodeh-hod`, mean of '
        f'{len(seeds)} seeds; shares of all points that the phase has seen.',
        table(('', 'paper', 'ours'), phases),
    )


def _errors(counts: Confusion) -> tuple[str, ...]:
    shares = (counts.recall, counts.alpha_error, counts.beta_error)
    return (*(percent(share.ratio) for share in shares), f'{counts.f1:.3f}')


def kang(found: Standings) -> str:
    """Put Table 1 of Kang, Huang and Yang (2018) beside ours."""
    head = (
        'share of the points eliminated',
        'paper, k = 30',
        'k = 60',
        'ours, k = 30',
        'k = 60',
        'true share',
        'recall, k = 30',
        'good points lost, k = 30',
    )
    rows = []
    for preset, paper in KANG.items():
        names = ('`elevation`', KANG_60)
        standings: list[Standing] = [
            found[preset][name] for name in names if name in found.get(preset, {})
        ]
        if len(standings) < len(names):
            continue
        first = standings[0].whole
        rows.append(
            (
                preset,
                *(percent(share) for share in paper),
                *(percent(one.whole.identified.ratio) for one in standings),
                percent(first.prevalence.ratio),
                percent(first.recall.ratio),
                percent(first.false_rejections.ratio),
            )
        )
    if not rows:
        return ''
    return paragraphs(
        'Kang, Huang and Yang (2018), table 1. They do not say how many of the eliminated points '
        'were errors. What ours eliminates beyond the true share are good points.',
        table(head, rows),
    )
