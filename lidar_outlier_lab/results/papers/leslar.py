# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Tables 1 to 5 and figure 3 of Leslar, Wang and Hu (2010), and ours beside them."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats, Progress
from lidar_outlier_filter.core.detectors.builtin import Quadric
from lidar_outlier_filter.core.detectors.quadric import detector as quadric
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.evaluation.report import percent
from lidar_outlier_filter.evaluation.truth import Kind
from lidar_outlier_lab.results.markdown import NOTHING, image, paragraphs, share_of, table
from lidar_outlier_lab.results.papers import panels
from lidar_outlier_lab.results.papers.methods import (
    CLASSIC,
    METHODS,
    NONE_OF_ITS_PRESETS,
    SMOOTHER,
    Counted,
    count,
)
from lidar_outlier_lab.results.papers.published import LESLAR, OUTLIERS, POINTS
from lidar_outlier_lab.results.samples import Sample, simulated

Table = Mapping[str, Sequence[Counted]]  # by the name of a form; of A, B and C
Strip = tuple[Floats, Bools, Mapping[str, Bools]]

CLOUDS = ('leslar-a', 'leslar-b', 'leslar-c')
TITLES = {
    'a': 'Table 2: algorithm (a), the smoother',
    'b': 'Table 3: algorithm (b), a quadric through the neighbours of each point',
    'c': 'Table 4: algorithm (c), a quadric through each section',
    'ab': 'Table 5: (a), then (b)',
}
SIGMAS = (0.03, 0.05, 0.1, 0.15, 0.17, 0.2, 0.25)  # metres
FORMS: Mapping[str, Mapping[str, object]] = {
    **{key: METHODS[f'leslar2010_{key}'] for key in TITLES},
    **{f'(a), σ = {sigma} m': {**SMOOTHER, 'alpha_beta_gamma.sigma': sigma} for sigma in SIGMAS},
    '(a), σ of each line': SMOOTHER,
    **{
        f'({key}), σ of a residual at least 5 mm': {
            **METHODS[f'leslar2010_{key}'],
            'quadric.sigma_floor': 0.005,
        }
        for key in 'bc'
    },
    '(c), at most the model that is needed': {
        'chain': ['quadric'],
        'quadric.surfaces': 1,
        'quadric.significance': 0.001,
    },
    '`quadric` as it is by default': {'chain': ['quadric']},
    '`alpha_beta_gamma` as it is by default': {'chain': ['alpha_beta_gamma']},
    '`alpha_beta_gamma`, `quadric`, `lof`': CLASSIC,
    'the default, `boosted_trees`': {},
}
SHOWN = ('a', 'b', 'c', 'ab', 'the default, `boosted_trees`')  # in the figure
MILLION = 1e6


def section(presets: Sequence[str], seed: int, folder: Path, progress: Progress) -> str:
    """Judge the requested clouds in all forms; draw figure 3."""
    clouds = [cloud for cloud in CLOUDS if cloud in presets]
    if not clouds:
        return NONE_OF_ITS_PRESETS
    found: dict[str, list[Counted]] = {name: [] for name in FORMS}
    strips = []
    for number, cloud in enumerate(clouds):
        (sample,) = simulated(cloud, seed)
        for step, (name, values) in enumerate(FORMS.items()):
            done = number * len(FORMS) + step
            progress(done, len(clouds) * len(FORMS), f'{name} on {cloud}')
            found[name].append(count(sample, values))
        shown = {name: found[name][-1].rejected for name in SHOWN}
        strips.append((cloud, cut_strip(sample, shown)))
    draw_strips(strips, folder / 'leslar2010_figure_3.png')
    letters = [cloud[-1].upper() for cloud in clouds]
    return paragraphs(
        f'Seed {seed}. The clouds have as many points and outliers as those of table 1.',
        *(
            f'### {title}\n\n{_like_the_paper(found, key, letters)}'
            for key, title in TITLES.items()
        ),
        '### Every form, and the road alone',
        'Share of the outliers found, of all points that are rejected wrongly, and of the good '
        'points of the road that are. The paper has a car park only: its wrong points are of '
        'asphalt, ours of kerbs, houses and cars too.',
        _every_form(found, letters),
        '### Single outliers on clean asphalt',
        _asphalt(),
        '### Figure 3',
        image('leslar2010_figure_3.png', 'Profiles of A, B and C before and after each method'),
        'Seen from the side, along the street and up, metres: a stretch of each cloud, the road '
        'and what is above it. Red: outliers that are still there. Orange: good points that went.',
    )


