# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Table 1 and figure 4 of Kang, Huang and Yang (2018), and ours beside them, reading by reading."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats, Progress
from lidar_outlier_filter.core.detectors.builtin import Elevation
from lidar_outlier_filter.core.detectors.elevation import body, detect, differences
from lidar_outlier_filter.evaluation.report import percent
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_lab.results.markdown import NOTHING, image, paragraphs, share_of, table
from lidar_outlier_lab.results.papers.methods import METHODS, NONE_OF_ITS_PRESETS, count
from lidar_outlier_lab.results.papers.panels import PointPanel, draw, draw_lines, view
from lidar_outlier_lab.results.papers.published import KANG
from lidar_outlier_lab.results.samples import Sample, simulated


class Reading(NamedTuple):
    """One way to read the paper: the neighbours are on the map, or in space."""

    parameters: Elevation
    on_map: bool = True

    def of(self, k: int) -> Reading:
        """Read it with so many neighbours."""
        return self._replace(parameters=replace(self.parameters, k=k))


AS_PUBLISHED = 'as published: histogram, x and y, low points'
BARE = 'without the histogram: x and y, low points'
OURS = '`elevation` by default: x and y, both sides, histogram'
SPACE = 'x, y and z, low points'
# Section 4 applies the histogram in both of its tests. Without it: gap 0.
READINGS: Mapping[str, Reading] = {
    AS_PUBLISHED: Reading(FilterParameters().changed(METHODS['kang2018']).of(Elevation)),
    BARE: Reading(Elevation(sides='low', gap=0.0)),
    'x and y, both sides': Reading(Elevation(gap=0.0)),
    OURS: Reading(Elevation()),
    SPACE: Reading(Elevation(sides='low', gap=0.0), on_map=False),
    'x, y and z, low points, histogram': Reading(Elevation(sides='low'), on_map=False),
    'x, y and z, both sides': Reading(Elevation(gap=0.0), on_map=False),
}
TABLE = (30, 60)  # neighbours
CURVE = (5, 10, 20, 30, 45, 60, 90, 120)
DRAWN = (AS_PUBLISHED, BARE, OURS, 'x, y and z, both sides')
SURFACES = '`quadric` by default: surfaces through sections'
STRIP = 60.0  # metres of a side view, across


def section(presets: Sequence[str], seed: int, folder: Path, progress: Progress) -> str:
    """Judge the two areas in all readings, write it up, and draw figure 4 and the curves over k."""
    areas = [area for area in KANG if area in presets]
    if not areas:
        return NONE_OF_ITS_PRESETS
    samples = []
    for number, area in enumerate(areas):
        progress(number, 2 * len(areas), f'simulating {area}')
        samples += simulated(area, seed)
    progress(len(areas), 2 * len(areas), 'gross errors')
    rows, sigmas, ranges, surfaces = (
        [row for sample in samples for row in rows_of(sample)]
        for rows_of in (_rows, _sigmas, _ranges, _surfaces)
    )
    views = [_views(sample) for sample in samples]
    draw(views, folder / 'kang2018_figure_4.png', ('along, m', 'elevation, m'))
    pictures = [_curves(sample, folder) for sample in samples]
    head = (
        'share eliminated',
        *(f'k = {k}' for k in TABLE),
        *(f'time, k = {k}' for k in TABLE),
        'gross errors found, k = 30',
        'good points lost, k = 30',
    )
    return paragraphs(
        f'Seed {seed}. True share of gross errors: '
        + ', '.join(f'{one.name} {share_of(one.data.bad)}' for one in samples)
        + '.',
        '### Table 1',
        table(head, rows),
        'Times of the paper are of a machine of 2018 and of clouds whose size it does not print.',
        '### What makes the standard deviation',
        table(('', 'σ of all M, m', 'σ without the gross errors, m', '3 σ, m'), sigmas),
        '### Section 4: elevations before and after, m',
        table(('', 'lowest', 'highest', 'range'), ranges),
        'The good points are those of the simulation. `gap` is 5 m, so what is nearer than that to '
        'the next point is left to step (5).',
        '### Section 4: against a method that fits surfaces',
        table(('', 'share eliminated', 'gross errors found', 'good points lost', 'time'), surfaces),
        '### Choice of k',
        *(
            paragraphs(image(name, f'Share eliminated against k, {sample.name}'), text)
            for (name, text), sample in zip(pictures, samples, strict=True)
        ),
        '### Figure 4',
        image('kang2018_figure_4.png', 'Side views before and after'),
        f'Side views of a strip of {STRIP:.0f} m: before, after the method as published, and '
        'after `elevation` with its defaults.',
    )


def judge(xyz: Floats, reading: Reading) -> Bools:
    """Return which points one reading rejects."""
    return detect(xyz, reading.parameters, on_map=reading.on_map) > 1