def _like_the_paper(found: Table, key: str, letters: Sequence[str]) -> str:
    """Lay out one table with the rows of the paper, ours beside each column."""
    head = [f'{letter}: {whose}' for letter in letters for whose in ('paper', 'ours')]
    columns = []
    for letter, ours in zip(letters, found[key], strict=True):
        index = 'ABC'.index(letter)
        paper, points, outliers = LESLAR[key][index], POINTS[index], OUTLIERS[index]
        columns.append(_column(paper.found, paper.wrong, paper.missed, points, outliers))
        whole = ours.whole
        columns.append(_column(whole.found, whole.lost, whole.missed, whole.total, whole.outliers))
    names = (
        'No. of outliers identified',
        'No. of non-outliers identified',
        'No. of outliers missed',
        '% of outliers identified',
        '% of point cloud identified',
        '% of point cloud identified incorrectly',
    )
    rows = [[name, *(column[row] for column in columns)] for row, name in enumerate(names)]
    return table(['', *head], rows)


def _column(found: int, wrong: int, missed: int, points: int, outliers: int) -> list[str]:
    shares = (found / outliers, (found + wrong) / points, wrong / points)
    return [f'{found:,}', f'{wrong:,}', f'{missed:,}', *(f'{100 * one:.2f}' for one in shares)]


def _every_form(found: Table, letters: Sequence[str]) -> str:
    what = ('found', 'wrong', 'road')
    head = ['', *(f'{letter}: {one}' for letter in letters for one in what), 'million points/s']
    rows = []
    for name, counted in found.items():
        cells = [f'**{SHORT_TITLES[name]}**' if name in SHORT_TITLES else name]
        for one in counted:
            whole = one.whole
            cells += [percent(whole.recall.ratio), percent(whole.share('alpha_error').ratio)]
            cells.append(percent(one.road))
        seconds = sum(one.seconds for one in counted)
        cells.append(f'{sum(one.whole.total for one in counted) / seconds / MILLION:.3f}')
        rows.append(cells)
    for key in TITLES:
        cells = [f'paper: {TITLES[key].partition(":")[0].lower()}']
        for letter in letters:
            index = 'ABC'.index(letter)
            paper = LESLAR[key][index]
            cells += [percent(paper.found / OUTLIERS[index]), percent(paper.wrong / POINTS[index])]
            cells.append(NOTHING)
        rows.append([*cells, NOTHING])
    return table(head, rows)


SIDE, STEP, EVERY, HEIGHT = 150, 0.05, 14, 0.1  # points, metres, points, metres
NOISES = (0.003, 0.005, 0.008)  # metres
ASPHALT_FORMS: Mapping[str, Mapping[str, Any]] = {
    '`model: always`, no floor': {'model': 'always', 'sigma_floor': 1e-6},
    '`model: always`, floor 5 mm': {'model': 'always'},
    '`model: lowest`': {'sigma_floor': 1e-6},
    '`model: lowest`, floor 5 mm': {},
}