def _rows(sample: Sample) -> list[Sequence[str]]:
    shares, theirs = KANG[sample.name]
    rows: list[Sequence[str]] = [
        (
            f'**{sample.name}**: paper',
            *map(percent, shares),
            *(f'{one} s' for one in theirs),
            NOTHING,
            NOTHING,
        )
    ]
    (xyz,) = sample.clouds
    for name, reading in READINGS.items():
        begin = perf_counter()
        found: list[Bools] = []
        seconds: list[float] = []
        for k in TABLE:
            found.append(judge(xyz, reading.of(k)))
            seconds.append(perf_counter() - begin - sum(seconds))
        bad = sample.data.bad
        rows.append(
            (
                name,
                *map(share_of, found),
                *(f'{one:.1f} s' for one in seconds),
                share_of(found[0][bad]),
                share_of(found[0][~bad]),
            )
        )
    return rows


def _sigmas(sample: Sample) -> list[Sequence[str]]:
    """Say how much of the standard deviation of M the gross errors make."""
    (xyz,) = sample.clouds
    rows: list[Sequence[str]] = []
    for name in (AS_PUBLISHED, BARE, SPACE):
        parameters, on_map = READINGS[name]
        low, high = body(xyz[:, 2], parameters.gap)
        left = (xyz[:, 2] >= low) & (xyz[:, 2] <= high)
        m = differences(xyz[left], parameters.k, on_map=on_map)
        good = ~sample.data.bad[left]
        # Good points keep the neighbours that they have: gross errors may be among them.
        sigma, clean = float(np.std(m, ddof=1)), float(np.std(m[good], ddof=1))
        rows.append((f'{sample.name}: {name}', *(f'{v:.2f}' for v in (sigma, clean, 3 * sigma))))
    return rows


def _ranges(sample: Sample) -> list[Sequence[str]]:
    """Say between which elevations points are: at first, after the histogram, after all steps."""
    (xyz,) = sample.clouds
    z, published = xyz[:, 2], READINGS[AS_PUBLISHED]
    low, high = body(z, published.parameters.gap)
    kept = {
        'before': np.ones(len(z), np.bool_),
        'after the histogram': (z >= low) & (z <= high),
        **{f'as published, k = {k}': ~judge(xyz, published.of(k)) for k in TABLE},
        'x and y, both sides, histogram, k = 30': ~judge(xyz, READINGS[OURS]),
        'good points alone': ~sample.data.bad,
    }
    return [
        (f'{sample.name}: {name}', *(f'{v:.1f}' for v in (*ends, ends[1] - ends[0])))
        for name, some in kept.items()
        for ends in [(float(z[some].min()), float(z[some].max()))]
    ]


def _surfaces(sample: Sample) -> list[Sequence[str]]:
    """Compare with surfaces fitted to the points: the paper's "method based on entity"."""
    rows: list[Sequence[str]] = []
    for name, values in ((AS_PUBLISHED, METHODS['kang2018']), (SURFACES, {'chain': ['quadric']})):
        found = count(sample, values)
        whole = found.whole
        shares = (float(found.rejected.mean()), whole.recall.ratio, whole.false_rejections.ratio)
        cells = (*map(percent, shares), f'{found.seconds:.1f} s')
        rows.append((f'{sample.name}: {name}', *cells))
    return rows


def _curves(sample: Sample, folder: Path) -> tuple[str, str]:
    """Draw the shares eliminated against k; return the picture's name and a table of both."""
    (xyz,) = sample.clouds
    bad = sample.data.bad
    series: dict[str, list[float]] = {}
    rows = []
    for name in DRAWN:
        found = [judge(xyz, READINGS[name].of(k)) for k in CURVE]
        series[name.replace('`', '')] = [float(100 * one.mean()) for one in found]
        rows.append((f'{name}: eliminated', *map(share_of, found)))
        rows.append((f'{name}: found', *(share_of(one[bad]) for one in found)))
    stem = f'kang2018_k_{sample.name.removeprefix("kang-")}'
    draw_lines(series, CURVE, folder / stem, 'share eliminated, %', from_zero=True)
    return f'{stem}.png', table((sample.name, *(f'k = {k}' for k in CURVE)), rows)


def _views(sample: Sample) -> list[PointPanel]:
    (xyz,) = sample.clouds
    middle = float(np.median(xyz[:, 1]))
    strip = np.abs(xyz[:, 1] - middle) < STRIP / 2
    flat, bad = xyz[strip][:, [0, 2]], sample.data.bad[strip]
    after = {name: judge(xyz, READINGS[name])[strip] for name in (AS_PUBLISHED, OURS)}
    return [
        view(f'{sample.name}: before', flat, bad, np.ones(len(bad), np.bool_)),
        *(
            view(name.partition(':')[0].replace('`', ''), flat, bad, ~rejected)
            for name, rejected in after.items()
        ),
    ]