def asphalt(noise: float) -> tuple[Floats, Bools]:
    """Scan a flat strip, with an outlier of ``HEIGHT`` in the middle of every ``EVERY`` points."""
    rng = np.random.default_rng(1)
    cell = np.mgrid[:SIDE, :SIDE].reshape(2, -1)
    xy = STEP * (cell + rng.uniform(-0.2, 0.2, cell.shape))
    bad = (cell % EVERY == EVERY // 2).all(axis=0)
    z = rng.normal(0.0, noise, SIDE * SIDE) + HEIGHT * bad
    return np.stack([*xy, z], axis=1), bad


def _asphalt() -> str:
    """Say what single outliers do to a surface that may bend, patch by patch."""
    rows = []
    for noise in NOISES:
        xyz, bad = asphalt(noise)
        for name, changed in ASPHALT_FORMS.items():
            cells = [f'{1000 * noise:.0f} mm', name]
            for window in ('patch', 'section'):
                parameters = replace(
                    Quadric(window=window, surfaces=1, significance=0.001), **changed
                )
                near = Neighbourhood(xyz, parameters.list_length)
                rejected = quadric.detect(near, parameters) > 1
                cells += [share_of(rejected[bad]), share_of(rejected[~bad])]
            rows.append(cells)
    return paragraphs(
        f'A flat strip with a point every {100 * STEP:.0f} cm, and single outliers '
        f'{100 * HEIGHT:.0f} cm above it, far from each other. A quadric has ten parameters and '
        'bends towards the outlier. With a least standard deviation of 5 mm a point passes that '
        'is within 18 mm of the surface; so near does the quadric come. A plane does not.',
        table(('noise', '`quadric`', '(b): found', '(b): wrong', '(c): found', '(c): wrong'), rows),
    )


LENGTH = 14.0  # metres of a profile
HALF = 2.5  # metres to both sides of the middle of the outliers
LOW, HIGH = -0.15, 2.2  # metres
ROW = 2.2  # inches
SHORT_TITLES = {'a': '(a)', 'b': '(b)', 'c': '(c)', 'ab': '(a), then (b)'}


def cut_strip(sample: Sample, rejected: Mapping[str, Bools]) -> Strip:
    """Cut out the stretch of a street that has the most outliers: the road and what is above it.

    The street runs along x; what stands beside the road is left out. Seen from the side: where its
    points are (M, 2), along the street and up, metres; which are outliers; verdicts by method.
    """
    (xyz,) = sample.clouds
    bad = sample.data.bad
    on_road = bad if sample.surface is None else sample.surface == Kind.ROAD
    outliers = xyz[bad]
    starts = np.arange(xyz[:, 0].min(), max(xyz[:, 0].max() - LENGTH, xyz[:, 0].min()) + 1.0)
    inside = [
        np.count_nonzero((outliers[:, 0] >= x) & (outliers[:, 0] < x + LENGTH)) for x in starts
    ]
    begin = starts[int(np.argmax(inside))]
    along = (xyz[:, 0] >= begin) & (xyz[:, 0] < begin + LENGTH)
    middle = float(np.median(xyz[along & bad, 1])) if (along & bad).any() else 0.0
    shown = along & (np.abs(xyz[:, 1] - middle) < HALF) & (bad | on_road)
    flat = np.stack([xyz[shown, 0] - begin, xyz[shown, 2]], axis=1)
    return flat, bad[shown], {name: one[shown] for name, one in rejected.items()}


def draw_strips(strips: Sequence[tuple[str, Strip]], path: Path) -> None:
    """Draw a row for each cloud: before, and after each method."""
    rows = []
    for name, (flat, bad, verdicts) in strips:
        every = {'before': np.zeros(len(bad), np.bool_)}
        for title, rejected in verdicts.items():
            every[SHORT_TITLES.get(title, title.partition(',')[0])] = rejected
        rows.append(
            [
                panels.view(f'{name[-1].upper()}: {title}', flat, bad, ~rejected)
                for title, rejected in every.items()
            ]
        )
    panels.draw(rows, path, ('along, m', 'height, m'), ROW, ((0.0, LENGTH), (LOW, HIGH)))
